"""How long a run took: the one file of an asset that differs between equal runs, beside the report that shows it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from usdfoliage.asset.publish_file import publish_text
from usdfoliage.jobs.report.environment import clean_text

TIMINGS = "timings.js"
_ABOUT = (
    "How long the run took. Of all files of an asset this one alone differs between equal runs; "
    "a reproducible run does not write it."
)


@dataclass(frozen=True, kw_only=True)
class TaskTiming:
    """How long a task, or all tasks of a stage, took."""

    stage: str
    name: str = ""  # of the task; empty for the stage as a whole
    seconds: float
    cached: bool = False  # its result was there from a run before


@dataclass(frozen=True, kw_only=True)
class Timings:
    """How long a run took. It differs from run to run, so it is kept beside the report, not in it."""

    executor: str = ""  # in-process, 8 processes, Dask tcp://…; empty for the command itself
    seconds: float  # of the whole run, by the clock on the wall
    stages: Sequence[TaskTiming]
    tasks: Sequence[TaskTiming] = ()


def write_timings(folder: Path, timings: Timings) -> Path:
    """Write how long a run took into the folder of its report, whose page finds it there; returns the file.

    Raises:
        WriteError: The file cannot be written; what was there is unchanged.
    """
    text = json.dumps({"about": _ABOUT, **_cleaned(asdict(timings))}, indent=1, ensure_ascii=True).replace(
        "<", "\\u003c"
    )
    path = folder / TIMINGS
    publish_text(path, f"usdfoliageTimings({text});\n")
    return path


def write_step_times(folder: Path, seconds: Mapping[str, float]) -> Path | None:
    """The same for a command that runs by itself, whose steps took so long; nothing without steps.

    Raises:
        WriteError: As write_timings.
    """
    if not seconds:
        return None
    stages = [TaskTiming(stage=name, seconds=value) for name, value in seconds.items()]
    return write_timings(folder, Timings(seconds=sum(seconds.values()), stages=stages))


def _cleaned(value: Any) -> Any:
    """The same with texts that a page can hold."""
    if isinstance(value, dict):
        return {key: _cleaned(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_cleaned(inner) for inner in value]
    return clean_text(value) if isinstance(value, str) else value
