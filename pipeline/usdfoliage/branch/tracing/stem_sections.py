"""Circles through the points around an axis: how thick a branch is, and where its middle is, as far as points show."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.tracing.axes import Axes
from usdfoliage.geometry.directions import two_across

_CHUNK = 2_000_000  # points of windows looked at at once
_SECTORS = 12  # of a circle, for how much of it is seen
_TURNS = 8  # of reweighting
_FLAT = 1e-6  # of the spread of the points: a window whose points lie on a line has no circle


@dataclass(frozen=True, kw_only=True)
class StemSectionSettings:
    """Which points a circle is fitted to."""

    window_m: float  # along the axis, to both sides
    min_points: int = 12

    def __post_init__(self) -> None:
        if not self.window_m > 0 or self.min_points < 3:
            raise ValueError(f"window_m must be above 0 and min_points at least 3, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class StemSections:
    """A circle a node across its axis; NaN where there is none."""

    radius_m: NDArray[np.float64]  # (S,)
    offset_m: NDArray[np.float64]  # (S, 3), from the node to the middle
    away_m: NDArray[np.float64]  # (S,), mean distance of the points from the circle, those far from it counting less
    seen: NDArray[np.float64]  # (S,), share of the circle that has points
    points: NDArray[np.int64]  # (S,)
    apart_m: NDArray[np.float64]  # (S,), distance between the points on the branch's surface, if it were one

    def take(self, chosen: NDArray[np.generic]) -> "StemSections":
        """Those of these nodes, by number or mask."""
        return StemSections(**{each.name: getattr(self, each.name)[chosen] for each in fields(self)})

    spread_m: NDArray[np.float64]  # (S,), root mean square distance of the points from their mean


def fit_stem_sections(
    points_m: NDArray[np.float64],
    section: NDArray[np.int32],
    center_m: NDArray[np.float64],
    axes: Axes,
    settings: StemSectionSettings,
) -> StemSections:
    """Fit a circle to the points around each node, projected along its axis; far points lose their weight in turns.

    Args:
        points_m: (N, 3).
        section: (N,), node that each point belongs to.
        center_m: (S, 3), fair nodes.
        axes: Chains of nodes.
        settings: How far along.

    Source:
        N. Chernov, Circular and Linear Regression, 2010, section 5.1, with Cauchy weights.
    """
    count = len(center_m)
    radius_m, away_m, spread_m, apart_m = (np.full(count, np.nan) for _ in range(4))
    offset_m, seen, used = np.zeros((count, 3)), np.zeros(count), np.zeros(count, np.int64)
    entries = np.flatnonzero(axes.own)
    nodes = axes.nodes[entries]
    # Points in the order of the chains, so that a window of nodes is a run of points.
    place = np.full(count, -1, np.int64)
    place[nodes] = np.arange(len(nodes))
    at = place[section]
    ordered = np.flatnonzero(at >= 0)
    ordered = ordered[np.argsort(at[ordered], kind="stable")]
    begin = np.searchsorted(at[ordered], np.arange(len(nodes) + 1))
    low, high, direction, length_m = _windows(center_m, axes, entries, settings.window_m)
    runs = begin[high] - begin[low]
    usable = np.flatnonzero((runs >= settings.min_points) & (np.linalg.norm(direction, axis=1) > 0))
    ends = np.cumsum(runs[usable])
    for part in np.split(usable, np.searchsorted(ends, np.arange(_CHUNK, int(ends[-1]) if len(ends) else 0, _CHUNK))):
        if not len(part):
            continue
        runs_here = runs[part]
        window = np.repeat(np.arange(len(part)), runs_here)
        within = np.arange(len(window)) - np.repeat(np.cumsum(runs_here) - runs_here, runs_here)
        chosen = ordered[np.repeat(begin[low[part]], runs_here) + within]
        side, other = two_across(direction[part])
        from_node = points_m[chosen] - center_m[nodes[part]][window]
        x = np.einsum("nc,nc->n", from_node, side[window])
        y = np.einsum("nc,nc->n", from_node, other[window])
        fit = _fit_circles(x, y, window, len(part))
        to = nodes[part]
        radius_m[to], away_m[to], spread_m[to], seen[to] = fit.radius, fit.away, fit.spread, fit.seen
        offset_m[to] = fit.x[:, None] * side + fit.y[:, None] * other
        used[to] = runs_here
        area_m2 = 2 * np.pi * fit.radius * fit.seen * np.minimum(2 * settings.window_m, length_m[part])
        apart_m[to] = np.sqrt(area_m2 / runs_here)
    offset_m[~np.isfinite(radius_m)] = 0
    return StemSections(
        radius_m=radius_m,
        offset_m=offset_m,
        away_m=away_m,
        seen=seen,
        points=used,
        spread_m=spread_m,
        apart_m=apart_m,
    )


def _windows(
    center_m: NDArray[np.float64], axes: Axes, entries: NDArray[np.int64], window_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """For each own entry the run of own entries around it, from low up to high, the axis' direction and its length."""
    path_m = axes.lengths_along(center_m)
    axis_of = axes.axis_of
    # Axes far apart on one line, so that one search serves all.
    apart_m = float(path_m.max(initial=0)) + 4 * window_m + 1
    line_m = path_m[entries] + axis_of[entries] * apart_m
    numbers = np.arange(len(entries))
    first, last = (
        np.searchsorted(axis_of[entries], axis_of[entries]),
        np.searchsorted(axis_of[entries], axis_of[entries], side="right"),
    )
    low = np.minimum(np.searchsorted(line_m, line_m - window_m), numbers - 1)
    high = np.maximum(np.searchsorted(line_m, line_m + window_m, side="right"), numbers + 2)
    low, high = np.maximum(low, first), np.minimum(high, last)
    # The direction may lean on the parent's node, which is no window's own.
    from_entry = np.maximum(entries[low] - (low == first), axes.first[:-1][axis_of[entries]])
    to_entry = entries[high - 1]
    along_m = center_m[axes.nodes[to_entry]] - center_m[axes.nodes[from_entry]]
    length_m = np.linalg.norm(along_m, axis=1, keepdims=True)
    direction = np.divide(along_m, length_m, out=np.zeros_like(along_m), where=length_m > 1e-9)
    return low, high, direction, length_m[:, 0]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Circles:
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    radius: NDArray[np.float64]
    away: NDArray[np.float64]
    spread: NDArray[np.float64]
    seen: NDArray[np.float64]


