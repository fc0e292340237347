"""Feet of stems that stand higher than the lowest ones of a cloud: those of trees up a slope.

A foot is where the cloud begins from below: nothing stands under it or beside it. So do the tips of hanging twigs, and
limbs of which the lower part was not seen; but these are not round and upright for a while, thicken upwards, or hang
higher above the nearest foot than any ground rises to there.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label

from usdfoliage.branch.tracing.axes import Axes
from usdfoliage.branch.tracing.ground import STEEPEST
from usdfoliage.branch.tracing.stem_sections import StemSectionSettings, fit_stem_sections
from usdfoliage.geometry.point_cells import cell_means

_SLICES = 4  # of the foot of a stem, in each of which it is looked at
_ALL = np.ones((3, 3), bool)


@dataclass(frozen=True, kw_only=True)
class HigherFootSettings:
    """What is the foot of a stem; lengths in heights of the cloud."""

    foot: float = 0.08  # length of the stem that must be there
    highest: float = 0.75  # that a foot may stand
    radius: tuple[float, float] = (0.002, 0.06)
    beside: int = 2  # cells, in which nothing may begin lower
    around: int = 3  # cells, whose points are looked at with those of the foot
    seen: float = 0.5  # share of a circle that has points: half of it from one place
    max_away: float = 0.15  # of the radius, mean distance of points from a circle
    max_apart: float = 0.5  # of the radius, distance between its points
    thickening: float = 1.1  # upwards, from the first circle to the last
    upright: float = 0.8  # height of the foot of its length
    off: float = 0.04  # that points of a stem are from its root, to the side
    above: tuple[float, float] = (0.02, 0.04)  # its root, where a stem is looked for in both: below it are weeds

    def __post_init__(self) -> None:
        if not (0 < self.foot < 1 and 0 < self.highest <= 1 and 0 < self.radius[0] < self.radius[1]):
            raise ValueError(f"foot and highest must be shares of the height, radius rising, not {self}")
        if not (self.beside >= 1 and self.around >= 0 and 0 < self.seen <= 1 and 0 < self.upright <= 1):
            raise ValueError(f"beside must be at least 1, around not below 0, seen and upright shares, not {self}")
        if not (self.max_away > 0 and self.max_apart > 0 and self.thickening > 0 and self.off > 0):
            raise ValueError(f"max_away, max_apart, thickening and off must be above 0, not {self}")


def find_higher_feet(
    points_m: NDArray[np.float64],
    cell_m: float,
    lower_m: NDArray[np.float64],
    settings: HigherFootSettings = HigherFootSettings(),
) -> NDArray[np.bool_]:
    """(N,) points of feet of stems that stand higher than others.

    Args:
        points_m: (N, 3), Y up, or above the ground where this is known.
        cell_m: Side of the cells of the plane in which the cloud is looked at, slice by slice.
        lower_m: (R, 3), feet that are known: from one of them a ground must be able to rise to each other.
        settings: What is a foot.
    """
    feet = np.zeros(len(points_m), bool)
    height_m = float(np.ptp(points_m[:, 1]))
    if not (height_m > 0 and len(lower_m)):
        return feet
    foot_m = settings.foot * height_m
    cell = np.floor((points_m[:, [0, 2]] - points_m[:, [0, 2]].min(axis=0)) / cell_m).astype(np.int64) + 1
    for begins in _beginnings(points_m, cell, foot_m / _SLICES, settings):
        own = cell[begins]
        base_m = points_m[begins][points_m[begins, 1].argmin()]
        middle_m = points_m[begins].mean(axis=0)
        away_m = np.linalg.norm(lower_m[:, [0, 2]] - middle_m[[0, 2]], axis=1)
        if not (base_m[1] - lower_m[:, 1] <= STEEPEST * away_m).any():
            continue
        wide = (np.ptp(own, axis=0) + 1) * cell_m
        if wide.max() > 2 * settings.radius[1] * height_m + 2 * cell_m:
            continue
        around = (cell >= own.min(axis=0) - settings.around).all(axis=1)
        around &= (cell <= own.max(axis=0) + settings.around).all(axis=1)
        around &= (points_m[:, 1] >= base_m[1]) & (points_m[:, 1] <= base_m[1] + foot_m)
        if _is_stem(points_m[around], height_m, settings):
            feet |= around
            lower_m = np.concatenate([lower_m, [[middle_m[0], base_m[1], middle_m[2]]]])
    return feet


def stands_on_stem(
    points_m: NDArray[np.float64], root_m: NDArray[np.float64], settings: HigherFootSettings = HigherFootSettings()
) -> bool:
    """Whether the points above a root (3,) are all around something upright, as they are not in a hedge.

    Args:
        points_m: (N, 3), Y up.
        root_m: (3,).
        settings: What is a stem.
    """
    height_m = float(np.ptp(points_m[:, 1]))
    away_m = np.hypot(*(points_m - root_m)[:, [0, 2]].T)
    for above in settings.above:
        over_m = points_m[:, 1] - root_m[1] - above * height_m
        slab = (over_m >= 0) & (over_m < settings.foot * height_m)
        near = [slab & (away_m < share * settings.off * height_m) for share in (0.5, 1.0)]
        if not any(own.any() and _is_stem(points_m[own], height_m, settings) for own in near):
            return False
    return True


def _beginnings(
    points_m: NDArray[np.float64], cell: NDArray[np.int64], slice_m: float, settings: HigherFootSettings
) -> Iterator[NDArray[np.int64]]:
    """Numbers of points of each cluster of a slice that has none of a lower slice under it or beside it, upwards."""
    number = np.floor((points_m[:, 1] - points_m[:, 1].min()) / slice_m).astype(np.int64)
    order = np.argsort(number, kind="stable")
    begin = np.searchsorted(number[order], np.arange(int(number.max()) + 2))
    shape = tuple(cell.max(axis=0) + 2)
    seen = np.zeros(shape, bool)
    seen[tuple(cell[order[: begin[1]]].T)] = True
    for level in range(1, min(len(begin) - 1, int(settings.highest / settings.foot * _SLICES))):
        chosen = order[begin[level] : begin[level + 1]]
        if not len(chosen):
            continue
        taken = np.zeros(shape, bool)
        taken[tuple(cell[chosen].T)] = True
        clusters, count = label(binary_dilation(taken, _ALL), _ALL)
        below = binary_dilation(seen, _ALL, iterations=settings.beside)
        new = np.ones(count + 1, bool)
        new[np.unique(clusters[below])] = False
        new[0] = False
        of = clusters[tuple(cell[chosen].T)]
        for cluster in np.flatnonzero(new).tolist():
            yield chosen[of == cluster]
        seen |= taken


def _is_stem(points_m: NDArray[np.float64], height_m: float, settings: HigherFootSettings) -> bool:
    """Whether points (N, 3) are all around something upright that does not thicken upwards."""
    slice_m = settings.foot * height_m / _SLICES
    section = np.floor((points_m[:, 1] - points_m[:, 1].min()) / slice_m).astype(np.int32)
    section = np.minimum(section, _SLICES - 1)
    if len(np.unique(section)) < _SLICES:
        return False
    center_m = cell_means(points_m, section)
    along_m = center_m[-1] - center_m[0]
    if along_m[1] < settings.upright * np.linalg.norm(along_m):
        return False
    axis = Axes(nodes=np.arange(_SLICES), first=np.array([0, _SLICES]), parent=np.array([-1]))
    circles = fit_stem_sections(points_m, section, center_m, axis, StemSectionSettings(window_m=0.6 * slice_m))
    radius_m, (thinnest, thickest) = circles.radius_m, settings.radius
    with np.errstate(invalid="ignore"):
        is_round = (circles.seen >= settings.seen) & (circles.away_m < settings.max_away * radius_m)
        is_round &= circles.apart_m < settings.max_apart * radius_m
        is_round &= (radius_m >= thinnest * height_m) & (radius_m <= thickest * height_m)
    if is_round.sum() < _SLICES - 1:  # the lowest is cut aslant on a slope
        return False
    return bool(radius_m[is_round][-1] <= settings.thickening * radius_m[is_round][0])
