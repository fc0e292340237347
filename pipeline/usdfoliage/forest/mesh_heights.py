"""The heights of a ground mesh, at the middles of pixels.

Source: our own; the planes of triangles at the middles of pixels, row by row, as scan conversion does it.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from usdfoliage.forest.ground_frame import GroundFrame

Floats = NDArray[np.float64]
Triangles = NDArray[np.int64]

FEWEST_PX = 200  # along the longer side, as a mesh has heights between its points too
_INSIDE_PX = 1e-6  # so far beside a triangle a middle still lies on it: rounding opens no seams
_SPAN_STEP = 1 << 20  # rows of triangles that are looked at together
_PIXEL_STEP = 1 << 22


def spacing_of_mesh(points: Floats, triangles: Triangles) -> float:
    """The median length of the edges in plan, but at most the 200th part of the longer side.

    Args:
        points: (V, 3) easting, northing and height.
        triangles: (F, 3), at least one of which covers some ground.
    """
    plan = points[:, :2]
    lengths = np.linalg.norm(plan[triangles] - plan[np.roll(triangles, -1, axis=1)], axis=-1)
    used = plan[triangles[areas_in_plan(points, triangles) > 0]].reshape(-1, 2)
    longer = float((used.max(axis=0) - used.min(axis=0)).max())
    return min(float(np.median(lengths[lengths > 0])), longer / FEWEST_PX)


def areas_in_plan(points: Floats, triangles: Triangles) -> Floats:
    """(F,) how much ground triangles (F, 3) of points (V, 2 or more) cover."""
    a, b, c = (points[triangles[:, corner], :2] for corner in range(3))
    return np.abs(_cross(b - a, c - a)) / 2


def mesh_heights(points: Floats, triangles: Triangles, frame: GroundFrame) -> Floats:
    """(rows, columns) the highest of the triangles at the middle of each pixel, NaN beside all of them.

    Args:
        points: (V, 3) easting, northing and height, in the unit of the frame.
        triangles: (F, 3); those that stand upright cover no middle.
        frame: Of the pixels.
    """
    heights = np.full(frame.rows * frame.columns, -np.inf)
    plan = frame.to_middles(points[:, :2])
    for chosen, row in _rows_of(plan, triangles, frame.rows):
        corners = plan[triangles[chosen]]  # (N, 3, 2)
        west, east = _span(corners, row)
        first = np.maximum(np.ceil(west - _INSIDE_PX), 0)
        counts = np.maximum(np.minimum(np.floor(east + _INSIDE_PX), frame.columns - 1) - first + 1, 0).astype(np.int64)
        ends = points[triangles[chosen], 2]
        slopes, low, high = _planes(corners, ends), ends.min(axis=1), ends.max(axis=1)
        for some, at in _spread(counts, _PIXEL_STEP):
            column = first[some] + at
            own = corners[some, 0]
            height = (
                slopes[some, 0] + slopes[some, 1] * (column - own[:, 0]) + slopes[some, 2] * (row[some] - own[:, 1])
            )
            height = np.clip(height, low[some], high[some])  # a steep one, a hair beside it
            np.maximum.at(heights, row[some] * frame.columns + column.astype(np.int64), height)
    heights[np.isneginf(heights)] = np.nan
    return heights.reshape(frame.rows, frame.columns)


def _rows_of(plan: Floats, triangles: Triangles, rows: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Triangles that cover some ground, each with each row of middles that it meets, some at a time."""
    flat = np.flatnonzero(areas_in_plan(plan, triangles) > 0)
    across = plan[triangles[flat], 1]
    first = np.maximum(np.ceil(across.min(axis=1) - _INSIDE_PX), 0).astype(np.int64)
    last = np.minimum(np.floor(across.max(axis=1) + _INSIDE_PX), rows - 1).astype(np.int64)
    for some, at in _spread(np.maximum(last - first + 1, 0), _SPAN_STEP):
        yield flat[some], first[some] + at


def _spread(counts: NDArray[np.int64], step: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """The place of each count (N,) so many times, with 0, 1, … for each; at most step pairs at once."""
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    for start in range(0, total, step):
        pair = np.arange(start, min(start + step, total))
        own = np.searchsorted(ends, pair, side="right")
        yield own, pair - (ends[own] - counts[own])


def _span(corners: Floats, row: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """(N,) the least and the greatest column of triangles (N, 3, 2) on rows (N,), which they meet."""
    west, east = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for corner in range(3):
        a, b = corners[:, corner], corners[:, (corner + 1) % 3]
        low, high = np.minimum(a[:, 1], b[:, 1]), np.maximum(a[:, 1], b[:, 1])
        meets = (row >= low - _INSIDE_PX) & (row <= high + _INSIDE_PX)
        rise = b[:, 1] - a[:, 1]
        level = np.abs(rise) <= _INSIDE_PX  # an edge along the row: both its ends
        part = np.clip((row - a[:, 1]) / np.where(level, 1.0, rise), 0, 1)
        crossing = a[:, 0] + part * (b[:, 0] - a[:, 0])
        ends = np.stack([np.where(level, a[:, 0], crossing), np.where(level, b[:, 0], crossing)])
        west = np.where(meets, np.minimum(west, ends.min(axis=0)), west)
        east = np.where(meets, np.maximum(east, ends.max(axis=0)), east)
    return west, east


def _planes(corners: Floats, heights: Floats) -> Floats:
    """(N, 3) height at the first corner of triangles (N, 3, 2), and its change by column and by row."""
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    up_b, up_c = heights[:, 1] - heights[:, 0], heights[:, 2] - heights[:, 0]
    area = _cross(ab, ac)
    by_column = (up_b * ac[:, 1] - up_c * ab[:, 1]) / area
    by_row = (up_c * ab[:, 0] - up_b * ac[:, 0]) / area
    return np.stack([heights[:, 0], by_column, by_row], axis=-1)


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
