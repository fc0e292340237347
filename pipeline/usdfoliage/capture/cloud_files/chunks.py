"""A cloud file that is open: its points come in parts, so that files larger than memory can be read."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.remarks import Remark

PART_POINTS = 1 << 20  # that are read at once


class CloudPart(NamedTuple):
    """Some points of a file, in its order, its axes and its unit."""

    points: NDArray[np.float64]  # (N, 3), not finite where the file has it so, those that it marks among them
    colors: NDArray[np.float32] | None  # (N, 3), red, green, blue as the file has them; all parts of a file, or none
    work: int  # how much of the file's work this part was
    left_out: tuple[tuple[int, str], ...] = ()  # of the file, not among these: how many, and what they are
    marked: tuple[tuple[NDArray[np.bool_], str], ...] = ()  # (N,), of these, not to be used by the file, and why
    classes: NDArray[np.uint8] | None = None  # (N,), codes of a survey, 2 for the ground; None: the format has none

    @property
    def is_marked(self) -> NDArray[np.bool_]:
        """(N,), which points are not to be used, as the file marks them."""
        marks = [points for points, _ in self.marked]
        return np.any(marks, axis=0) if marks else np.zeros(len(self.points), bool)


@dataclass(frozen=True, kw_only=True, eq=False)
class CloudParts:
    """What is known of a file before its points are read."""

    parts: Iterator[CloudPart]  # to go through once
    work: int  # of all parts: points or bytes
    metres_per_unit: float | None = None  # as the file states it
    up_axis: str | None = None  # as the file states it: X, Y or Z with + or -
    is_survey: bool = False  # of a format that is in metres and has Z up where it states nothing else
    color_levels: tuple[float, ...] = (255.0,)  # the highest colour may be one of these, in rising order
    is_single: bool = False  # coordinates are float32
    remarks: tuple[Remark, ...] = ()
