"""The skeleton of the places on stems that are kept, where leaves begin on it, and what lies apart. Our own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.photographs.join_settings import JoinSettings
from usdfoliage.branch.photographs.stem_points import StemPoints
from usdfoliage.branch.rooted_tree import RootedTree
from usdfoliage.branch.tracing.attachments import settle_attachments
from usdfoliage.branch.tracing.axes import find_axes
from usdfoliage.branch.tracing.fairing import fair_axes
from usdfoliage.branch.tracing.radii import Radii
from usdfoliage.branch.tracing.refinement import RefinementSettings, refine_branches
from usdfoliage.branch.tracing.sections import SectionTree
from usdfoliage.branch.tracing.traced_axes import TracedAxes, as_skeleton
from usdfoliage.geometry.point_cells import touching_parts

TOUCHING = 4.0  # footprints between places of one piece of a stem


@dataclass(frozen=True, kw_only=True, eq=False)
class StemPiece:
    """Places on a stem that hang together."""

    length_m: float  # from end to end
    middle_m: NDArray[np.float64]  # (3,)


@dataclass(frozen=True, kw_only=True, eq=False)
class JoinedStems:
    """A skeleton, and what it was made of."""

    skeleton: Skeleton
    joined: NDArray[np.bool_]  # (S,), places on stems that are on it
    leaf: NDArray[np.int64]  # (L,), vertex of the skeleton at which each leaf begins, -1 where none leads to it
    turned: NDArray[np.bool_]  # (L,), leaves of which what was taken for the apex is the base
    apart: tuple[StemPiece, ...]  # that look like stems and are not joined to the rest, the longest first


def make_skeleton(
    places_m: NDArray[np.float64],
    parent: NDArray[np.int32],
    kept: NDArray[np.bool_],
    stems: StemPoints,
    count: int,
    turned: NDArray[np.bool_],
    soil_m: float,
    height_m: float,
    settings: JoinSettings,
) -> JoinedStems:
    """The skeleton of the places that are kept, with its feet on the soil."""
    chosen = np.flatnonzero(kept)
    number = np.cumsum(kept) - 1
    own = parent[chosen]
    feet = np.flatnonzero(own < 0)
    feet_m = places_m[chosen[feet]].copy()
    feet_m[:, 1] = soil_m
    needs_foot = places_m[chosen[feet], 1] - soil_m > 1e-3 * height_m
    feet, feet_m = feet[needs_foot], feet_m[needs_foot]
    center_m = np.concatenate([places_m[chosen], feet_m])
    parents = np.concatenate([np.where(own < 0, -1, number[np.maximum(own, 0)]), np.full(len(feet), -1)]).astype(
        np.int32
    )
    parents[feet] = len(chosen) + np.arange(len(feet))
    is_base = np.concatenate([chosen >= count, np.zeros(len(feet), bool)])
    axes = find_axes(center_m, parents, settings.twig * height_m)
    weight = np.ones(len(center_m))
    fixed = is_base.copy()
    fixed[len(chosen) :] = True
    weight[fixed] = 1e6
    fair_m = fair_axes(center_m, axes, weight, settings.stiffness, 3 * stems.footprint_m)
    radius_m = _fair_radii(parents, chosen, stems, count)
    sections = SectionTree(
        center_m=center_m,
        points=np.ones(len(center_m), np.int32),
        parent=parents,
        section=np.arange(len(center_m), dtype=np.int32),
    )
    radii = Radii(radius_m=radius_m, believed=~is_base, exponent=0.5, noise_m=stems.footprint_m)
    traced = TracedAxes(
        sections=sections, axes=axes, center_m=fair_m, parent=axes.parent_node(len(center_m)), radii=radii
    )
    skeleton = as_skeleton(traced)
    refinement = RefinementSettings()
    skeleton = refine_branches(settle_attachments(skeleton), settings.twig * height_m, settings=refinement)
    joined = np.zeros(count, bool)
    joined[chosen[chosen < count]] = True
    leaf = np.full(len(places_m) - count, -1, np.int64)
    at = chosen[chosen >= count]
    if len(at) and len(skeleton):
        away_m, nearest = (np.asarray(each) for each in cKDTree(skeleton.points_m).query(places_m[at]))
        near = away_m < 0.02 * height_m
        leaf[at[near] - count] = nearest[near]
    apart = _find_apart(stems, joined, settings.twig * height_m, skeleton)
    return JoinedStems(skeleton=skeleton, joined=joined, leaf=leaf, turned=turned, apart=apart)


def _find_apart(
    stems: StemPoints, joined: NDArray[np.bool_], min_m: float, skeleton: Skeleton
) -> tuple[StemPiece, ...]:
    """Pieces that are rather stems than not, as long as a twig, and beside the skeleton."""
    left = stems.take(~joined & (stems.odds > 0))
    if not len(left):
        return ()
    reach_m = TOUCHING * stems.footprint_m
    piece = touching_parts(left.points_m, reach_m)
    away_m = np.asarray(cKDTree(skeleton.points_m).query(left.points_m)[0])
    found = []
    for number in range(int(piece.max()) + 1):
        own_m = left.points_m[piece == number]
        length_m = float(np.linalg.norm(np.ptp(own_m, axis=0)))
        if length_m >= min_m and np.median(away_m[piece == number]) > min_m:
            found.append(StemPiece(length_m=length_m, middle_m=own_m.mean(axis=0)))
    return tuple(sorted(found, key=lambda each: -each.length_m))


def _fair_radii(
    parents: NDArray[np.int32], chosen: NDArray[np.int64], stems: StemPoints, count: int
) -> NDArray[np.float64]:
    """(N,) radii that change slowly along stems and never grow outwards; what was not measured is as its neighbours."""
    nodes = len(parents)
    known = np.flatnonzero(chosen < count)
    log_radius, weight = np.zeros(nodes), np.zeros(nodes)
    log_radius[known] = np.log(stems.radius_m[chosen[known]])
    weight[known] = np.exp(np.clip(stems.odds[chosen[known]], -3, 2))
    tree = RootedTree(parents)
    middle = float(np.average(log_radius[known], weights=weight[known])) if len(known) else np.log(stems.footprint_m)
    for _ in range(40):  # of spreading along links: as far as 40 places
        total, mass = log_radius * weight, weight.copy()
        up = np.flatnonzero(parents >= 0)
        for to, source in ((up, parents[up]), (parents[up], up)):
            np.add.at(total, to, 0.5 * log_radius[source] * np.minimum(weight[source], 1))
            np.add.at(mass, to, 0.5 * np.minimum(weight[source], 1))
        spread = np.where(mass > 0, total / np.where(mass > 0, mass, 1), middle)
        weight = np.where(weight > 0, weight, np.minimum(mass, 0.5))
        log_radius = spread
    lower, upper = log_radius.copy(), log_radius.copy()
    for level in tree.levels[1:]:
        lower[level] = np.minimum(lower[level], lower[tree.parent[level]])
    for level in reversed(tree.levels[1:]):
        np.maximum.at(upper, tree.parent[level], upper[level])
    return np.exp(0.5 * (lower + upper))
