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
from usdfoliage.branch.axis_places import Exits, Places, places_at
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.motion.growth_times import GrowthStageSettings, GrowthTimes, plan_times
from usdfoliage.branch.motion.surface_places import cage_exits, cage_places
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths

_SAME = 1e-9  # of the longest way: lengths that differ by rounding
_FORK = 2.0  # radii of a branch, that the fork of one that leaves it reaches along it
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
        ValueError: The internode or the skeleton has no length, or there are fewer than two times.
    """
    if not 0 < internode_m < np.inf:
        raise ValueError(f"internode_m must be above 0, not {internode_m:g}")
    if not skeleton.lengths_m.any():
        raise ValueError("a skeleton without length cannot grow")
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
    """A surface whose points are carried by places on the axes of a skeleton that grows.

    Round a fork its rings stand as far apart as the wood is thick. While that is thin they come as much nearer to the
    fork: else the faces between them would be spread like sails.
    """

    points_m: NDArray[np.float64]  # (P, 3), at last
    places: Places  # (P,)
    emerges_m: NDArray[np.float64]  # (B,), along each branch, where it comes out of the surface of its parent
    clear_m: NDArray[np.float64]  # (B,), along each branch, its first ring that is out
    fork: NDArray[np.int32]  # (P,), branch at whose fork a point is, its own or one that leaves it; -1 for none
    fork_arc_m: NDArray[np.float64]  # (P,), along the branch of the point, where that fork is
    nearness: NDArray[np.float64]  # (P,), 1 at that fork, 0 far from it


def carry_surface(cage: BranchCage, skeleton: Skeleton) -> GrownSurface:
    """Tie the points of a cage to the axes of its skeleton."""
    return carry_points(cage, skeleton, cage.points_m, cage_places(cage, skeleton))


def carry_points(cage: BranchCage, skeleton: Skeleton, points_m: NDArray[np.float64], places: Places) -> GrownSurface:
    """Tie points (P, 3) to places (P,) on the axes of the skeleton of a cage, whose forks they go with."""
    exits = cage_exits(cage, skeleton)
    rings = cage_places(cage, skeleton)
    out = rings.arc_m > exits.arc_m[rings.curve]
    clear_m = np.full(len(skeleton), np.inf)
    np.minimum.at(clear_m, rings.curve[out], rings.arc_m[out])
    clear_m = np.where(np.isfinite(clear_m), clear_m, exits.arc_m)
    child = np.flatnonzero((skeleton.parent_curve >= 0) & np.isin(np.arange(len(skeleton)), cage.curve))
    holes = child[~np.isin(child, cage.loose)]
    fork, fork_arc_m, nearness = _near_forks(skeleton, places, child, clear_m[child], exits, holes)
    return GrownSurface(
        points_m=points_m,
        places=places,
        emerges_m=exits.arc_m,
        clear_m=clear_m,
        fork=fork,
        fork_arc_m=fork_arc_m,
        nearness=nearness,
    )


def _near_forks(
    skeleton: Skeleton,
    places: Places,
    child: NDArray[np.int64],
    clear_m: NDArray[np.float64],
    exits: Exits,
    holes: NDArray[np.int64],
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """The fork next to each place (P,): its branch, where it is along the branch of the place, and how near it is.

    Args:
        skeleton: Whose axes.
        places: On them.
        child: Branches that leave another one; each has a fork where it begins,
        clear_m: which reaches so far along it.
        exits: Of all branches.
        holes: Branches that the surface of another one has a hole for, a fork of that one.
    """
    curve = np.concatenate([child, exits.curve[holes]])
    arc_m = np.concatenate([np.zeros(len(child)), exits.parent_arc_m[holes]])
    leaves = np.concatenate([child, holes]).astype(np.int32)
    reach_m = np.concatenate([clear_m, _FORK * skeleton.radius_m[skeleton.parent_vertex[holes]]])
    fork = np.full(len(places), -1, np.int32)
    fork_arc_m, nearness = np.zeros(len(places)), np.zeros(len(places))
    if not len(curve):
        return fork, fork_arc_m, nearness
    stride = 2 * float(skeleton.lengths_m.max())  # lays all branches on one line
    order = np.argsort(curve * stride + arc_m, kind="stable")
    line_m = (curve * stride + arc_m)[order]
    place_m = places.curve * stride + places.arc_m
    after = np.searchsorted(line_m, place_m)
    for beside in (after - 1, after):
        at = order[np.clip(beside, 0, len(order) - 1)]
        away = np.abs(places.arc_m - arc_m[at]) / np.maximum(reach_m[at], 1e-300)
        near = np.where(curve[at] == places.curve, np.clip(2 - away / (1 + _SAME), 0, 1), 0.0)
        nearer = near > nearness
        fork[nearer], fork_arc_m[nearer], nearness[nearer] = leaves[at[nearer]], arc_m[at[nearer]], near[nearer]
    return fork, fork_arc_m, nearness


def grow_surface(stages: GrowthStages, stage: int, surface: GrownSurface) -> NDArray[np.float64]:
    """(P, 3) points at one time: as far from their axis as it is thinner than at last, and never beyond its tip.

    A branch that has not begun ends where it will come out of its parent, which is closed there.
    """
    skeleton, curve = stages.skeleton, surface.places.curve
    thickness = stages.thickness(stage)
    at_spring = np.maximum(skeleton.parent_vertex, 0)
    has_parent = skeleton.parent_curve >= 0
    parent_share = thickness[at_spring] * stages.birth(stage, skeleton.curve[at_spring], stages.times.path_m[at_spring])
    parent_share = np.where(has_parent, parent_share, 1.0)
    tips = _find_tips(stages, stage, np.where(has_parent, surface.emerges_m * parent_share, 0.0))
    nearer = surface.nearness * (1 - np.where(surface.fork >= 0, parent_share[surface.fork], 1.0))
    arc_m = surface.places.arc_m - nearer * (surface.places.arc_m - surface.fork_arc_m)
    goes_in_m = _inwards(skeleton, surface.clear_m, parent_share)
    inside = (surface.places.arc_m < surface.emerges_m[curve]) & goes_in_m[curve].any(axis=1)
    places = places_at(skeleton, curve, arc_m)
    at_m = places.between(skeleton.points_m) + np.where(inside[:, None], goes_in_m[curve], 0.0)
    holder = tips.holder[curve]
    there = (holder == curve) & (arc_m <= tips.arc_m[curve])
    tip_m = places_at(skeleton, np.arange(len(skeleton)), tips.arc_m).between(skeleton.points_m)
    share = places.between(thickness) * stages.birth(stage, curve, stages.times.base_m[curve] + arc_m)
    from_axis_m = surface.points_m - surface.places.between(skeleton.points_m)
    grown_m = np.where(there[:, None], at_m, tip_m[holder]) + share[:, None] * from_axis_m
    whole = there & (share == 1) & (nearer == 0) & ~inside
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
