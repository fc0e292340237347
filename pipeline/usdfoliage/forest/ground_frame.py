"""The pixels that the heights of a ground mesh or a ground cloud are laid into."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.forest.raster_files import MAX_PIXELS
from usdfoliage.remarks import Argument

Floats = NDArray[np.float64]
_ROUNDING = 1e-6  # of a pixel
_OF_LAST = 0.25  # of a pixel: a last column or row is there where points go so far into it


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundFrame:
    """Square pixels, the first row in the north; the middle of the south-western one is at the lowest point."""

    low: Floats  # (2,), easting and northing of the middle of the south-western pixel, in the unit of the file
    cell: float  # side of a pixel, in the same unit
    columns: int
    rows: int

    @property
    def ground_from_pixel(self) -> Floats:
        """(2, 3) as a Raster has it, in the unit of the file."""
        west, south = self.low - self.cell / 2
        return np.array([[self.cell, 0, west], [0, -self.cell, south + self.rows * self.cell]])

    def to_middles(self, places: Floats) -> Floats:
        """(N, 2) column and row of places (N, 2), whole numbers at the middles of pixels."""
        offset = (places - self.low) / self.cell
        return np.stack([offset[:, 0], self.rows - 1 - offset[:, 1]], axis=-1)


def frame_ground(low: Floats, high: Floats, cell: float, name: str, *, whole: bool) -> GroundFrame:
    """The pixels over a rectangle.

    Args:
        low: (2,) least easting and northing.
        high: (2,) greatest.
        cell: Side of a pixel, in the same unit.
        name: What it is to the user, with its file, for the error.
        whole: Whether pixels hold the whole rectangle but for a hair; else all their middles lie in it.

    Raises:
        CaptureError: There would be more pixels than a raster may have.
    """
    with np.errstate(over="ignore"):
        sides = (high - low) / cell
        counts = np.floor(sides + (_OF_LAST if whole else _ROUNDING)) + 1
        pixels = float(counts.prod())
    if not pixels <= MAX_PIXELS:
        width, height = high - low
        raise CaptureError(
            f"{name} is {width:,.6g} x {height:,.6g} units wide: that makes {counts[0]:,.0f} x {counts[1]:,.0f} "
            f"pixels, and {MAX_PIXELS:,} in all are allowed",
            ("remove what lies far away, or give a greater length to ", Argument(name="ground_spacing")),
        )
    columns, rows = counts.astype(np.int64).tolist()
    return GroundFrame(low=np.asarray(low, np.float64), cell=float(cell), columns=columns, rows=rows)
