"""Ground that a filter took off, and that continues the ground around it: steep knolls and ridges.

Source: our own, of the idea of a surface that grows from ground that is known, as P. Axelsson, DEM generation from
laser scanner data using adaptive TIN models, IAPRS 33-B4, 2000.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_AROUND, _FEWEST_AROUND, _WIDE = 5, 6, 0.2  # cells of a plane: side, how many, and their least spread to the fourth


def grow_ground(ground_m: Floats, taken_m: Floats, places: Floats, near_m: float) -> Floats:
    """(H, W) heights of the ground with those of cells that were taken off, and yet continue the ground around.

    A knoll that is steep and narrow stands out as a house does. Its flanks continue the ground at their foot, cell by
    cell: each is near to the plane of the ground's cells around it, where a wall or a crown has a step.

    Args:
        ground_m: (H, W) heights above the trend, NaN where there is no ground.
        taken_m: (H, W) those that were taken off, NaN elsewhere.
        places: (H, W, 2) of the points, in cells.
        near_m: From the plane.
    """
    half = _AROUND // 2
    height_m, taken = (np.pad(each, half, constant_values=np.nan) for each in (ground_m, taken_m))
    width = height_m.shape[1]
    x, y = np.pad(places, ((half, half), (half, half), (0, 0))).reshape(-1, 2).T
    z, taken_z = height_m.reshape(-1), taken.reshape(-1)
    waiting = np.flatnonzero(np.isfinite(taken_z))
    slot = np.full(len(z), -1)
    slot[waiting] = np.arange(len(waiting))
    sums = np.zeros((9, len(waiting)))  # over the ground around, from each own place: of 1, x, y, z, xx, xy, yy, xz, yz
    steps = [row * width + column for row in range(-half, half + 1) for column in range(-half, half + 1)]

    def add(slots: NDArray[np.int64], cells: NDArray[np.int64]) -> None:
        """Add ground in cells (C,) to the sums of different slots (C,)."""
        east, south, up = x[cells] - x[waiting[slots]], y[cells] - y[waiting[slots]], z[cells]
        for total, value in zip(
            sums,
            (np.ones(len(cells)), east, south, up, east * east, east * south, south * south, east * up, south * up),
            strict=True,
        ):
            total[slots] += value

    for step in steps:
        slots = np.flatnonzero(np.isfinite(z[waiting + step]))
        add(slots, waiting[slots] + step)
    touched = np.arange(len(waiting))
    while len(touched):
        plane_m = _planes(sums[:, touched])
        grown = waiting[touched[np.abs(taken_z[waiting[touched]] - plane_m) <= near_m]]
        z[grown], slot[grown] = taken_z[grown], -1
        around = []
        for step in steps:
            slots = slot[grown + step]
            add(slots[slots >= 0], grown[slots >= 0])
            around.append(slots[slots >= 0])
        touched = np.unique(np.concatenate(around))
    return np.asarray(height_m[half:-half, half:-half])


def _planes(sums: Floats) -> Floats:
    """(C,) heights at the origins of sums (9, C) of the planes of least squares; NaN where points are too few."""
    number = np.maximum(sums[0], 1)
    x, y, z, xx, xy, yy, xz, yz = sums[1:] / number
    xx, xy, yy, xz, yz = xx - x * x, xy - x * y, yy - y * y, xz - x * z, yz - y * z
    divisor = xx * yy - xy * xy
    is_wide = (divisor > _WIDE) & (sums[0] >= _FEWEST_AROUND)
    divisor = np.where(is_wide, divisor, 1.0)
    plane_m = z - ((xz * yy - yz * xy) * x + (yz * xx - xz * xy) * y) / divisor
    return np.where(is_wide, plane_m, np.nan)
