"""The ground below a scan: which points of a cloud without classes lie on it.

A simple morphological filter: in the lowest points of square cells, openings with ever wider windows take off what
stands on the ground, where a step from one window to the next is higher than ground would be. Here the openings are of
heights above a smooth trend of the lowest points, so that slopes and borders of a scan keep their ground.

Source: T. Pingel, K. Clarke, W. McBride, An improved simple morphological filter for the terrain classification of
airborne LIDAR data, ISPRS Journal 77, 2013, sections 3.1 to 3.3; steps between windows as K. Zhang et al., A
progressive morphological filter for removing nonground measurements, IEEE TGRS 41, 2003, equation 6; weights of the
trend as K. Kraus, N. Pfeifer, Determination of terrain models in wooded areas, ISPRS Journal 53, 1998, equation 1. That
the trend comes first, and how low outliers are found, is our own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from usdfoliage.errors import FitError
from usdfoliage.forest.ground_frame import GroundFrame
from usdfoliage.forest.ground_growth import grow_ground
from usdfoliage.forest.ground_points import fill_linearly
from usdfoliage.forest.ground_settings import GroundFilterSettings

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_MAX_CELLS = 25_000_000  # cells become larger where there would be more
_FEWEST = 25  # cells with points
_THIN = 1.0  # least deviation of the ground from a line in plan, in cells
_NEAREST = 12  # lowest points of blocks that decide the trend in one place
_HALF_WEIGHT = 0.1  # sides of a block above the trend, where a lowest point has half its weight
_BLOCKS = (1.0, 0.5, 0.25, 0.25)  # sides of blocks, in the widest object; from the second on of the ground alone
_STEEP = 0.5  # of the trend's slope, that is allowed to the ground besides
_ROUNDS = 4  # of weighing
_STIFF = np.array([1e-9, 1e-4, 1e-4, 1e-2, 1e-2, 1e-2])  # of constant, slopes and curvatures, for points on a line
_STRIP = 20_000  # places of the trend that are fitted together
_MARGIN = 3  # places of the trend beyond the cells, for its spline
_FEW = 4  # cells that lie as low: fewer are outliers
_LOW_REACH_M, _LOW_DEPTH_M = 8.0, 2.0  # of outliers below all points, by crowns and ground between them
_PIT_REACH_M, _PIT_DEPTH_M = 5.0, 0.5  # of those below the ground that was found


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundSurface:
    """The ground that was found, by cells."""

    frame: GroundFrame  # of the cells, metres
    heights_m: Floats  # (rows, columns) at the middles of cells, everywhere
    is_ground: Mask  # (rows, columns) which cells have a point of the ground


def find_ground_surface(lows_m: Floats, settings: GroundFilterSettings = GroundFilterSettings()) -> GroundSurface:
    """Find the ground below the lowest points of a scan.

    The same points give the same surface, in whatever order they are.

    Args:
        lows_m: (N, 3) easting, northing and height in metres: the lowest point of each small square, or all points.
        settings: What is taken off.

    Raises:
        ValueError: lows_m is not (N, 3), or not finite.
        FitError: Too few cells have a point, or the points of the ground lie on a line.
    """
    if lows_m.ndim != 2 or lows_m.shape[1] != 3:
        raise ValueError(f"lows_m must be (N, 3), not {lows_m.shape}")
    if not np.isfinite(lows_m).all():
        raise ValueError("lows_m must be finite")
    if not len(lows_m):
        raise FitError("there are no points")
    frame = _frame_cells(lows_m, settings.cell_m)
    cells, lows_m = _lowest_of_cells(lows_m, frame)
    if len(cells) < _FEWEST:
        raise FitError(f"squares of {frame.cell:.3g} m with points: {len(cells):,}, and {_FEWEST} needed")
    shape = frame.rows, frame.columns

    def laid(values: Floats) -> Floats:
        """(rows, columns) values of the cells with points, NaN elsewhere."""
        grid = np.full(shape[0] * shape[1], np.nan)
        grid[cells] = values
        return grid.reshape(shape)

    inside = ~_are_low(laid(lows_m[:, 2]), _LOW_REACH_M / frame.cell, _LOW_DEPTH_M).reshape(-1)[cells]
    ground = inside
    places = np.stack([laid(values) for values in (lows_m[:, :2] / frame.cell).T], axis=-1)
    trend, above = np.zeros(shape), np.zeros(shape)
    for part in _BLOCKS:
        trend, at_lows = _fit_trend(lows_m[ground], lows_m, frame, part * settings.widest_object_m)
        above = laid(np.where(inside, lows_m[:, 2] - at_lows, np.nan))
        slope = settings.slope + _STEEP * np.hypot(*np.gradient(trend, frame.cell))
        stands_out = _stands_out(above, settings.step_m + slope * frame.cell, settings.widest_object_m / frame.cell)
        above, taken = np.where(stands_out, np.nan, above), np.where(stands_out, above, np.nan)
        above = grow_ground(above, taken, places, settings.step_m + settings.slope * frame.cell)
        pits = _are_low(above, _PIT_REACH_M / frame.cell, _PIT_DEPTH_M)
        above[pits] = np.nan
        inside &= ~pits.reshape(-1)[cells]
        ground = np.isfinite(above.reshape(-1)[cells])
    is_ground = np.isfinite(above)
    _check_spread(frame, is_ground)
    return GroundSurface(frame=frame, heights_m=trend + _fill(above), is_ground=is_ground)


def are_on_ground(surface: GroundSurface, points_m: Floats, near_m: float) -> Mask:
    """(N,) which points (N, 3) in metres are so near to the surface, at right angles to it."""
    down, across = np.gradient(surface.heights_m, surface.frame.cell)
    tilt = np.sqrt(1 + down**2 + across**2)
    column, row = surface.frame.to_middles(points_m[:, :2]).T
    ground_m, of_tilt = (
        ndimage.map_coordinates(values, [row, column], order=1, mode="nearest") for values in (surface.heights_m, tilt)
    )
    return np.asarray(np.abs(points_m[:, 2] - ground_m) <= near_m * of_tilt)


def _frame_cells(lows_m: Floats, cell_m: float) -> GroundFrame:
    low, high = lows_m[:, :2].min(axis=0), lows_m[:, :2].max(axis=0)
    cell_m = max(cell_m, float(np.sqrt(np.prod(high - low) / _MAX_CELLS)), float((high - low).max()) / _MAX_CELLS)
    columns, rows = np.maximum(np.ceil((high - low) / cell_m), 1).astype(np.int64).tolist()
    return GroundFrame(low=low + cell_m / 2, cell=cell_m, columns=columns, rows=rows)


def _lowest_of_cells(lows_m: Floats, frame: GroundFrame) -> tuple[NDArray[np.int64], Floats]:
    """Numbers (C,) of the cells with points, in order, and the lowest point (C, 3) of each."""
    size = np.array([frame.columns, frame.rows])
    column, row = np.clip(np.floor(frame.to_middles(lows_m[:, :2]) + 0.5), 0, size - 1).astype(np.int64).T
    cell = row * frame.columns + column
    lowest_m = np.full(frame.rows * frame.columns, np.inf)
    np.minimum.at(lowest_m, cell, lows_m[:, 2])
    chosen = np.flatnonzero(lows_m[:, 2] == lowest_m[cell])
    order = chosen[np.lexsort((lows_m[chosen, 1], lows_m[chosen, 0], cell[chosen]))]
    cells, first = np.unique(cell[order], return_index=True)
    return cells, lows_m[order[first]]


def _are_low(heights_m: Floats, reach: float, depth_m: float) -> Mask:
    """(H, W) which cells lie so deep below nearly all within reach, in cells, that hardly another is as low.

    Crowns have gaps, through which a few points reach the ground: these are no outliers, as others are as low.
    """
    size = max(2, int(reach))
    low = np.zeros(heights_m.shape, bool)
    padded = np.pad(heights_m, size, constant_values=np.nan)
    width = padded.shape[1]
    flat = padded.reshape(-1)
    active = np.flatnonzero(np.isfinite(flat))
    as_low = np.zeros(len(active), np.int64)
    higher = np.zeros(len(active), np.int64)
    y, x = np.mgrid[-size : size + 1, -size : size + 1].reshape(2, -1)
    away = np.hypot(x, y)
    for number in np.lexsort((x, y, away))[1:].tolist():
        if away[number] > size or not len(active):
            break
        other = flat[active + y[number] * width + x[number]]
        is_low = other <= flat[active] + depth_m
        as_low += is_low
        higher += np.isfinite(other) & ~is_low
        left = as_low < _FEW
        active, as_low, higher = active[left], as_low[left], higher[left]
    row, column = np.divmod(active[higher >= 2 * _FEW], width)
    low[row - size, column - size] = True
    return low


def _fit_trend(seeds_m: Floats, lows_m: Floats, frame: GroundFrame, block_m: float) -> tuple[Floats, Floats]:
    """The trend at the middles of cells (rows, columns), and at places (C, 3): a smooth surface low in the points.

    In each place it is the quadratic through the lowest points of the blocks around, those of crowns weighing less.
    """
    block = np.floor((seeds_m[:, :2] - frame.low) / block_m).astype(np.int64)
    order = np.lexsort((seeds_m[:, 1], seeds_m[:, 0], seeds_m[:, 2], block[:, 0], block[:, 1]))
    first = np.unique(block[order], axis=0, return_index=True)[1]
    lowest_m = seeds_m[order[first]]
    pitch_m = block_m / 2
    counts = np.ceil(np.array([frame.columns, frame.rows]) * frame.cell / pitch_m).astype(np.int64) + 2 * _MARGIN + 1
    start_m = frame.low - _MARGIN * pitch_m
    north, east = np.mgrid[: counts[1], : counts[0]]
    places_m = start_m + pitch_m * np.stack([east, north], axis=-1).reshape(-1, 2)
    values = np.concatenate(
        [_fit_quadratics(lowest_m, places_m[at : at + _STRIP], block_m) for at in range(0, len(places_m), _STRIP)]
    ).reshape(counts[1], counts[0])
    values = ndimage.spline_filter(values, order=3)

    def at(plan_m: Floats) -> Floats:
        column, row = ((plan_m - start_m) / pitch_m).T
        return np.asarray(ndimage.map_coordinates(values, [row, column], order=3, mode="nearest", prefilter=False))

    trend = np.empty((frame.rows, frame.columns))
    for row in range(frame.rows):
        plan_m = np.column_stack([np.arange(frame.columns), np.full(frame.columns, frame.rows - 1 - row)])
        trend[row] = at(frame.low + frame.cell * plan_m)
    return trend, at(lows_m[:, :2])


def _fit_quadratics(lowest_m: Floats, places_m: Floats, block_m: float) -> Floats:
    """(K,) at places (K, 2), by the nearest of points (S, 3)."""
    count = min(_NEAREST, len(lowest_m))
    found = cKDTree(lowest_m[:, :2]).query(places_m, k=list(range(1, count + 1)))
    away_m, near = (np.asarray(each) for each in found)
    x, y = np.moveaxis((lowest_m[near, :2] - places_m[:, None]) / block_m, -1, 0)
    floor_m = lowest_m[near, 2].mean(axis=1, keepdims=True)
    z = lowest_m[near, 2] - floor_m
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    reach = np.maximum(away_m[:, -1:] / 3, 0.6 * block_m)  # far from all points these still weigh something
    by_distance = np.exp(-((away_m / reach) ** 2) / 2)
    fitted = np.zeros((len(places_m), 6))
    weight = by_distance
    for _ in range(_ROUNDS):
        weighed = terms * weight[..., None]
        normal = np.swapaxes(weighed, 1, 2) @ terms
        scale = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        right = np.swapaxes(weighed, 1, 2) @ z[..., None]
        fitted = np.linalg.solve(normal + scale * np.diag(_STIFF), right)[..., 0]
        above = z - (terms @ fitted[..., None])[..., 0]
        weight = by_distance / (1 + (np.maximum(above, 0) / (_HALF_WEIGHT * block_m)) ** 4)
    return np.asarray(fitted[:, 0] + floor_m[:, 0])


def _stands_out(above_m: Floats, allowed_m: Floats, widest: float) -> Mask:
    """(H, W) which cells an opening lowers by more than is allowed (H, W), from one window to the next.

    Windows are up to as wide as the widest object, in cells.
    """
    surface = np.where(np.isnan(above_m), np.inf, above_m)
    known = np.isfinite(surface)
    out = np.zeros(surface.shape, bool)
    for half in range(1, int(np.ceil(widest / 2)) + 1):
        size = 2 * half + 1
        eroded = ndimage.minimum_filter(surface, size, mode="constant", cval=np.inf)
        eroded[np.isinf(eroded)] = -np.inf  # of a window without points nothing is known
        opened = ndimage.maximum_filter(eroded, size, mode="constant", cval=-np.inf)
        out[known] |= surface[known] - opened[known] > allowed_m[known]
        surface[known] = opened[known]
    return out


def _check_spread(frame: GroundFrame, is_ground: Mask) -> None:
    """Refuse ground on a line: the foot of a wall."""
    row, column = np.nonzero(is_ground)
    if len(row) < _FEWEST:
        raise FitError(f"squares of {frame.cell:.3g} m with ground: {len(row):,}, and {_FEWEST} needed")
    deviation = float(np.sqrt(max(np.linalg.eigvalsh(np.cov(np.stack([row, column])))[0], 0)))
    if deviation < _THIN:
        raise FitError("the lowest points lie on a line, as those of a wall do")


def _fill(above_m: Floats) -> Floats:
    """(H, W) heights with gaps filled linearly along rows and columns, and beyond these with the nearest."""
    filled = fill_linearly(above_m, np.isnan(above_m))
    gaps = np.isnan(filled)
    if gaps.any():
        nearest = ndimage.distance_transform_edt(gaps, return_distances=False, return_indices=True)
        filled = filled[tuple(nearest)]
    return filled
