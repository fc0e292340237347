"""Stages of the growth of branches that are known: what of them is there at a time, where, and how thick.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, figure 12. Times are planned
first (growth_times); radii follow from what each node carries (equation 5), times what was measured, and begin
with 0. The last stage is the plant as it was reconstructed.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.allometry import carried_lengths, min_carried
from usdfoliage.branch.axis_places import Places, places_at
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.motion.growth_times import GrowthStageSettings, GrowthTimes, plan_times
from usdfoliage.branch.motion.surface_places import cage_exits, cage_places
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths

_SAME = 1e-9  # of the longest way: lengths that differ by rounding
_UNBORN = 1e-4  # of its radius, that what is not there yet has: USD's widths are above 0


@dataclass(frozen=True, kw_only=True, eq=False)
class GrowthStages:
    """A skeleton, and how far it has grown at each of T times."""

    skeleton: Skeleton
    times: GrowthTimes
    at: NDArray[np.float64]  # (T,), shares of the time, 0 to 1
    thicken_share: float  # of the time
    exponent: float  # of the allometry

    def __len__(self) -> int:
        return len(self.at)

    @cached_property
    def tree(self) -> RootedTree:
        """Points as nodes; the first of a branch follows the one of its parent that it repeats."""
        parent = np.arange(-1, len(self.skeleton.points_m) - 1, dtype=np.int32)
        parent[self.skeleton.first] = self.skeleton.parent_vertex
        return RootedTree(parent)

    @cached_property
    def step_m(self) -> NDArray[np.float64]:
        """(V,) internode to each point."""
        return step_lengths(self.skeleton.points_m, self.tree.parent)

    @cached_property
    def carried_m(self) -> NDArray[np.float64]:
        """(V,) what each point carries at last."""
        return carried_lengths(self.tree, self.step_m, min_carried(self.step_m))

    def thickness(self, stage: int) -> NDArray[np.float64]:
        """(V,) radius over that of the reconstruction, by what each point carries (eq. 5), there or not: 0 to 1."""
        reach_m = self.times.reach(self.at[stage])[self.skeleton.curve]
        there_m = np.clip(reach_m - (self.times.path_m - self.step_m), 0, self.step_m)
        carried_m = carried_lengths(self.tree, there_m, min_carried(self.step_m))
        return np.asarray(np.minimum(carried_m / self.carried_m, 1) ** self.exponent)

    def birth(self, stage: int, curve: NDArray[np.integer], path_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(P,) what is left of a radius on these branches, this way from the root: nearly 0 at first, at last 1."""
        since = self.at[stage] - self.times.born(curve, path_m)
        return np.asarray(np.clip(since / self.thicken_share, _UNBORN, 1))


