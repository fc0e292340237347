"""Limbs that stand elsewhere on another tree of the same kind: turned, raised, left out, twice there. Ours."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.axis_places import places_at
from usdfoliage.branch.distances import place_on_axes
from usdfoliage.branch.model import Skeleton

_BARK = 1.5  # radii, up to which points are of a branch that is thicker than their nearest one
_THINNER = 0.9  # of the stem's radius where it leaves it, that a limb is thick at most
_OPPOSITE = (0.25, 0.75)  # of a turn, by which one that is twice there stands from itself
_TANGENT = 0.1  # of a stem's length, over which its direction is taken


@dataclass(frozen=True, kw_only=True)
class LimbSettings:
    """How much the limbs of trees of a stand differ."""

    turn_deg: float = 18.0  # standard deviation, about the stem
    rise: float = 0.02  # of the stem's length, standard deviation, along the stem
    change: float = 0.15  # probability of each of being left out, and as much of being twice there
    min_share: float = 0.004  # of the length of all axes, from which on a limb may be so,
    max_share: float = 0.06  # and up to which: others are the crown

    def __post_init__(self) -> None:
        if not (0 <= self.turn_deg <= 180 and 0 <= self.rise <= 0.5 and 0 <= self.change <= 0.5):
            raise ValueError("turn_deg must be 0 to 180, rise and change 0 to 0.5")
        if not 0 <= self.min_share <= self.max_share:
            raise ValueError("min_share must be 0 or more and at most max_share")


def move_limbs(
    skeleton: Skeleton,
    points_m: NDArray[np.float64],
    settings: LimbSettings,
    spread: float,
    seed: int,
) -> tuple[Skeleton, NDArray[np.float64]]:
    """A tree's branches and points with its limbs elsewhere on its stems; each limb keeps its shape.

    Args:
        skeleton: The branches, whose limbs are those of the first order with all that they carry.
        points_m: (N, 3), the points of the tree; each goes with the branch that it is nearest to.
        settings: How much limbs differ.
        spread: Times that, 0 or more; 0 leaves all as it is.
        seed: Of what is drawn.

    Returns:
        The branches, and (M, 3) points, in the order of those of the tree.
    """
    limbs = np.flatnonzero(skeleton.order == 1)
    if spread == 0 or not len(limbs) or not len(points_m):
        return skeleton, points_m
    rng = np.random.default_rng([seed, 2])
    limb = limbs_of(skeleton)
    turns, copies = _draw(skeleton, limb, limbs, settings, spread, rng)
    raised = rng.normal(0, spread * settings.rise, len(limbs))
    stem = skeleton.parent_curve[limbs]
    at = skeleton.parent_vertex[limbs]
    goal = _vertex_near(skeleton, stem, skeleton.arcs_m[at] + raised * skeleton.lengths_m[stem])
    axis = _tangents(skeleton, stem, skeleton.arcs_m[at])
    of_point = _nearest_limb(skeleton, points_m, limb)
    moves = [
        _above_ground(
            _Move(
                limb=int(limbs[number]),
                about_m=skeleton.points_m[at[number]],
                axis=axis[number],
                turn_rad=turn,
                vertex=int(goal[number]),
                to_m=skeleton.points_m[goal[number]],
            ),
            skeleton.points_m[limb[skeleton.curve] == limbs[number]],
            float(skeleton.points_m[:, 1].min()),
        )
        for number in range(len(limbs))
        for turn in turns[number][: copies[number]]
    ]
    moved_m = [points_m[of_point < 0], *(move.of(points_m[of_point == move.limb]) for move in moves)]
    order = [np.flatnonzero(of_point < 0), *(np.flatnonzero(of_point == move.limb) for move in moves)]
    sorted_ = np.argsort(np.concatenate(order), kind="stable")
    return _moved(skeleton, limb, moves), np.concatenate(moved_m)[sorted_]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Move:
    """Of a limb: a turn about its stem, then a way along it."""

    limb: int
    about_m: NDArray[np.float64]  # (3,)
    axis: NDArray[np.float64]  # (3,), unit
    turn_rad: float
    vertex: int  # of the stem, that the limb leaves from afterwards
    to_m: NDArray[np.float64]  # (3,), where that is

    def of(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        from_m = points_m - self.about_m
        along = (from_m @ self.axis)[:, None] * self.axis
        across = from_m - along
        turned = np.cos(self.turn_rad) * across + np.sin(self.turn_rad) * np.cross(self.axis, across)
        return np.asarray(self.to_m + along + turned)


def _above_ground(move: _Move, limb_m: NDArray[np.float64], lowest_m: float) -> _Move:
    """The move of a limb (N, 3), about the vertical where it would lead under the lowest point of the tree.

    On the other side of a slanting stem is the ground.
    """
    if move.of(limb_m)[:, 1].min() >= min(lowest_m, float(limb_m[:, 1].min())):
        return move
    return replace(move, axis=np.array([0.0, 1.0, 0.0]))


def limbs_of(skeleton: Skeleton) -> NDArray[np.int64]:
    """(B,) the branch of the first order that each branch is or springs from; -1 for stems."""
    limb = np.full(len(skeleton), -1, np.int64)
    for order in range(1, int(skeleton.order.max(initial=0)) + 1):
        some = np.flatnonzero(skeleton.order == order)
        limb[some] = some if order == 1 else limb[skeleton.parent_curve[some]]
    return limb


def _draw(
    skeleton: Skeleton,
    limb: NDArray[np.int64],
    limbs: NDArray[np.int64],
    settings: LimbSettings,
    spread: float,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(L, 2) turns of each limb and of a second one like it, radians; (L,) how often it is there."""
    first = rng.normal(0, spread * np.radians(settings.turn_deg), len(limbs))
    second = first + 2 * np.pi * rng.uniform(*_OPPOSITE, len(limbs))
    length_m = np.bincount(limb[limb >= 0], skeleton.lengths_m[limb >= 0], len(skeleton))[limbs]
    share = length_m / max(float(skeleton.lengths_m.sum()), 1e-300)
    chance, change = rng.random(len(limbs)), min(spread * settings.change, 0.5)
    copies = np.where(chance < change, 0, np.where(chance > 1 - change, 2, 1))
    copies[(share < settings.min_share) | (share > settings.max_share)] = 1
    return np.column_stack([first, second]), copies


