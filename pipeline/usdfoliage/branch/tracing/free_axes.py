"""Stems that stand free: the branches that a noisy cloud of a herb shows clearly, where no branch is round. Our own.

An axis stands free where hardly anything is beside it, as a stem does below the leaves; an axis that was traced over
leaves, or through a hedge, has them on both sides.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.model import Skeleton
from usdfoliage.geometry.point_cells import cell_means, number_cells

_AT_ONCE = 4000  # places whose surroundings are in memory at once


@dataclass(frozen=True, kw_only=True)
class FreeAxisSettings:
    """When an axis stands free; lengths in heights of the cloud."""

    reach: float = 0.02  # distance from the axis up to which points are the axis' own
    beside: tuple[float, float] = (1.5, 3.0)  # distances in reaches between which points are of something else
    max_beside: float = 0.8  # points of something else for each of the axis' own, at most
    stem: float = 0.3  # smallest length of a stem,
    free: float = 0.25  # of which at least so much must stand free,
    rise: float = 0.2  # and over which it must rise, or hang, at least so far
    straight: float = 0.6  # distance from its root to where it last stands free, over the path: over leaves, axes wind
    max_hidden: float = 0.5  # share of the stems that need not stand free, at most
    twig: float = 0.04  # smallest length of another branch, half of which must stand free

    def __post_init__(self) -> None:
        if not (0 < self.reach < 1 and 1 <= self.beside[0] < self.beside[1] and self.max_beside > 0):
            raise ValueError(f"reach must be in (0, 1), beside rising from 1, max_beside above 0, not {self}")
        if not (0 <= self.rise <= self.free and 0 <= self.straight <= 1):
            raise ValueError(f"rise must be in [0, free], straight in [0, 1], not {self}")
        if not (0 < self.free <= self.stem and 0 <= self.max_hidden < 1 and self.twig >= 0):
            raise ValueError(f"free must be in (0, stem], max_hidden in [0, 1), twig not below 0, not {self}")


def stands_free(
    points_m: NDArray[np.float64],
    skeleton: Skeleton,
    settings: FreeAxisSettings = FreeAxisSettings(),
) -> NDArray[np.bool_]:
    """(V,) vertices of a skeleton at which its axis stands free in the cloud.

    Args:
        points_m: (N, 3), Y up.
        skeleton: Traced through it.
        settings: What stands free.
    """
    reach_m = settings.reach * float(np.ptp(points_m[:, 1]))
    free = np.zeros(len(skeleton.points_m), bool)
    if not reach_m > 0:
        return free
    # One point for a cell, so that a place with many points counts no more than one with few.
    cells_m = cell_means(points_m, number_cells(points_m, reach_m / 2))
    tree = cKDTree(cells_m)
    along = _directions(skeleton, reach_m)
    inner_m, outer_m = (reaches * reach_m for reaches in settings.beside)
    for start in range(0, len(free), _AT_ONCE):
        places = np.arange(start, min(start + _AT_ONCE, len(free)))
        reached_m = float(np.hypot(outer_m, reach_m))
        found = tree.query_ball_point(skeleton.points_m[places], reached_m)
        around: list[list[int]] = list(found)  # type: ignore[arg-type]  # its stubs know of one place alone
        place = np.repeat(np.arange(len(places)), [len(each) for each in around])
        offset_m = cells_m[np.concatenate([np.array(each, np.int64) for each in around])]
        offset_m -= skeleton.points_m[places][place]
        on_m = (offset_m * along[places][place]).sum(axis=1)
        away_m = np.sqrt(np.maximum((offset_m**2).sum(axis=1) - on_m**2, 0))
        slab = np.abs(on_m) < reach_m / 2
        own = np.bincount(place[slab & (away_m < reach_m)], minlength=len(places))
        other = np.bincount(place[slab & (away_m > inner_m) & (away_m < outer_m)], minlength=len(places))
        free[places] = (own > 0) & (other < settings.max_beside * own)
    return free


def keep_free_branches(
    points_m: NDArray[np.float64],
    skeleton: Skeleton,
    settings: FreeAxisSettings = FreeAxisSettings(),
) -> Skeleton | None:
    """The stems that stand free, up to where they last do, and what stands free on them; None where most do not.

    Args:
        points_m: (N, 3), Y up.
        skeleton: Traced through it.
        settings: What stands free.
    """
    height_m = float(np.ptp(points_m[:, 1]))
    stems = skeleton.up_to_order(0)
    of_stems = stands_free(points_m, stems, settings)
    long = stems.lengths_m >= settings.stem * height_m
    standing = long & (_free_lengths(stems, of_stems) >= settings.free * height_m)
    standing &= _free_rises(stems, of_stems) >= settings.rise * height_m
    standing &= _straightness(stems, _last_free(stems, of_stems)) >= settings.straight
    if not standing.any() or standing.sum() < (1 - settings.max_hidden) * long.sum():
        return None
    free = stands_free(points_m, skeleton, settings)
    kept = (_free_lengths(skeleton, free) >= 0.5 * skeleton.lengths_m) & (
        skeleton.lengths_m >= settings.twig * height_m
    )
    kept[np.flatnonzero(skeleton.order == 0)] = standing
    last = _last_free(skeleton, free)
    for branch, (parent, vertex) in enumerate(
        zip(skeleton.parent_curve.tolist(), skeleton.parent_vertex.tolist(), strict=True)
    ):
        if parent >= 0:
            kept[branch] &= kept[parent] and vertex <= last[parent]
    reached = np.arange(len(skeleton.points_m)) <= last[skeleton.curve]
    return skeleton.only(kept).only_vertices(reached[kept[skeleton.curve]])


def points_of_branches(points_m: NDArray[np.float64], skeleton: Skeleton, within_m: float) -> NDArray[np.bool_]:
    """(N,) which points (N, 3) lie on branches, or so near them."""
    steps = np.flatnonzero(np.diff(skeleton.curve) == 0)
    start_m, end_m = skeleton.points_m[steps], skeleton.points_m[steps + 1]
    apart_m = np.maximum(within_m, 0.5 * skeleton.radius_m[steps])
    count = np.maximum(np.ceil(np.linalg.norm(end_m - start_m, axis=1) / apart_m), 1).astype(np.int64)
    step = np.repeat(np.arange(len(steps)), count)
    share = (np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[step]
    axis_m = start_m[step] + share[:, None] * (end_m - start_m)[step]
    away_m, nearest = cKDTree(axis_m).query(points_m)
    return np.asarray(away_m <= skeleton.radius_m[steps[step]][nearest] + within_m)


def _free_lengths(skeleton: Skeleton, free: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(B,) how much of each branch stands free."""
    return _sum_free(skeleton, free, np.linalg.norm(np.diff(skeleton.points_m, axis=0), axis=1))


