"""What is reported of a task's result: figures, remarks and pictures, in a file beside it."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from usdfoliage.errors import CaptureError
from usdfoliage.files.json import read_json
from usdfoliage.jobs.report.table import Row
from usdfoliage.remarks import (
    Remark,
    Remedy,
    as_plan_setting,
    infos_of,
    remark_from_json,
    remedy_as_json,
    remedy_from_json,
    rename_in,
    rename_in_remedy,
    warnings_of,
)

SUMMARY = "summary.json"


@dataclass(frozen=True, kw_only=True)
class StagePicture:
    """A picture of a result."""

    file: str  # from the result's folder
    caption: str


@dataclass(frozen=True, kw_only=True)
class StageSummary:
    """The part of the report on one stage."""

    rows: Sequence[Row] = ()
    remarks: Sequence[Remark] = ()
    pictures: Sequence[StagePicture] = ()
    detail: str = ""  # a page of the stage's own, from the result's folder
    failure: str = ""  # why there is no result; the plant goes without
    remedy: Remedy = ()  # what to do about that
    poor: bool = False  # made without Storm's pictures: the next run tries again

    def warning_texts(self) -> list[str]:
        """What puts the result in question, with the settings of a plan."""
        return [each.sentence(as_plan_setting) for each in warnings_of(self.remarks)]

    def info_texts(self) -> list[str]:
        """Its other remarks, likewise."""
        return [each.sentence(as_plan_setting) for each in infos_of(self.remarks)]


def write_summary(folder: Path, summary: StageSummary) -> None:
    """Put it into the folder of the result."""
    values = asdict(summary) | {
        "remarks": [each.as_json() for each in summary.remarks],
        "remedy": remedy_as_json(summary.remedy),
    }
    text = json.dumps(values, indent=1, ensure_ascii=True)
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8")


def read_summary(folder: Path) -> StageSummary:
    """The summary of a result; CaptureError where it cannot be read."""
    try:
        values = read_json(folder / SUMMARY)
        return StageSummary(
            rows=tuple(Row(**row) for row in values["rows"]),
            remarks=tuple(remark_from_json(each) for each in values["remarks"]),
            pictures=tuple(StagePicture(**picture) for picture in values["pictures"]),
            detail=values["detail"],
            failure=values["failure"],
            remedy=remedy_from_json(values["remedy"]),
            poor=values["poor"],
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CaptureError(f"{folder / SUMMARY} cannot be read ({error})", "run the same command again") from error


def rename_paths(folder: Path, rename: Callable[[str], str]) -> None:
    """Rename the files in all texts of a summary; CaptureError where it cannot be read."""
    values = read_summary(folder)
    renamed = replace(
        values,
        rows=[replace(row, value=rename(row.value), remark=rename(row.remark)) for row in values.rows],
        remarks=[rename_in(each, rename) for each in values.remarks],
        failure=rename(values.failure),
        remedy=rename_in_remedy(values.remedy, rename),
    )
    write_summary(folder, renamed)
