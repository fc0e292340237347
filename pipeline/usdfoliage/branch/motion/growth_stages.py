"""Stages of the growth of branches that are known: what of them is there at a time, where, and how thick.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, figure 12: the longest way from the
root follows the logistic growth of equation 6, lengths in internodes; what lies farther than that is not there yet.
Radii follow from what each node carries (equation 5), times what was measured. The iterations are stretched over the
frames, and the last one is the plant as it was reconstructed.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.allometry import AllometrySettings, carried_lengths, min_carried
from usdfoliage.branch.axis_places import Places, places_at
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.growth.logistic import LogisticSettings, longest_path
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.motion.surface_places import cage_exits, cage_places
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths

_GROWN = 0.99  # of the greatest length, that the logistic growth, which has no end, has when it is stopped
_SAME = 1e-9  # of the longest way: lengths that differ by rounding
_UNBORN = 1e-4  # of its radius, that what is not there yet has: USD's widths are above 0


@dataclass(frozen=True, kw_only=True)
class GrowthStageSettings:
    """How branches grow to what they are."""

    initial_internodes: float = 2.0  # H_0
    taper_internodes: float = 4.0  # over which a growing tip becomes as thick as what it carries asks for
    allometry: AllometrySettings = field(default_factory=AllometrySettings)

    def __post_init__(self) -> None:
        for name in ("initial_internodes", "taper_internodes"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be above 0, not {getattr(self, name):g}")


@dataclass(frozen=True, kw_only=True, eq=False)
class GrowthStages:
    """A skeleton, and how far it has grown at each of T times."""

    skeleton: Skeleton
    path_m: NDArray[np.float64]  # (V,), from the root to each point
    front_m: NDArray[np.float64]  # (T,), longest way that is there, growing; at last beyond all by taper_m
    taper_m: float
    exponent: float  # of the allometry

    def __len__(self) -> int:
        return len(self.front_m)

    @cached_property
    def tree(self) -> RootedTree:
        """Points as nodes; the first of a branch follows the one of its parent that it repeats."""
        parent = np.arange(-1, len(self.path_m) - 1, dtype=np.int32)
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
        there_m = np.clip(self.front_m[stage] - (self.path_m - self.step_m), 0, self.step_m)
        carried_m = carried_lengths(self.tree, there_m, min_carried(self.step_m))
        return np.asarray(np.minimum(carried_m / self.carried_m, 1) ** self.exponent)

    def birth(self, stage: int, path_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(P,) what is left of a radius this way from the root, near a growing tip: nearly 0 beyond it, at last 1."""
        return np.asarray(np.clip((self.front_m[stage] - path_m) / self.taper_m, _UNBORN, 1))


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
    path_m = skeleton.arcs_m.copy()
    for number in np.flatnonzero(skeleton.parent_curve >= 0).tolist():  # parents first
        path_m[skeleton.branch(number)] += path_m[skeleton.parent_vertex[number]]
    taper_m = settings.taper_internodes * internode_m
    longest = (float(path_m.max()) + 1.001 * taper_m) / internode_m  # a little more: no rounding keeps a tip back
    return GrowthStages(
        skeleton=skeleton,
        path_m=path_m,
        front_m=internode_m * logistic_lengths(longest, count, settings),
        taper_m=taper_m,
        exponent=settings.allometry.exponent,
    )


def logistic_lengths(
    longest: float, count: int, settings: GrowthStageSettings = GrowthStageSettings()
) -> NDArray[np.float64]:
    """(T,) longest ways H_t from the first time, with H_0, to the last, with all, in internodes (eq. 6).

    rho_0 gives the number of iterations, and these are stretched over the T times whatever they are.
    """
    start = min(settings.initial_internodes, 0.5 * longest)
    surplus = longest / start - 1
    end = np.log(surplus * _GROWN / (1 - _GROWN))  # rho_0 t
    logistic = LogisticSettings(longest=longest, initial_share=start / longest, initial_units=1.0)
    grown = longest_path(np.linspace(0, end, count), logistic)
    # The share that is missing at the end is spread over all times, so that growth stops where it is to.
    lengths = start + (grown - start) * (longest - start) / (grown[-1] - start)
    lengths[-1] = longest
    return np.asarray(lengths)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tips:
    """Where B branches end at one time."""

    arc_m: NDArray[np.float64]  # (B,), along each, of those that have begun; a little more, for rounding
    holder: NDArray[np.int32]  # (B,), itself where it has begun, else the first below it that has


def _find_tips(stages: GrowthStages, stage: int, min_m: NDArray[np.float64]) -> _Tips:
    """Tips of branches, of which each that has begun is at least so long (B,)."""
    skeleton = stages.skeleton
    parent = skeleton.parent_curve
    base_m = stages.path_m[skeleton.first]
    arc_m = np.clip(np.maximum(stages.front_m[stage] - base_m, min_m), 0, skeleton.lengths_m)
    arc_m += _SAME * float(stages.path_m.max())
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
    radius_m = skeleton.radius_m * stages.thickness(stage) * stages.birth(stage, stages.path_m)
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


def carry_surface(cage: BranchCage, skeleton: Skeleton) -> GrownSurface:
    """Tie the points of a cage to the axes of its skeleton."""
    return GrownSurface(
        points_m=cage.points_m,
        places=cage_places(cage, skeleton),
        emerges_m=cage_exits(cage, skeleton).arc_m,
    )


def grow_surface(stages: GrowthStages, stage: int, surface: GrownSurface) -> NDArray[np.float64]:
    """(P, 3) points at one time: as far from their axis as it is thinner than at last, and never beyond its tip.

    A branch that has not begun ends where it will come out of its parent, which is closed there.
    """
    skeleton, places = stages.skeleton, surface.places
    thickness = stages.thickness(stage)
    at_spring = np.maximum(skeleton.parent_vertex, 0)
    parent_share = thickness[at_spring] * stages.birth(stage, stages.path_m[at_spring])
    tips = _find_tips(stages, stage, np.where(skeleton.parent_curve >= 0, surface.emerges_m * parent_share, 0.0))
    holder = tips.holder[places.curve]
    there = (holder == places.curve) & (places.arc_m <= tips.arc_m[places.curve])
    axis_m = places.between(skeleton.points_m)
    tip_m = places_at(skeleton, np.arange(len(skeleton)), tips.arc_m).between(skeleton.points_m)
    path_m = stages.path_m[skeleton.first[places.curve]] + places.arc_m
    share = places.between(thickness) * stages.birth(stage, path_m)
    grown_m = np.where(there[:, None], axis_m, tip_m[holder]) + share[:, None] * (surface.points_m - axis_m)
    whole = there & (share == 1)
    return np.where(whole[:, None], surface.points_m, grown_m)
