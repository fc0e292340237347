"""Points that come part after part, kept as they are until they are too many, then one for each cell of a grid."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_FIRST_CELLS = 1 << 16  # across the points that there are when thinning begins: finer than any scan needs
_MIN_EXTENT = 1e-3  # in units: what is smaller is one point; and cells of one 1e11 units away still have numbers
_GROWTH = 2.0**0.25  # of the cells, the least
_SMALLER = 3  # such steps in a doubling, without the last
_TAILS = 0.002  # share of the points on each side that do not count for the size: outliers
_MIXERS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)  # odd, of random bits


class ThinnedPoints(NamedTuple):
    """What is left of the points."""

    points: NDArray[np.float64]  # (N, 3)
    colors: NDArray[np.float32] | None  # (N, 3)
    cell: float  # side of the cells, in the unit of the points; 0 when none was left out for being too close
    duplicates: int  # points left out because another one has their place; not counted where there are cells


@dataclass(eq=False)
class _Cells:
    """Sums over the points of each cell, in the order of the cells' keys."""

    keys: NDArray[np.int64]  # (C,)
    count: NDArray[np.float64]  # (C,)
    sums: list[NDArray[np.float64]]  # 3 or 7 of (C,): coordinates from the origin, colours, and points that have one

    def __len__(self) -> int:
        return len(self.keys)


