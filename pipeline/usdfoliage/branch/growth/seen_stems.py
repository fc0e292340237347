"""How thick a plant that grows is where it grows along stems that a cloud shows: as these, and not by allometry."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.distances import sample_axes
from usdfoliage.branch.growth.node_tree import NodeTree
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.fairing import fair_branches

_AMID = 0.8  # of a stem's radius, within which a node is on its axis
_BEGINS = 6.0  # radii, that an axis follows a stem at least whose foot no node is in
_ALONG = 2.0  # radii, that an axis follows a stem at least; a lateral of the stem leaves it sooner
_SHORTEST = 1e-6  # of the waves, that the mean step of a skeleton is long at least
_EVEN = 0.1  # of the mean step of a skeleton, that a step counts as at least


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenStems:
    """Branches that a cloud shows."""

    skeleton: Skeleton
    min_m: float  # radius from which on they count


def thick_stems(skeleton: Skeleton, min_m: float) -> Skeleton | None:
    """The branches as far as they are so thick without a break from a root on; None where none is."""
    stays = np.zeros(len(skeleton.points_m), bool)
    for number in range(len(skeleton)):  # a parent comes before its children
        part = skeleton.branch(number)
        carried = skeleton.parent_curve[number] < 0 or stays[skeleton.parent_vertex[number]]
        stays[part] = carried & np.logical_and.accumulate(skeleton.radius_m[part] >= min_m)
    long_enough = np.add.reduceat(stays.astype(np.int64), skeleton.first) > 1
    if not long_enough.any():
        return None
    # What leaves a branch that is too short for a branch leaves with it.
    for child in np.flatnonzero(skeleton.parent_curve >= 0):
        long_enough[child] &= long_enough[skeleton.parent_curve[child]]
    kept = stays[long_enough[skeleton.curve]]
    return skeleton.only(long_enough).only_vertices(kept)


def fair_stems(skeleton: Skeleton, over_m: float) -> Skeleton:
    """The branches without the waves of noise in their axes; roots stay, and so does what leaves from what.

    Waves of the length over_m are half as high afterwards, those of half that length a seventeenth.
    """
    if over_m <= 0 or not len(skeleton):
        return skeleton
    step_m = np.linalg.norm(np.diff(skeleton.points_m, axis=0), axis=1)
    step_m[skeleton.first[1:] - 1] = np.nan  # from one branch to the next
    share_m: NDArray[np.float64] = np.nanmean([[np.nan, *step_m], [*step_m, np.nan]], axis=0)
    mean_m = float(np.nanmean(step_m))
    if not mean_m > _SHORTEST * over_m:  # all at one place
        return skeleton
    share = np.maximum(share_m / mean_m, _EVEN)  # of a branch's length, that is a vertex's
    weight = share.copy()
    weight[skeleton.first] = np.inf
    # As a smoothing spline, of which waves keep 1 / (1 + (2 pi scale / wavelength)^4).
    scale = over_m / (2 * np.pi * mean_m)
    unlimited = np.full(len(share), np.inf)
    return fair_branches(skeleton, weight, scale**4 / share**3, unlimited)


def take_seen_radii(tree: NodeTree, stems: SeenStems) -> NodeTree:
    """A tree that grew, where it goes from a root along thick stems as thick as these."""
    places_m, radii_m, _ = sample_axes(stems.skeleton, 0.5 * stems.min_m)
    thick = radii_m >= stems.min_m
    if not thick.any():
        return tree
    seen_m = np.zeros(len(tree))  # 0 where a node is in no stem
    size = np.ceil(np.log2(radii_m))
    for each in np.unique(size[thick])[::-1]:  # inside a thick stem a thin one is nothing
        some = thick & (size == each)
        away_m, near = cKDTree(places_m[some]).query(tree.position_m, workers=-1)
        radius_m = radii_m[some][near]
        is_in = (seen_m == 0) & (away_m <= np.maximum(_AMID * radius_m, stems.min_m))
        seen_m[is_in] = radius_m[is_in]
    amid = seen_m > 0
    nodes = RootedTree(tree.parent)
    step_m = step_lengths(tree.position_m, tree.parent)
    follows_m = np.zeros(len(tree))
    for level in reversed(nodes.levels[1:]):
        own = level[amid[level]]
        np.maximum.at(follows_m, tree.parent[own], follows_m[own] + step_m[own])
    on_stem = tree.parent < 0  # a root stands on the bark or beside it
    for level in nodes.levels[1:]:
        own = level[amid[level]]
        springs = tree.axis[own] != tree.axis[tree.parent[own]]
        far = np.where(on_stem[tree.parent[own]], np.where(springs, _ALONG, 0.0), _BEGINS)
        on_stem[own[follows_m[own] >= far * seen_m[own]]] = True
    radius_m = np.where(on_stem & (tree.parent >= 0), seen_m, tree.radius_m)
    # Below a stem no part of a plant is thinner, and above it none is thicker.
    carried_m = np.where(on_stem & (tree.parent >= 0), seen_m, 0.0)
    for level in reversed(nodes.levels[1:]):
        np.maximum.at(carried_m, tree.parent[level], carried_m[level])
    lower = ~on_stem & (carried_m > 0)
    radius_m[lower] = carried_m[lower]
    for level in nodes.levels[1:]:
        radius_m[level] = np.minimum(radius_m[level], radius_m[tree.parent[level]])
    return replace(tree, radius_m=radius_m)