def _vertex_near(skeleton: Skeleton, curve: NDArray[np.integer], arc_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """(L,) the vertex of a branch that is nearest to a length along it; neither of its ends, where it has others."""
    place = places_at(skeleton, curve, arc_m)
    vertex = place.vertex + (place.share > 0.5)
    first = skeleton.first[curve].astype(np.int64)
    last = first + skeleton.counts[curve] - 1
    return np.asarray(np.clip(vertex, np.minimum(first + 1, last), np.maximum(last - 1, first)))


def _tangents(skeleton: Skeleton, curve: NDArray[np.integer], arc_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(L, 3) unit directions of branches around places on them."""
    over_m = _TANGENT * skeleton.lengths_m[curve]
    along = places_at(skeleton, curve, arc_m + over_m).between(skeleton.points_m) - places_at(
        skeleton, curve, arc_m - over_m
    ).between(skeleton.points_m)
    return np.asarray(along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300))


def _nearest_limb(skeleton: Skeleton, points_m: NDArray[np.float64], limb: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) the limb of the branch that each point is on, or nearest to; -1 where that is a stem.

    A point on the bark of a thick branch is its own, where a thin one leaves it too: without it that would have a gap.
    """
    step_m = max(float(skeleton.lengths_m.sum()) / (4 * len(skeleton.points_m)), 1e-9)
    places = place_on_axes(skeleton, step_m)
    size = np.ceil(np.log2(places.radius_m))
    nearest, left = np.zeros(len(points_m), np.int64), np.arange(len(points_m))
    for each in np.unique(size)[::-1]:
        some = np.flatnonzero(size == each)
        found = cKDTree(places.points_m[some]).query(points_m[left], distance_upper_bound=_BARK * 2.0**each, workers=-1)
        away_m, near = (np.asarray(one) for one in found)
        on_bark = np.isfinite(away_m)
        on_bark[on_bark] = away_m[on_bark] <= _BARK * places.radius_m[some[near[on_bark]]]
        nearest[left[on_bark]] = some[near[on_bark]]
        left = left[~on_bark]
    nearest[left] = np.asarray(cKDTree(places.points_m).query(points_m[left], workers=-1)[1])
    return limb[skeleton.curve[places.vertex[nearest]]]


def _moved(skeleton: Skeleton, limb: NDArray[np.int64], moves: list[_Move]) -> Skeleton:
    """The stems, and limbs as they are moved."""
    stems = skeleton.only(limb < 0)
    stem_number = np.cumsum(limb < 0) - 1
    stem_vertex = np.cumsum((limb < 0)[skeleton.curve]) - 1
    points_m, radius_m, counts = [stems.points_m], [stems.radius_m], [stems.counts]
    parents, vertices = [stems.parent_curve], [stems.parent_vertex]
    orders, inferred = [stems.order], [stems.inferred]
    curves_before, vertices_before = len(stems), len(stems.points_m)
    for move in moves:
        mine = np.flatnonzero(limb == move.limb)
        number = np.full(len(skeleton), -1, np.int64)
        number[mine] = curves_before + np.arange(len(mine))
        of_mine = limb[skeleton.curve] == move.limb
        vertex = np.cumsum(of_mine) - 1 + vertices_before
        points_m.append(move.of(skeleton.points_m[of_mine]))
        radius_m.append(np.minimum(skeleton.radius_m[of_mine], _THINNER * skeleton.radius_m[move.vertex]))
        counts.append(skeleton.counts[mine])
        parent = number[skeleton.parent_curve[mine]]
        leaves_from = vertex[skeleton.parent_vertex[mine]]
        parent[0] = stem_number[skeleton.parent_curve[move.limb]]
        leaves_from[0] = stem_vertex[move.vertex]
        parents.append(parent.astype(np.int32))
        vertices.append(leaves_from.astype(np.int32))
        orders.append(skeleton.order[mine])
        inferred.append(skeleton.inferred[mine])
        curves_before += len(mine)
        vertices_before += int(of_mine.sum())
    return Skeleton(
        points_m=join_forks(np.concatenate(points_m), np.concatenate(counts), np.concatenate(vertices)),
        radius_m=np.concatenate(radius_m),
        counts=np.concatenate(counts),
        parent_curve=np.concatenate(parents),
        parent_vertex=np.concatenate(vertices),
        order=np.concatenate(orders),
        inferred=np.concatenate(inferred),
    )


def join_forks(
    points_m: NDArray[np.float64], counts: NDArray[np.int32], parent_vertex: NDArray[np.int32]
) -> NDArray[np.float64]:
    """(V, 3) points of branches, the first of each the vertex that it leaves from, to the last digit."""
    first = np.cumsum(counts) - counts
    joined_m = points_m.copy()
    for number in np.flatnonzero(parent_vertex >= 0):  # a parent comes before its children
        joined_m[first[number]] = joined_m[parent_vertex[number]]
    return joined_m
