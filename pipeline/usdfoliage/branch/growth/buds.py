"""Buds that see points, and the shoots of metamers that they grow towards them in a cycle.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 5.2: L-system 1, space
colonisation after W. Palubicki et al., Self-organizing tree models for image synthesis, 2009, and equation 9. Of points
that several buds see each goes to the nearest: ours.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.growth.node_tree import NodeTree
from usdfoliage.branch.growth.settings import GrowthSettings
from usdfoliage.geometry.directions import two_across

_BUDS = 8  # nearest ones, of which a point goes to the first that sees it
_MIN_STEP = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class GrowingPlant:
    """A plant that grows, and its buds: one lateral a node, one apical an axis."""

    tree: NodeTree
    heading: NDArray[np.float64]  # (N, 3), unit, of the internode to each node
    lateral: NDArray[np.bool_]  # (N,), whose lateral bud has not grown
    turn: NDArray[np.float64]  # (N,), at which the lateral bud stands, in divergence angles
    tip: NDArray[np.int32]  # (A,), last node of each axis
    grown: NDArray[np.int32]  # (A,), cycle in which the axis grew last


def sprout(tree: NodeTree, rng: np.random.Generator) -> GrowingPlant:
    """A plant with buds on all nodes that nothing springs from, before its first cycle; rng turns its axes."""
    axes = len(tree.fork)
    count = len(tree)
    from_m = tree.position_m[np.maximum(tree.parent, 0)]
    heading = tree.position_m - from_m
    # A root's node has no internode before it: it heads where the next one does.
    child = np.flatnonzero(tree.parent >= 0)
    begins = tree.parent < 0
    following = child[begins[tree.parent[child]]]
    heading[tree.parent[following]] = tree.position_m[following] - tree.position_m[tree.parent[following]]
    heading /= np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), _MIN_STEP)
    tip = np.zeros(axes, np.int32)
    np.maximum.at(tip, tree.axis, np.arange(count, dtype=np.int32))
    within = np.arange(count) - np.searchsorted(tree.axis, tree.axis)  # nodes come axis by axis
    lateral = np.ones(count, bool)
    lateral[tree.fork[tree.fork >= 0]] = False
    lateral[begins] = False
    return GrowingPlant(
        tree=tree,
        heading=heading,
        lateral=lateral,
        turn=rng.uniform(0, 360, axes)[tree.axis] + within,
        tip=tip,
        grown=np.zeros(axes, np.int32),
    )


def _buds(plant: GrowingPlant, settings: GrowthSettings) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(B,) nodes with buds, first those of the tips of all axes, then laterals; and where these head (B, 3)."""
    behind = plant.lateral.copy()
    behind[plant.tip] = False  # the bud at a tip is the apical one
    laterals = np.flatnonzero(behind)
    along = plant.heading[laterals]
    side, other = two_across(along)
    turn = np.radians(settings.divergence_deg) * plant.turn[laterals, None]
    across = np.cos(turn) * side + np.sin(turn) * other
    branching = np.radians(settings.branching_deg)
    outwards = np.cos(branching) * along + np.sin(branching) * across
    return np.concatenate([plant.tip, laterals]), np.concatenate([plant.heading[plant.tip], outwards])


@dataclass(frozen=True, kw_only=True, eq=False)
class Aims:
    """Which bud each point is left to."""

    node: NDArray[np.int64]  # (B,)
    heading: NDArray[np.float64]  # (B, 3)
    bud: NDArray[np.int64]  # (M,), -1 where none sees it
    apical: int  # buds that are those of tips


def aim_buds(
    plant: GrowingPlant,
    points_m: NDArray[np.float64],
    influence_m: float,
    settings: GrowthSettings,
    closed: NDArray[np.bool_] | None = None,
) -> Aims:
    """Each point (M, 3) to the nearest bud that has it in its cone and in reach: buds compete, of one plant or more.

    Buds of nodes that are closed (N,) see nothing.
    """
    node, heading = _buds(plant, settings)
    open_buds = np.arange(len(node)) if closed is None else np.flatnonzero(~closed[node])
    bud = np.full(len(points_m), -1, np.int64)
    if not len(open_buds):
        return Aims(node=node, heading=heading, bud=bud, apical=len(plant.tip))
    near = min(_BUDS, len(open_buds))
    tree = cKDTree(plant.tree.position_m[node[open_buds]])
    away_m, found = tree.query(points_m, k=list(range(1, near + 1)), distance_upper_bound=influence_m, workers=-1)
    min_cosine = np.cos(np.radians(0.5 * settings.perception_deg))
    for away, candidate in zip(np.asarray(away_m).T, np.asarray(found).T, strict=True):
        open_ = np.flatnonzero((bud < 0) & np.isfinite(away))
        chosen = open_buds[candidate[open_]]
        towards = points_m[open_] - plant.tree.position_m[node[chosen]]
        ahead = np.einsum("mc,mc->m", towards, heading[chosen]) >= min_cosine * away[open_]
        bud[open_[ahead]] = chosen[ahead]
    return Aims(node=node, heading=heading, bud=bud, apical=len(plant.tip))


def nearest_aims(plant: GrowingPlant, points_m: NDArray[np.float64], aims: Aims, times: float) -> Aims:
    """The aims at points (M, 3) without those that are farther from their bud than its nearest one so many times."""
    seen = np.flatnonzero(aims.bud >= 0)
    bud = aims.bud[seen]
    away_m = np.linalg.norm(points_m[seen] - plant.tree.position_m[aims.node[bud]], axis=1)
    nearest_m = np.full(len(aims.node), np.inf)
    np.minimum.at(nearest_m, bud, away_m)
    left = aims.bud.copy()
    left[seen[away_m > times * nearest_m[bud]]] = -1
    return replace(aims, bud=left)


