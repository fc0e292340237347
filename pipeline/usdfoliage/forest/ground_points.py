"""The heights of a ground cloud, at the middles of pixels, and how large pixels are to be.

Source: our own.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial import cKDTree

from usdfoliage.forest.ground_frame import GroundFrame

Floats = NDArray[np.float64]

_WINDOWS = 5  # along a side, that the spacing is measured in
_IN_WINDOW = 2_000  # points, where they are evenly dense
_MAX_IN_WINDOW = 200_000
_FEWEST_IN_WINDOW = 30
_COVERED = 0.9  # of the pixels that lie among points: these hold one
_FINEST = 1 / 300  # of a window's side
_GROWTH = 1.06  # from one size that is tried to the next
_STRIP_PX = 1 << 20  # that are looked at together
_WIDER = 2  # pixels around one that its slope is taken of, where those next to it are too few
_NARROW = 2  # gaps of up to twice as many pixels are filled in any case
_ROUNDING = 1e-5  # of a pixel
_FLAT = 0.05  # least spread of neighbours, in pixels to the fourth, for a slope between them


class SpacingSample:
    """The points of a cloud in some windows, collected part by part, to measure their spacing."""

    def __init__(self, low: Floats, high: Floats, count: int) -> None:
        """Windows over a rectangle.

        Args:
            low: (2,) least easting and northing of the points.
            high: (2,) greatest.
            count: How many points there are.
        """
        self._low, self._sides, self._count = low, np.maximum(high - low, 1e-12), count
        windows = 1 if count <= _WINDOWS**2 * _IN_WINDOW else _WINDOWS
        self._pitch = self._sides / windows
        half = np.sqrt(_IN_WINDOW * np.prod(self._sides) / max(count, 1)) / 2
        self._half = self._pitch / 2 if windows == 1 else np.minimum(half, self._pitch / 2)
        self._windows = windows
        self._found: list[list[Floats]] = [[] for _ in range(windows**2)]
        self._numbers = np.zeros(windows**2, np.int64)

    def add(self, places: Floats) -> None:
        """Take what lies in a window of places (N, 2)."""
        cell = np.clip(np.floor((places - self._low) / self._pitch), 0, self._windows - 1).astype(np.int64)
        middle = self._low + (cell + 0.5) * self._pitch
        inside = (np.abs(places - middle) <= self._half * (1 + 1e-9)).all(axis=1)
        number = cell[inside, 0] * self._windows + cell[inside, 1]
        chosen = places[inside]
        for each in np.unique(number).tolist():
            room = _MAX_IN_WINDOW - int(self._numbers[each])
            own = chosen[number == each][: max(room, 0)]
            self._numbers[each] += len(own)
            self._found[each].append(own)

    def spacing(self) -> float:
        """The side of a pixel such that nearly all hold a point: the median of the windows, to three digits."""
        windows = [np.concatenate(parts) for parts in self._found if parts]
        cells = [spacing_of_points(window) for window in windows if len(window) >= _FEWEST_IN_WINDOW]
        cells = [cell for cell in cells if cell > 0]
        cell = float(np.median(cells)) if cells else float(np.sqrt(np.prod(self._sides) / max(self._count, 1)))
        return float(f"{cell:.3g}")


def spacing_of_points(places: Floats) -> float:
    """The smallest side of squares of which nearly all that lie among places (N, 2) hold one; 0 of a single place.

    Squares lie among places where no gap is wider than six times their mean distance. Of a grid that runs along the
    axes it is the grid's own spacing.
    """
    places = np.unique(places, axis=0)
    low, sides = places.min(axis=0), places.max(axis=0) - places.min(axis=0)
    if len(places) < 2 or not sides.max() > 0:
        return 0.0
    mean = float(np.sqrt(max(np.prod(sides), (sides.max() / len(places)) ** 2) / len(places)))
    nearest = float(np.median(np.asarray(cKDTree(places).query(places, k=2)[0])[:, 1]))
    cell = max(nearest, float(sides.max()) * _FINEST)
    while cell < sides.max():
        reach = int(np.ceil(3 * mean / cell))
        column, row = np.floor((places - low) / cell + 0.5).astype(np.int64).T
        covered = np.zeros((int(row.max()) + 1, int(column.max()) + 1), bool)
        covered[row, column] = True
        if covered.sum() >= _COVERED * close_gaps(covered, reach).sum():
            break
        cell *= _GROWTH
    return cell


def close_gaps(covered: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """(H, W) what is covered, and gaps in it into which no square of 2 x reach + 1 pixels fits."""
    if reach < 1:
        return covered
    padded = np.pad(covered.astype(np.uint8), reach)
    wide = maximum_filter(padded, 2 * reach + 1, mode="constant", cval=0)
    closed = minimum_filter(wide, 2 * reach + 1, mode="constant", cval=0)
    return np.asarray(closed[reach:-reach, reach:-reach] > 0)


def point_heights(parts: Iterable[Floats], frame: GroundFrame, max_gap: float) -> Floats:
    """(rows, columns) the height of the points in each pixel, at its middle; NaN in gaps that are too wide.

    Height and place are the means of the points in a pixel. From there to the middle the height follows the slope
    between the neighbours, so that a plane keeps its heights wherever its points lie. Gaps are filled linearly along
    rows and columns.

    Args:
        parts: Of the cloud, each (N, 3) easting, northing and height in the unit of the frame.
        frame: Of the pixels; points beside them are left out.
        max_gap: The widest gap that is filled, in the same unit.
    """
    shape = frame.rows, frame.columns
    size = frame.rows * frame.columns
    count = np.zeros(size, np.int32)
    east, south = np.zeros(size, np.float32), np.zeros(size, np.float32)  # from the middle of the pixel, in pixels
    height = np.zeros(size)
    for points in parts:
        inside, cell, offset = _to_pixels(points, frame)
        np.add.at(count, cell, 1)
        np.add.at(height, cell, points[inside, 2])
        np.add.at(east, cell, offset[:, 0].astype(np.float32))
        np.add.at(south, cell, offset[:, 1].astype(np.float32))
    covered = count > 0
    number = np.maximum(count, 1)
    height = np.where(covered, height / number, np.nan).reshape(shape)
    offsets = np.stack([east / number, south / number], axis=-1, dtype=np.float32).reshape(*shape, 2)
    height = _at_middles(height, offsets)
    reach = min(max(_NARROW, int(max_gap / frame.cell / 2)), max(shape))  # no gap is wider than the raster
    gaps = close_gaps(covered.reshape(shape), reach) & ~covered.reshape(shape)
    return fill_linearly(height, gaps)


def lowest_points(parts: Iterable[Floats], frame: GroundFrame) -> Floats:
    """(P, 3) the lowest point of each pixel that has one, by row and column; parts and frame as above."""
    size = frame.rows * frame.columns
    height = np.full(size, np.inf)
    plan = np.zeros((size, 2))
    for points in parts:
        inside, cell, _ = _to_pixels(points, frame)
        chosen = points[inside]
        before = height.copy()
        np.minimum.at(height, cell, chosen[:, 2])
        lowest = chosen[:, 2] == height[cell]
        cell, chosen = cell[lowest], chosen[lowest]
        order = np.lexsort((chosen[:, 1], chosen[:, 0], cell))  # of some that are as low, one in any order of points
        cell, first = np.unique(cell[order], return_index=True)
        chosen = chosen[order[first], :2]
        is_before = (chosen[:, 0] < plan[cell, 0]) | ((chosen[:, 0] == plan[cell, 0]) & (chosen[:, 1] < plan[cell, 1]))
        lower = (height[cell] < before[cell]) | is_before
        plan[cell[lower]] = chosen[lower]
    covered = np.isfinite(height)
    return np.column_stack([plan[covered], height[covered]])


def highest_heights(parts: Iterable[Floats], frame: GroundFrame) -> Floats:
    """(rows, columns) the height of the highest point of each pixel, NaN without one; parts and frame as above."""
    height = np.full(frame.rows * frame.columns, -np.inf)
    for points in parts:
        inside, cell, _ = _to_pixels(points, frame)
        np.maximum.at(height, cell, points[inside, 2])
    return np.where(np.isfinite(height), height, np.nan).reshape(frame.rows, frame.columns)


def _to_pixels(points: Floats, frame: GroundFrame) -> tuple[NDArray[np.bool_], NDArray[np.int64], Floats]:
    """(N,) which points (N, 3) lie in the frame, numbers (I,) of their pixels, and where (I, 2) they lie in these."""
    middle = frame.to_middles(points[:, :2])
    size_px = np.array([frame.columns, frame.rows])
    inside = np.asarray((np.abs(middle + 0.5 - size_px / 2) <= size_px / 2 + _ROUNDING).all(axis=1))
    middle = middle[inside]
    pixel = np.clip(np.floor(middle + 0.5), 0, size_px - 1)
    return inside, (pixel[:, 1] * frame.columns + pixel[:, 0]).astype(np.int64), middle - pixel


def _at_middles(height: Floats, offset: NDArray[np.floating]) -> Floats:
    """(H, W) heights at the middles of pixels, from heights (H, W) at offsets (H, W, 2) from them, in strips."""
    rows, columns = height.shape
    step = max(1, _STRIP_PX // columns)
    moved = np.empty_like(height)
    for start in range(0, rows, step):
        stop = min(start + step, rows)
        first, last = max(start - _WIDER, 0), min(stop + _WIDER, rows)
        own = slice(start - first, start - first + stop - start)
        moved[start:stop] = _strip_at_middles(height[first:last], offset[first:last].astype(np.float64))[own]
    return moved


def _strip_at_middles(height: Floats, offset: Floats) -> Floats:
    """The same of one strip: by the slope of the pixels next to each, or of more where these are few."""
    slope = _slopes(height, offset, 1)
    few = np.isnan(slope[..., 0]) & np.isfinite(height)
    if few.any():
        slope[few] = _slopes(height, offset, _WIDER)[few]
    return np.asarray(height - (np.nan_to_num(slope) * offset).sum(axis=-1))


def _slopes(height: Floats, offset: Floats, reach: int) -> Floats:
    """(H, W, 2) change by column and row of the plane of least squares through the pixels around; NaN of too few."""
    rows, columns = height.shape
    padded_height = np.pad(height, reach, constant_values=np.nan)
    padded_offset = np.pad(offset, ((reach, reach), (reach, reach), (0, 0)))
    sums = np.zeros((9, rows, columns))  # of 1, x, y, z, xx, xy, yy, xz, yz
    for down in range(2 * reach + 1):
        for across in range(2 * reach + 1):
            window = slice(down, down + rows), slice(across, across + columns)
            z = padded_height[window] - height
            covered = np.isfinite(z)
            z = np.where(covered, z, 0.0)
            x, y = np.moveaxis(padded_offset[window] - offset + [across - reach, down - reach], -1, 0) * covered
            for place, value in enumerate((covered, x, y, z, x * x, x * y, y * y, x * z, y * z)):
                sums[place] += value
    number = np.maximum(sums[0], 1)
    xx, xy, yy = sums[4] - sums[1] ** 2 / number, sums[5] - sums[1] * sums[2] / number, sums[6] - sums[2] ** 2 / number
    xz, yz = sums[7] - sums[1] * sums[3] / number, sums[8] - sums[2] * sums[3] / number
    spread = xx * yy - xy**2
    is_wide = spread > _FLAT
    divisor = np.where(is_wide, spread, 1.0)
    by_column, by_row = (xz * yy - yz * xy) / divisor, (yz * xx - xz * xy) / divisor
    return np.where(is_wide[..., None], np.stack([by_column, by_row], axis=-1), np.nan)


def fill_linearly(height: Floats, gaps: NDArray[np.bool_]) -> Floats:
    """(H, W) heights with those in gaps (H, W) between the nearest known ones of the row and of the column."""
    row, column = np.nonzero(gaps)
    total, weight = np.zeros(len(row)), np.zeros(len(row))
    for values, line, place in ((height, row, column), (height.T, column, row)):
        own_total, own_weight = _between(values, line, place)
        total += own_total
        weight += own_weight
    filled = height.copy()
    filled[row, column] = np.where(weight > 0, total / np.where(weight > 0, weight, 1), np.nan)
    return filled


def _between(values: Floats, line: NDArray[np.int64], place: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """(N,) sums for places on lines: the height between the known ones before and behind, by the inverse gap; and that.

    Args:
        values: (L, P), NaN where nothing is known.
        line: (N,) of which line each place is.
        place: (N,) on it.
    """
    total, weight = np.zeros(len(line)), np.zeros(len(line))
    lines, length = values.shape
    step = max(1, _STRIP_PX // length)
    order = np.argsort(line, kind="stable")
    bounds = np.searchsorted(line[order], np.arange(0, lines + step, step))
    number = np.arange(length)
    for strip, (first, last) in enumerate(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)):
        if first == last:
            continue
        own = order[first:last]
        part = values[strip * step : (strip + 1) * step]
        known = np.isfinite(part)
        before = np.maximum.accumulate(np.where(known, number, -1), axis=1)
        behind = np.minimum.accumulate(np.where(known, number, length)[:, ::-1], axis=1)[:, ::-1]
        at = line[own] - strip * step, place[own]
        low, high = before[at], behind[at]
        both = (low >= 0) & (high < length)
        low_height, high_height = part[at[0], np.maximum(low, 0)], part[at[0], np.minimum(high, length - 1)]
        gap = np.where(both, high - low, 1)
        height = low_height + (high_height - low_height) * (place[own] - low) / gap
        total[own] = np.where(both, height / gap, 0)
        weight[own] = np.where(both, 1 / gap, 0)
    return total, weight