def _fit_circles(x: NDArray[np.float64], y: NDArray[np.float64], window: NDArray[np.int64], count: int) -> _Circles:
    """A circle for the points (P,) of each window (P,), numbered below count."""

    def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.bincount(window, values, count), np.float64)

    size = np.bincount(window, minlength=count).astype(np.float64)
    mean_x, mean_y = total(x) / size, total(y) / size
    u, v = x - mean_x[window], y - mean_y[window]  # far from the origin the normal equations lose digits
    square = u * u + v * v
    spread = np.sqrt(total(square) / size)
    weight = np.ones(len(u))
    middle_u, middle_v = np.zeros(count), np.zeros(count)
    radius, away = np.full(count, np.nan), np.full(count, np.nan)
    for _ in range(_TURNS):
        w = total(weight)
        wu, wv, ws = weight * u, weight * v, weight * square
        su, sv, ss = total(wu) / w, total(wv) / w, total(ws) / w
        uu, vv, uv = total(wu * u) / w - su * su, total(wv * v) / w - sv * sv, total(wu * v) / w - su * sv
        us, vs = total(ws * u) / w - su * ss, total(ws * v) / w - sv * ss
        determinant = uu * vv - uv * uv
        good = determinant > (_FLAT * spread**2) ** 2
        safe = np.where(good, determinant, 1)
        middle_u, middle_v = 0.5 * (us * vv - vs * uv) / safe, 0.5 * (vs * uu - us * uv) / safe
        squared = ss + middle_u**2 + middle_v**2 - 2 * (middle_u * su + middle_v * sv)
        radius = np.where(good, np.sqrt(np.maximum(squared, 0)), np.nan)
        off = np.abs(np.hypot(u - middle_u[window], v - middle_v[window]) - radius[window])
        away = total(weight * off) / w
        scale = 1.5 * away + 1e-9
        weight = 1 / (1 + np.square(off / scale[window]))
        weight[~np.isfinite(weight)] = 1
    turn = np.arctan2(v - middle_v[window], u - middle_u[window])
    sector = np.minimum(((turn + np.pi) * (_SECTORS / (2 * np.pi))).astype(np.int64), _SECTORS - 1)
    # What is far from the circle is not the branch's, and shows nothing of it.
    near = np.abs(np.hypot(u - middle_u[window], v - middle_v[window]) - radius[window]) < 3 * away[window] + 1e-9
    filled = np.bincount((window * _SECTORS + sector)[near], minlength=count * _SECTORS).reshape(count, _SECTORS) > 0
    return _Circles(
        x=middle_u + mean_x,
        y=middle_v + mean_y,
        radius=radius,
        away=away,
        spread=spread,
        seen=filled.mean(axis=1),
    )