def grow_shoots(
    plant: GrowingPlant,
    points_m: NDArray[np.float64],
    weights: NDArray[np.floating],
    aims: Aims,
    units: float,
    cycle: int,
    settings: GrowthSettings,
    rng: np.random.Generator,
) -> GrowingPlant:
    """The plant after a cycle: every bud with points grows a shoot of metamers to the middle of these."""
    seen = np.flatnonzero(aims.bud >= 0)
    if not len(seen):
        return plant
    growing, of = np.unique(aims.bud[seen], return_inverse=True)
    shoots = len(growing)
    goal_m, weight = points_m[seen], np.asarray(weights, np.float64)[seen]
    counts = np.bincount(of, minlength=shoots)
    middle_m = np.column_stack([np.bincount(of, line, shoots) for line in goal_m.T]) / counts[:, None]
    at_m = plant.tree.position_m[aims.node[growing]]
    heading = aims.heading[growing]
    distance_m = np.linalg.norm(middle_m - at_m, axis=1)
    full = np.maximum(np.rint(distance_m / settings.internode_m), 1)
    length = np.minimum(full, max(1, np.floor(units))).astype(np.int64)
    axes = len(plant.tree.fork)
    lateral = growing >= aims.apical
    axis = growing.copy()
    axis[lateral] = axes + np.arange(int(lateral.sum()))
    before = aims.node[growing].copy()
    turn = plant.turn[before]
    turn[lateral] = rng.uniform(0, 360, int(lateral.sum()))
    alive = np.ones(shoots, bool)
    positions: list[NDArray[np.float64]] = []
    headings: list[NDArray[np.float64]] = []
    parents: list[NDArray[np.int64]] = []
    axis_of: list[NDArray[np.int64]] = []
    turns: list[NDArray[np.float64]] = []
    total = len(plant.tree)
    for metamer in range(int(length.max())):
        alive &= length > metamer
        direction, sees = _heading(at_m, heading, goal_m, weight, of, settings)
        alive &= sees
        grown = np.flatnonzero(alive)
        if not len(grown):
            break
        heading[grown] = direction[grown]
        at_m[grown] += settings.internode_m * heading[grown]
        turn[grown] += 1
        positions.append(at_m[grown])
        headings.append(heading[grown])
        parents.append(before[grown])
        axis_of.append(axis[grown])
        turns.append(turn[grown])
        before[grown] = total + np.arange(len(grown))
        total += len(grown)
    if not positions:
        return plant
    position_m, of_axis = np.concatenate(positions), np.concatenate(axis_of)
    # Laterals that saw points but could not grow are not axes.
    began = np.zeros(axes + int(lateral.sum()), bool)
    began[:axes] = True
    began[of_axis] = True
    number = np.cumsum(began, dtype=np.int32) - 1
    new = lateral & began[axis]
    used = plant.lateral.copy()
    used[aims.node[growing[new]]] = False
    tree = plant.tree
    tip = np.concatenate([plant.tip, np.zeros(int(new.sum()), np.int32)])
    went_on = began[axis] & (before != aims.node[growing])
    tip[number[axis[went_on]]] = before[went_on]
    last = np.concatenate([plant.grown, np.full(int(new.sum()), cycle, np.int32)])
    last[number[axis[went_on]]] = cycle
    return GrowingPlant(
        tree=NodeTree(
            position_m=np.concatenate([tree.position_m, position_m]),
            radius_m=np.concatenate([tree.radius_m, np.full(len(position_m), np.nan)]),
            parent=np.concatenate([tree.parent, np.concatenate(parents).astype(np.int32)]),
            axis=np.concatenate([tree.axis, number[of_axis]]),
            fork=np.concatenate([tree.fork, aims.node[growing[new]].astype(np.int32)]),
            parent_axis=np.concatenate([tree.parent_axis, tree.axis[aims.node[growing[new]]]]),
            base_radius_m=np.concatenate([tree.base_radius_m, np.full(int(new.sum()), np.nan)]),
        ),
        heading=np.concatenate([plant.heading, *headings]),
        lateral=np.concatenate([used, np.ones(len(position_m), bool)]),
        turn=np.concatenate([plant.turn, *turns]),
        tip=tip,
        grown=last,
    )


def _heading(
    at_m: NDArray[np.float64],
    heading: NDArray[np.float64],
    goal_m: NDArray[np.float64],
    weight: NDArray[np.float64],
    of: NDArray[np.int64],
    settings: GrowthSettings,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(S, 3) where shoots grow next (eq. 9), and whether they see any of their points still (S,)."""
    shoots = len(at_m)
    towards = goal_m - at_m[of]
    away_m = np.linalg.norm(towards, axis=1)
    towards /= np.maximum(away_m, _MIN_STEP)[:, None]
    ahead = np.einsum("mc,mc->m", towards, heading[of]) >= np.cos(np.radians(0.5 * settings.perception_deg))
    ahead &= away_m > 0.5 * settings.internode_m
    counts = np.where(ahead, weight, 0.0)
    total = np.bincount(of, counts, shoots)
    along = [np.bincount(of, counts * line, shoots) for line in towards.T]
    best = np.column_stack(along).astype(np.float64) / np.maximum(total, 1e-300)[:, None]
    direction = heading + settings.pull * best + settings.tropism * np.asarray(settings.tropism_direction)
    size = np.linalg.norm(direction, axis=1, keepdims=True)
    return np.where(size > 1e-6, direction / np.maximum(size, 1e-6), heading), total > 0