class PointThinner:
    """Takes points and gives back max_points at most; in memory are never more than some three times as many.

    Points that are not too many come back as they are, in their order, but for exact duplicates. Others become the mean
    of all points in their cell, in the order of numbers that depend on the cells alone; their colour is the mean of
    those that are not black, which is no colour. The cells grow with what comes, by steps of a fifth at least; means so
    far then count with the weight of their points. The same parts give the same bytes. Our own; cells as in
    O. Teschner et al., Optimized spatial hashing for collision detection, 2003: a key may be that of two cells, but not
    once in a million clouds.
    """

    def __init__(self, max_points: int) -> None:
        if max_points < 1:
            raise ValueError(f"max_points must be at least 1, not {max_points}")
        self._max_points = max_points
        self._parts: list[tuple[NDArray[np.float64], NDArray[np.float32] | None]] = []
        self._count = 0  # of the points kept as they are
        self._pending: list[_Cells] = []
        self._origin = np.zeros(3)
        self._cell = 0.0

    def add(self, points: NDArray[np.float64], colors: NDArray[np.float32] | None) -> None:
        """Take more points.

        Args:
            points: (N, 3) float, finite.
            colors: (N, 3) float, black where a point has none, or None for all points of the cloud.
        """
        if not len(points):
            return
        if self._cell == 0:
            self._parts.append((points, colors))
            self._count += len(points)
            if self._count > self._max_points:
                self._begin()
            return
        self._pending.append(self._sum_points(points, colors))
        if sum(map(len, self._pending)) > 2 * self._max_points:
            self._shrink()

    def finish(self) -> ThinnedPoints:
        """What is left; nothing can be added afterwards."""
        if self._cell == 0:
            return self._finish_parts()
        self._shrink()
        cells = self._pending.pop()
        points = np.column_stack([line / cells.count for line in cells.sums[:3]]) + self._origin
        colors = None
        if len(cells.sums) > 3:
            colored = np.maximum(cells.sums[6], 1)
            colors = np.column_stack([(line / colored).astype(np.float32) for line in cells.sums[3:6]])
        return ThinnedPoints(points, colors, self._cell, 0)

    def _finish_parts(self) -> ThinnedPoints:
        if not self._parts:
            return ThinnedPoints(np.zeros((0, 3)), None, 0.0, 0)
        points = np.concatenate([part for part, _ in self._parts])
        colors = None
        if self._parts[0][1] is not None:
            colors = np.concatenate([part for _, part in self._parts if part is not None])
        self._parts.clear()
        first = _first_of_each(points)
        duplicates = len(points) - int(np.count_nonzero(first))
        if duplicates:
            points, colors = points[first], None if colors is None else colors[first]
        return ThinnedPoints(points, colors, 0.0, duplicates)

    def _begin(self) -> None:
        """From points as they are to cells."""
        parts, self._parts = self._parts, []
        self._origin = parts[0][0][0].copy()  # far from it sums would lose digits
        sample = np.concatenate([points[:: max(1, len(points) // 10_000)] for points, _ in parts])
        extent = float(np.max(np.diff(np.quantile(sample, [_TAILS, 1 - _TAILS], axis=0), axis=0)))
        farthest = max(float(np.abs(points - self._origin).max()) for points, _ in parts)
        self._cell = max(extent, farthest * 1e-9, _MIN_EXTENT) / _FIRST_CELLS
        while parts:
            self._pending.append(self._sum_points(*parts.pop(0)))
        self._shrink()

    def _sum_points(self, points: NDArray[np.float64], colors: NDArray[np.float32] | None) -> _Cells:
        lines = [points[:, axis] - self._origin[axis] for axis in range(3)]
        if colors is not None:
            lines += [colors[:, channel].astype(np.float64) for channel in range(3)]
            lines.append(np.asarray(colors.any(axis=1), np.float64))
        return _sum_up(_number_cells(lines[:3], self._cell), np.ones(len(points)), lines)

    def _shrink(self) -> None:
        """Make all cells one set, and the cells so large that there are not too many."""
        middles = [np.concatenate([part.sums[axis] / part.count for part in self._pending]) for axis in range(3)]
        if _count_cells(middles, self._cell) > self._max_points:
            self._cell = self._grown(middles)
        del middles
        if len(self._pending) > 1 or len(self._pending[0]) > self._max_points:
            self._pending = [self._join(self._pending)]

    def _grown(self, middles: list[NDArray[np.float64]]) -> float:
        """The side of cells that are not too many: by doubling, then as much less as can be."""
        cell = 2 * self._cell
        while _count_cells(middles, cell) > self._max_points:
            cell *= 2
        for _ in range(_SMALLER):
            if _count_cells(middles, cell / _GROWTH) > self._max_points:
                break
            cell /= _GROWTH
        return cell

    def _join(self, parts: list[_Cells]) -> _Cells:
        count = np.concatenate([part.count for part in parts])
        lines: list[NDArray[np.float64]] = []
        for _ in range(len(parts[0].sums)):
            lines.append(np.concatenate([part.sums.pop(0) for part in parts]))
        parts.clear()
        return _sum_up(_number_cells([line / count for line in lines[:3]], self._cell), count, lines)


def _number_cells(offsets: list[NDArray[np.float64]], cell: float) -> NDArray[np.int64]:
    """One number (N,) for the cell of each offset, three of (N,); no offset is the middle of a cell, however large."""
    keys = np.zeros(len(offsets[0]), np.uint64)
    for line, mixer in zip(offsets, _MIXERS, strict=True):
        # The bits of a product are mixed upwards only; the shift brings them down again.
        keys ^= np.floor(line / cell + 0.5).astype(np.int64).view(np.uint64)
        keys *= mixer
        keys ^= keys >> np.uint64(32)
    return keys.view(np.int64)


def _count_cells(offsets: list[NDArray[np.float64]], cell: float) -> int:
    keys = np.sort(_number_cells(offsets, cell))
    return 1 + int(np.count_nonzero(keys[1:] != keys[:-1]))


def _sum_up(keys: NDArray[np.int64], count: NDArray[np.float64], lines: list[NDArray[np.float64]]) -> _Cells:
    """The rows of each key as one; lines is emptied."""
    order = np.argsort(keys)  # not stable, four times as fast: rows are added in their own order all the same
    keys = keys[order]
    is_first = np.concatenate([[True], keys[1:] != keys[:-1]])
    cell_of = np.empty(len(keys), np.int64)
    cell_of[order] = np.cumsum(is_first) - 1
    keys = keys[is_first]
    lines.append(count)
    sums = []
    while lines:
        sums.append(np.asarray(np.bincount(cell_of, lines.pop(0), len(keys)), np.float64))
    return _Cells(keys, sums.pop(), sums)


def _first_of_each(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """True (N,) for points (N, 3) but those whose place an earlier one has."""
    keys = np.zeros(len(points), np.uint64)
    for axis, mixer in enumerate(_MIXERS):
        keys ^= (points[:, axis] + 0.0).view(np.uint64)  # -0 is 0
        keys *= mixer
        keys ^= keys >> np.uint64(32)
    order = np.argsort(keys, kind="stable")
    again = np.flatnonzero(keys[order][1:] == keys[order][:-1])
    same = (points[order[again + 1]] == points[order[again]]).all(axis=1)
    first = np.ones(len(points), bool)
    first[order[again[same] + 1]] = False
    return first