def _free_rises(skeleton: Skeleton, free: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(B,) the height that each branch goes through where it stands free."""
    return _sum_free(skeleton, free, np.abs(np.diff(skeleton.points_m[:, 1])))


def _sum_free(skeleton: Skeleton, free: NDArray[np.bool_], steps_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(B,) of the steps from each vertex to the next (V - 1,), of which both ends are free and of one branch."""
    both = free[:-1] & free[1:] & (np.diff(skeleton.curve) == 0)
    return np.asarray(np.add.reduceat(np.append(steps_m * both, 0.0), skeleton.first))


def _last_free(skeleton: Skeleton, free: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(B,) the last vertex of each branch that stands free, but never its first: two vertices are a branch."""
    last = np.maximum.reduceat(np.where(free, np.arange(len(free)), -1), skeleton.first)
    return np.asarray(np.maximum(last, skeleton.first + 1))


def _straightness(skeleton: Skeleton, last: NDArray[np.int64]) -> NDArray[np.float64]:
    """(B,) how far the vertex `last` of each branch is from its first, over the length of the path there."""
    apart_m = np.linalg.norm(skeleton.points_m[last] - skeleton.points_m[skeleton.first], axis=1)
    return np.asarray(apart_m / np.maximum(skeleton.arcs_m[last], 1e-12))


def _directions(skeleton: Skeleton, reach_m: float) -> NDArray[np.float64]:
    """(V, 3) of the axes, each between the places so far before and behind along its branch."""
    directions = np.empty_like(skeleton.points_m)
    for branch in range(len(skeleton)):
        own = skeleton.branch(branch)
        path_m, axis_m = skeleton.arcs_m[own], skeleton.points_m[own]
        ends_m = [
            np.column_stack([np.interp(path_m + sign * reach_m, path_m, axis_m[:, k]) for k in range(3)])
            for sign in (-1, 1)
        ]
        directions[own] = ends_m[1] - ends_m[0]
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(directions / np.where(length > 0, length, 1))
