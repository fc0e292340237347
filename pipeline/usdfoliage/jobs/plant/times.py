"""How long tasks may take, by what tasks of their stages took in the same work folder. No key depends on it."""

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from statistics import median

from usdfoliage.files.reading import open_regular
from usdfoliage.jobs.plant.store import Store, derive_stage
from usdfoliage.jobs.plant.tasks import ASSET, BRANCHES, CROWN, REPORT, SKETCH, VARIANTS, BuildPlan, Task

_MAX_STAMPS = 1000  # that are looked at; keys are hashes, so that the first by name are a fair choice
_HEAD_BYTES = 600  # of a stamp, before its list of files
_HEAD = re.compile(
    rb'"name": "(?P<name>[^"\\]+)",\s*(?:"stage": "[^"\\]+",\s*"step": "(?P<step>[^"\\]+)",\s*)?'
    rb'"seconds": (?P<seconds>[\d.eE+-]+),\s*"estimate_s": (?P<estimate>[\d.eE+-]+),\s*"poor": (?P<poor>true|false)'
)
_MIN_S = 0.05
# Their estimates know nothing of the plant: seconds are taken as they are.
_OF_ANY_SIZE = (BRANCHES, CROWN, SKETCH, ASSET, VARIANTS, REPORT)


@dataclass(frozen=True, kw_only=True)
class StageTimes:
    """What tasks of a stage took, in the middle."""

    seconds: float
    ratio: float  # to their estimates


def expect_times(plan: BuildPlan, store: Store) -> BuildPlan:
    """The plan with the estimates of all stages that the work folder has finished tasks of.

    Stamps keep the estimate of the task's size, without this: what is learned is not learned again.
    """
    try:
        changed_ns = (store.folder / "tasks").stat().st_mtime_ns
    except OSError:
        return plan  # nothing was built here
    times = read_times(store.folder, changed_ns)
    return replace(plan, tasks={name: _expect(task, times) for name, task in plan.tasks.items()})


@lru_cache(maxsize=16)
def read_times(folder: Path, changed_ns: int) -> Mapping[str, StageTimes]:
    """By step, which is a stage, or a round of matching; of a work folder as it was at that time."""
    seconds: dict[str, list[float]] = {}
    ratios: dict[str, list[float]] = {}
    try:
        names = sorted(name for name in os.listdir(folder / "tasks") if name.endswith(".json"))  # noqa: PTH208 (quick)
    except OSError:
        return {}
    for name in names[:_MAX_STAMPS]:
        try:
            with open_regular(folder / "tasks" / name) as file:
                found = _HEAD.search(file.read(_HEAD_BYTES))
        except OSError:
            continue
        if found is None or found["poor"] == b"true":  # damaged, or without what takes its time
            continue
        try:
            took_s, estimate_s = float(found["seconds"]), float(found["estimate"])
        except ValueError:
            continue
        if math.isfinite(took_s) and math.isfinite(estimate_s) and estimate_s > 0:
            step = _step_of(found)
            seconds.setdefault(step, []).append(took_s)
            ratios.setdefault(step, []).append(took_s / estimate_s)
    return {
        step: StageTimes(seconds=median(seconds_of), ratio=median(ratios[step])) for step, seconds_of in seconds.items()
    }


def _expect(task: Task, times: Mapping[str, StageTimes]) -> Task:
    known = times.get(task.step)
    if known is None:
        return task
    expected_s = known.seconds if task.stage in _OF_ANY_SIZE else task.estimate_s * known.ratio
    return replace(task, estimate_s=max(expected_s, _MIN_S))


def _step_of(head: re.Match[bytes]) -> str:
    if head["step"] is not None:
        return head["step"].decode(errors="replace")
    _, step = derive_stage(head["name"].decode(errors="replace"))
    return step