def plan_stages(
    skeleton: Skeleton, internode_m: float, count: int, settings: GrowthStageSettings = GrowthStageSettings()
) -> GrowthStages:
    """The times of the growth of a skeleton.

    Args:
        skeleton: As it is at last.
        internode_m: Length of an internode.
        count: T, of times, 2 or more.
        settings: How it grows.

    Raises:
        ValueError: The internode has no length, or there are fewer than two times.
    """
    if not 0 < internode_m < np.inf:
        raise ValueError(f"internode_m must be above 0, not {internode_m:g}")
    if count < 2:
        raise ValueError(f"growth takes 2 times or more, not {count}")
    return GrowthStages(
        skeleton=skeleton,
        times=plan_times(skeleton, internode_m, settings),
        at=np.linspace(0, 1, count),
        thicken_share=settings.thicken_share,
        exponent=settings.allometry.exponent,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tips:
    """Where B branches end at one time."""

    arc_m: NDArray[np.float64]  # (B,), along each, of those that have begun; a little more, for rounding
    holder: NDArray[np.int32]  # (B,), itself where it has begun, else the first below it that has


def _find_tips(stages: GrowthStages, stage: int, min_m: NDArray[np.float64]) -> _Tips:
    """Tips of branches, of which each that has begun is at least so long (B,)."""
    skeleton = stages.skeleton
    parent = skeleton.parent_curve
    grown_m = stages.times.reach(stages.at[stage]) - stages.times.base_m
    arc_m = np.clip(np.maximum(grown_m, min_m), 0, skeleton.lengths_m)
    arc_m += _SAME * stages.times.front.longest_m
    springs_m = np.where(parent >= 0, skeleton.arcs_m[skeleton.parent_vertex], 0.0)
    begun = (parent < 0) | (springs_m <= arc_m[parent])
    holder = np.arange(len(skeleton), dtype=np.int32)
    for number in np.flatnonzero(parent >= 0).tolist():  # parents first
        below = holder[parent[number]]
        holder[number] = number if begun[number] and below == parent[number] else below
    return _Tips(arc_m=arc_m, holder=holder)


def grow_skeleton(stages: GrowthStages, stage: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (V, 3) and radii (V,) at one time; what is not there yet lies on the growing tip that it will follow."""
    skeleton = stages.skeleton
    radius_m = skeleton.radius_m * stages.thickness(stage) * stages.birth(stage, skeleton.curve, stages.times.path_m)
    tips = _find_tips(stages, stage, np.zeros(len(skeleton)))
    holder = tips.holder[skeleton.curve]
    there = (holder == skeleton.curve) & (skeleton.arcs_m <= tips.arc_m[skeleton.curve])
    tip_m = places_at(skeleton, np.arange(len(skeleton)), tips.arc_m).between(skeleton.points_m)
    return np.where(there[:, None], skeleton.points_m, tip_m[holder]), radius_m


@dataclass(frozen=True, kw_only=True, eq=False)
class GrownSurface:
    """A surface whose points are carried by places on the axes of a skeleton that grows."""

    points_m: NDArray[np.float64]  # (P, 3), at last
    places: Places  # (P,)
    emerges_m: NDArray[np.float64]  # (B,), along each branch, where it comes out of the surface of its parent
    clear_m: NDArray[np.float64]  # (B,), along each branch, its first ring that is out


def carry_surface(cage: BranchCage, skeleton: Skeleton) -> GrownSurface:
    """Tie the points of a cage to the axes of its skeleton."""
    return carry_points(cage, skeleton, cage.points_m, cage_places(cage, skeleton))


def carry_points(cage: BranchCage, skeleton: Skeleton, points_m: NDArray[np.float64], places: Places) -> GrownSurface:
    """Tie points (P, 3) to places (P,) on the axes of the skeleton of a cage, whose forks they go with."""
    emerges_m = cage_exits(cage, skeleton).arc_m
    rings = cage_places(cage, skeleton)
    out = rings.arc_m > emerges_m[rings.curve]
    clear_m = np.full(len(skeleton), np.inf)
    np.minimum.at(clear_m, rings.curve[out], rings.arc_m[out])
    clear_m = np.where(np.isfinite(clear_m), clear_m, emerges_m)
    return GrownSurface(points_m=points_m, places=places, emerges_m=emerges_m, clear_m=clear_m)


def grow_surface(stages: GrowthStages, stage: int, surface: GrownSurface) -> NDArray[np.float64]:
    """(P, 3) points at one time: as far from their axis as it is thinner than at last, and never beyond its tip.

    A branch that has not begun ends where it will come out of its parent, which is closed there. What of it lies inside
    its parent goes inwards as that is thinner than at last.
    """
    skeleton, places = stages.skeleton, surface.places
    thickness = stages.thickness(stage)
    at_spring = np.maximum(skeleton.parent_vertex, 0)
    has_parent = skeleton.parent_curve >= 0
    parent_share = thickness[at_spring] * stages.birth(stage, skeleton.curve[at_spring], stages.times.path_m[at_spring])
    parent_share = np.where(has_parent, parent_share, 1.0)
    tips = _find_tips(stages, stage, np.where(has_parent, surface.emerges_m * parent_share, 0.0))
    inside = places.arc_m < surface.emerges_m[places.curve]
    arc_m = np.where(inside, parent_share[places.curve], 1.0) * places.arc_m
    holder = tips.holder[places.curve]
    there = (holder == places.curve) & (arc_m <= tips.arc_m[places.curve])
    axis_m = places.between(skeleton.points_m)
    at_m = axis_m.copy()
    goes_in_m = _inwards(skeleton, surface.clear_m, parent_share)
    moved = inside & ((parent_share[places.curve] < 1) | goes_in_m[places.curve].any(axis=1))
    at_m[moved] = places_at(skeleton, places.curve[moved], arc_m[moved]).between(skeleton.points_m)
    at_m[moved] += goes_in_m[places.curve[moved]]
    tip_m = places_at(skeleton, np.arange(len(skeleton)), tips.arc_m).between(skeleton.points_m)
    path_m = stages.times.base_m[places.curve] + places.arc_m
    share = places.between(thickness) * stages.birth(stage, places.curve, path_m)
    grown_m = np.where(there[:, None], at_m, tip_m[holder]) + share[:, None] * (surface.points_m - axis_m)
    whole = there & (share == 1) & ~moved
    return np.where(whole[:, None], surface.points_m, grown_m)


def _inwards(
    skeleton: Skeleton, clear_m: NDArray[np.float64], parent_share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(B, 3) how far the places go that branches spring from, where these lie before the parent's first ring."""
    springs_m = np.where(skeleton.parent_curve >= 0, skeleton.arcs_m[skeleton.parent_vertex], np.inf)
    goes_m = np.zeros((len(skeleton), 3))
    within = (skeleton.parent_curve >= 0) & (springs_m < clear_m[skeleton.parent_curve])
    for order in np.unique(skeleton.order[within]).tolist():  # parents first
        child = np.flatnonzero(within & (skeleton.order == order))
        parent = skeleton.parent_curve[child]
        place_m = places_at(skeleton, parent, parent_share[parent] ** 2 * springs_m[child]).between(skeleton.points_m)
        goes_m[child] = place_m - skeleton.points_m[skeleton.parent_vertex[child]] + goes_m[parent]
    return goes_m
