"""What the tables and picture strips of reports are made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdfoliage.remarks import Remark


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of a table."""

    name: str
    value: str
    remark: str = ""


@dataclass(frozen=True, kw_only=True)
class ReportView:
    """One picture of the asset."""

    name: str
    file: str


@dataclass(frozen=True, kw_only=True)
class ReportPicture:
    """A picture with its caption."""

    file: str  # from the report's folder
    caption: str
    over: str = ""  # a second one, shown to the right of a bar that can be moved


@dataclass(frozen=True, kw_only=True)
class WrittenReport:
    """A report in its folder."""

    page: Path
    pictures: tuple[ReportPicture, ...]  # those of its pictures that the report of the whole plant has too
    remarks: tuple[Remark, ...] = ()  # on pictures that it lacks


@dataclass(frozen=True, kw_only=True)
class ReportPhotograph:
    """What is shown of one photograph."""

    title: str
    facts: str
    pictures: Sequence[ReportPicture]


@dataclass(frozen=True, kw_only=True)
class Histogram:
    """Bars of equal width."""

    title: str
    low: str
    high: str
    heights: Sequence[int]

    @property
    def highest(self) -> int:
        return max([*self.heights, 1])


def choose_evenly(count: int, max_count: int) -> list[int]:
    """Which of so many views are shown: all, or an even selection with the first and the last."""
    if count <= max_count:
        return list(range(count))
    return (
        sorted({round(place) for place in np.linspace(0, count - 1, max_count)}) if max_count > 1 else [0][:max_count]
    )
