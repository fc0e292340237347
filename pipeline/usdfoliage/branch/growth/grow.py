"""Growth of branches towards points: what a cloud does not show well enough to be traced.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 5.2: metamers by L-system 1,
buds that compete for points by space colonisation, with the influence distance of the logistic growth (eq. 7) and the
weighed direction of equation 9; section 6.2: branches that break the allometric rule are shed while growing.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.allometry import grow_radii
from usdfoliage.branch.growth.buds import GrowingPlant, aim_buds, grow_shoots, nearest_aims, sprout
from usdfoliage.branch.growth.logistic import cycles_until, growth_units, longest_path
from usdfoliage.branch.growth.node_tree import NodeTree, as_skeleton, node_tree
from usdfoliage.branch.growth.seen_stems import SeenStems, take_seen_radii
from usdfoliage.branch.growth.settings import GrowthSettings
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths

_WIDER = 1.5  # times the nearest point's distance, how far a bud looks across a gap
_ALL_OPEN = 0.98  # of the longest path, at which the last buds of what is there already open


@dataclass(frozen=True, kw_only=True, eq=False)
class GrownBranches:
    """A skeleton and how it came about."""

    skeleton: Skeleton  # the branches that it was grown from come first, in their order
    cycles: int
    grown: int  # branches that are new
    shed: int  # that were, for a while
    reached: NDArray[np.bool_]  # (M,), points that growth came to


def seed_plants(roots_m: NDArray[np.float64], internode_m: float, radius_m: float) -> Skeleton:
    """One upright internode at each root (R, 3): the seeds that a whole plant grows from."""
    count = len(roots_m)
    up_m = np.array([0.0, internode_m, 0.0])
    return Skeleton(
        points_m=np.stack([roots_m, roots_m + up_m], axis=1).reshape(-1, 3),
        radius_m=np.full(2 * count, radius_m),
        counts=np.full(count, 2, np.int32),
        parent_curve=np.full(count, -1, np.int32),
        parent_vertex=np.full(count, -1, np.int32),
        order=np.zeros(count, np.int32),
    )


def grow_branches(
    start: Skeleton,
    points_m: NDArray[np.float64],
    weights: NDArray[np.floating],
    settings: GrowthSettings,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    stems: SeenStems | None = None,
    *,
    ages: bool = False,
) -> GrownBranches:
    """Grow branches from all buds of a skeleton towards points, until none is in reach.

    Args:
        start: What is there already, seeds or traced branches: it keeps its shape and its radii, tips grow on.
        points_m: (M, 3), Y up.
        weights: (M,), importance of each point (usdfoliage.branch.growth.importance), above 0.
        settings: How.
        seed: Of the turn at which each branch's phyllotaxy begins.
        progress: Called with how far growth is, 0 to 1.
        stems: That were seen: along these branches are as thick as they are.
        ages: Whether the buds of what is there already open from the roots on, as if it grew with the rest: so a point
            beside a stem is left to a bud below it, as in a plant that grows. Else all are open from the beginning,
            and what springs from a stem stands off it at right angles.

    Raises:
        ValueError: Points and weights are not as many.
    """
    if len(points_m) != len(weights):
        raise ValueError(f"{len(points_m)} points have {len(weights)} weights")
    rng = np.random.default_rng(seed)
    plant = sprout(node_tree(start, settings.internode_m), rng)
    waiting = np.arange(len(points_m))
    reached = np.zeros(len(points_m), bool)
    cycle, age, shed = 0, 0, 0
    fresh_m = plant.tree.position_m  # nodes that no point was compared with
    wide = False
    opens = _share_of_path(plant.tree) if ages else np.zeros(len(plant.tree))
    while cycle < settings.max_cycles:
        units = float(growth_units(age, settings.logistic))
        influence_m = max(units, settings.min_reach) * settings.internode_m
        kill_m = min(settings.kill * influence_m, settings.max_kill * settings.internode_m, settings.max_kill_m)
        near_m = cKDTree(fresh_m).query(points_m[waiting], distance_upper_bound=kill_m, workers=-1)[0]
        used = np.isfinite(near_m)
        reached[waiting[used]] = True
        waiting = waiting[~used]
        if not len(waiting):
            break
        before = len(plant.tree)
        closed = np.zeros(before, bool)
        closed[: len(opens)] = opens > longest_path(age, settings.logistic) / settings.logistic.longest
        opening = bool(closed.any())
        if wide:
            plant = _cross_gaps(plant, points_m[waiting], weights[waiting], influence_m, cycle, settings, rng)
        else:
            aims = aim_buds(plant, points_m[waiting], influence_m, settings, closed)
            plant = grow_shoots(plant, points_m[waiting], weights[waiting], aims, units, cycle, settings, rng)
        fresh_m = plant.tree.position_m[before:]
        grew = len(fresh_m) > 0
        if cycle % settings.rest == 0:
            plant, gone = _shed(plant, len(start), cycle, settings)
            shed += gone
        cycle += 1
        age += not wide
        # As the plant becomes older its shoots become shorter: what no bud sees then only a wider look finds.
        older = longest_path(age, settings.logistic) > 0.5 * settings.logistic.longest
        lacks = len(waiting) > settings.max_unreached * len(points_m)
        if not grew and not opening and (wide or (older and not (settings.max_gap_m > 0 and lacks))):
            break
        if wide and grew:  # as young as a plant that fills such a share of the points
            age = min(age, cycles_until(1 - len(waiting) / len(points_m), settings.logistic))
        wide = not grew and not opening and settings.max_gap_m > 0 and lacks
        if progress:
            progress(1 - len(waiting) / len(points_m))
    plant, gone = _shed(plant, len(start), cycle + settings.rest, settings)
    if stems is not None:
        plant = replace(plant, tree=take_seen_radii(plant.tree, stems))
    tree = replace(plant.tree, radius_m=_radii(plant.tree, settings))
    return GrownBranches(
        skeleton=as_skeleton(tree),
        cycles=cycle,
        grown=len(tree.fork) - len(start),
        shed=shed + gone,
        reached=reached,
    )


def _share_of_path(tree: NodeTree) -> NDArray[np.float64]:
    """(N,) length of the path from its root to each node, of the longest one, up to _ALL_OPEN."""
    path_m = RootedTree(tree.parent).sum_below(step_lengths(tree.position_m, tree.parent))
    return np.asarray(_ALL_OPEN * path_m / max(float(path_m.max()), 1e-300))


def _cross_gaps(
    plant: GrowingPlant,
    points_m: NDArray[np.float64],
    weights: NDArray[np.floating],
    influence_m: float,
    cycle: int,
    settings: GrowthSettings,
    rng: np.random.Generator,
) -> GrowingPlant:
    """The plant with shoots across the narrowest gaps that part it from points; as it is where all are too wide."""
    looking = replace(settings, perception_deg=360.0)
    nearest_m = float(np.min(cKDTree(plant.tree.position_m).query(points_m, workers=-1)[0]))
    if nearest_m > settings.max_gap_m:
        return plant
    aims = aim_buds(plant, points_m, max(influence_m, _WIDER * nearest_m), looking)
    aims = nearest_aims(plant, points_m, aims, _WIDER)
    return grow_shoots(plant, points_m, weights, aims, np.inf, cycle, looking, rng)


def _radii(tree: NodeTree, settings: GrowthSettings) -> NDArray[np.float64]:
    """(N,) those that are known, and by allometry what springs from there (eq. 5)."""
    nodes = RootedTree(tree.parent)
    step_m = step_lengths(tree.position_m, tree.parent)
    return np.maximum(grow_radii(nodes, step_m, tree.radius_m, settings.allometry), settings.min_radius_m)


def _shed(plant: GrowingPlant, lasting: int, cycle: int, settings: GrowthSettings) -> tuple[GrowingPlant, int]:
    """The plant without branches that rest and are stubs, or too slender for what they carry; and how many went."""
    tree = plant.tree
    axes = len(tree.fork)
    resting = (cycle - plant.grown) >= settings.rest
    resting[:lasting] = False
    if not resting.any():
        return plant, 0
    nodes = RootedTree(tree.parent)
    step_m = step_lengths(tree.position_m, tree.parent)
    length_m = np.asarray(np.bincount(tree.axis, step_m, axes), np.float64)
    bears = np.zeros(axes, bool)
    forked = tree.fork >= 0
    bears[tree.axis[tree.fork[forked]]] = True
    stub = ~bears & (length_m < (settings.stub - 1e-6) * settings.internode_m)
    first = np.full(axes, len(tree), np.int64)
    np.minimum.at(first, tree.axis, np.arange(len(tree)))
    reach_m = (nodes.farthest_above(step_m) + step_m)[first]
    slender = reach_m > settings.slenderness * 2 * _radii(tree, settings)[first]
    cut = resting & (stub | slender)
    if not cut.any():
        return plant, 0
    axis_stays = ~tree.carried_by(cut)
    kept = axis_stays[tree.axis]
    stays = tree.without(cut)
    number = np.cumsum(kept, dtype=np.int32) - 1
    left = GrowingPlant(
        tree=stays,
        heading=plant.heading[kept],
        lateral=plant.lateral[kept],
        turn=plant.turn[kept],
        tip=number[plant.tip[axis_stays]],
        grown=plant.grown[axis_stays],
    )
    return left, axes - len(stays.fork)
