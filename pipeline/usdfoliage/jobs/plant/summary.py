"""What a task says of its result: figures, remarks and pictures, in a file beside it."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from usdfoliage.errors import CaptureError
from usdfoliage.files.json import read_json
from usdfoliage.jobs.plant.plan_words import in_words_of_the_plan
from usdfoliage.jobs.report.table import Row

SUMMARY = "summary.json"


@dataclass(frozen=True, kw_only=True)
class StagePicture:
    """A picture of a result."""

    file: str  # from the result's folder
    caption: str


@dataclass(frozen=True, kw_only=True)
class StageSummary:
    """What the report says of a stage."""

    rows: Sequence[Row] = ()
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()  # what puts the result in doubt
    pictures: Sequence[StagePicture] = ()
    detail: str = ""  # a page of the stage's own, from the result's folder
    failure: str = ""  # why there is no result; the plant goes without
    poor: bool = False  # made without Storm's pictures: the next run tries again


def write_summary(folder: Path, summary: StageSummary) -> None:
    """Put it into the folder of the result, in the words of a plan."""
    said = replace(
        summary,
        notes=[in_words_of_the_plan(note) for note in summary.notes],
        warnings=[in_words_of_the_plan(warning) for warning in summary.warnings],
        failure=in_words_of_the_plan(summary.failure),
    )
    text = json.dumps(asdict(said), indent=1, ensure_ascii=True)
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8")


def read_summary(folder: Path) -> StageSummary:
    """The summary of a result; CaptureError where it cannot be read."""
    try:
        held = read_json(folder / SUMMARY)
        return StageSummary(
            rows=tuple(Row(**row) for row in held["rows"]),
            notes=tuple(held["notes"]),
            warnings=tuple(held["warnings"]),
            pictures=tuple(StagePicture(**picture) for picture in held["pictures"]),
            detail=held["detail"],
            failure=held["failure"],
            poor=held["poor"],
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CaptureError(f"{folder / SUMMARY} cannot be read ({error}); run the same command again") from error


def rename_paths(folder: Path, rename: Callable[[str], str]) -> None:
    """Let all that a summary says name files otherwise; CaptureError where it cannot be read."""
    held = read_summary(folder)
    renamed = replace(
        held,
        rows=[replace(row, value=rename(row.value), remark=rename(row.remark)) for row in held.rows],
        notes=[rename(note) for note in held.notes],
        warnings=[rename(warning) for warning in held.warnings],
        failure=rename(held.failure),
    )
    write_summary(folder, renamed)
