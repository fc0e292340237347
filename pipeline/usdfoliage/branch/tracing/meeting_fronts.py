"""Branches that paths reached from both ends: the arm that runs back to its base is turned round. The method is ours.

Where a branch touches another one, paths to its outer part may be shorter along that other one. The branch is then
reached from its base and from where it touches, and in its middle the two meet: two tips in line with each other. Its
outer part leaves the other branch, and an arm runs back from there. Where the path turns into that arm is found, the
arm is cut off there and goes on from the tip that it meets, and what is in line with it goes with it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.axes import find_axes

_ASKED = 4  # nearest nodes in line with a tip, and at the end of another branch
_ROUNDS = 3  # where one arm is turned round, another may be found

Point = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FrontSettings:
    """When two tips are taken for the middle of one branch. Windows are those that circles are fitted in."""

    windows: float = 2.0  # length over which it is seen where a path points,
    radii: float = 3.0  # and at least so many radii
    reach_windows: float = 2.7  # distance between two tips, at most,
    reach_radii: float = 2.0  # or so many radii
    in_line: float = 0.79  # angle between what leads to one tip and from the other, at most; radians
    sharper: float = 0.61  # angle by which the turn into the arm is sharper than that, at least
    near: float = (
        0.1  # angle that such a turn loses for each length over which directions are seen, to it and between tips
    )

    def __post_init__(self) -> None:
        if not (self.windows > 0 and self.radii >= 0 and self.reach_windows > 0 and self.reach_radii >= 0):
            raise ValueError(f"windows and reach_windows must be above 0, radii not below 0, not {self}")
        if not (0 < self.in_line < np.pi / 2 and 0 < self.sharper < np.pi and self.near >= 0):
            raise ValueError(f"in_line and sharper must be angles, near not below 0, not {self}")


@dataclass(frozen=True, kw_only=True)
class _Meeting:
    gain: float  # angle
    tip: int  # that goes on into the arm
    arm: list[int]  # from the tip that it meets to where it is cut off
    fork: int  # from which it is cut off
    backwards: Point  # (3,), along the arm to the fork


def join_fronts(
    center_m: NDArray[np.float64],
    parent: NDArray[np.int32],
    radius_m: NDArray[np.float64],
    min_m: NDArray[np.floating] | float,
    window_m: float,
    settings: FrontSettings = FrontSettings(),
) -> NDArray[np.int32]:
    """(S,) parents of nodes without arms that run back to the base of their branch.

    Args:
        center_m: (S, 3), of the nodes.
        parent: (S,), -1 for a root.
        radius_m: (S,), of the branches there.
        min_m: Of a node (S,) or all, length that a branch springing there must have.
        window_m: Along a branch to both sides, of the points that a circle is fitted to.
        settings: When two tips are of one branch.
    """
    for _ in range(_ROUNDS):
        axes_tree = _follow(center_m, parent, min_m)
        meetings = _find_meetings(axes_tree, radius_m, window_m, settings)
        joined = _turn_round(axes_tree, radius_m, window_m, settings, meetings)
        if np.array_equal(joined, parent):
            break
        parent = joined
    return parent


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tree:
    """Nodes on axes, and the paths along them."""

    center_m: NDArray[np.float64]  # (S, 3)
    parent: NDArray[np.int32]  # (S,)
    nodes: NDArray[np.int64]  # (N,), on axes
    tips: NDArray[np.int64]  # (A,), of the axes
    path_m: NDArray[np.float64]  # (S,), from the root
    carried_m: NDArray[np.float64]  # (S,), length of the axes beyond each node
    below_node: list[int]  # (S,), the parents
    by_parent: tuple[NDArray[np.int64], NDArray[np.int64]]  # of nodes on axes, as RootedTree has them

    def children(self, node: int) -> list[int]:
        """Those that are on axes."""
        order, begin = self.by_parent
        return [int(each) for each in order[begin[node] : begin[node + 1]]]

    def below(self, node: int) -> list[int]:
        """The node, and all on its path to the root."""
        found = []
        while node >= 0:
            found.append(node)
            node = self.below_node[node]
        return found

    def below_until(self, node: int, there: Mapping[int, int]) -> tuple[list[int], int]:
        """The nodes from one on, on its path to the root, before the first of those that are there, and this; -1 where
        none is."""
        found = []
        while node >= 0 and node not in there:
            found.append(node)
            node = self.below_node[node]
        return found, node

    def places_below(self, length_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(S, 3) so far (S,) below each node, or at its root."""
        end_m = self.path_m - length_m
        above = np.arange(len(self.parent))
        below = above.copy()
        moving = np.flatnonzero((self.parent >= 0) & (length_m > 0))
        while len(moving):
            above[moving] = below[moving]
            below[moving] = self.parent[below[moving]]
            moving = moving[(self.path_m[below[moving]] > end_m[moving]) & (self.parent[below[moving]] >= 0)]
        step_m = self.path_m[above] - self.path_m[below]
        share = np.clip((self.path_m[above] - end_m) / np.where(step_m > 0, step_m, 1.0), 0, 1)[:, None]
        return np.asarray(self.center_m[above] + share * (self.center_m[below] - self.center_m[above]))

    def place_below(self, node: int, length_m: float) -> Point:
        """(3,) so far below a node, or at its root."""
        path = [node]
        end_m = self.path_m[node] - length_m
        while self.below_node[path[-1]] >= 0 and self.path_m[path[-1]] > end_m:
            path.append(self.below_node[path[-1]])
        return _place_along(self.center_m, path, length_m) if len(path) > 1 else self.center_m[node]

    def place_above(self, fork: int, child: int, length_m: float) -> Point:
        """(3,) so far above a fork, on the path that begins with a child and follows what carries most."""
        at_m = self.center_m[fork]
        while True:
            step_m = float(np.linalg.norm(self.center_m[child] - at_m))
            if step_m >= length_m:
                return at_m + (self.center_m[child] - at_m) * (length_m / max(step_m, 1e-12))
            length_m -= step_m
            at_m = self.center_m[child]
            above = self.children(child)
            if not above:
                return at_m
            child = max(above, key=lambda node: (self.carried_m[node], -node))


def _follow(center_m: NDArray[np.float64], parent: NDArray[np.int32], min_m: NDArray[np.floating] | float) -> _Tree:
    axes = find_axes(center_m, parent, min_m)
    on_axis = np.zeros(len(parent), bool)
    on_axis[axes.nodes] = True
    step_m = step_lengths(center_m, parent)
    tree = RootedTree(parent)
    return _Tree(
        center_m=center_m,
        parent=parent,
        nodes=np.flatnonzero(on_axis),
        tips=axes.nodes[axes.first[1:] - 1],
        path_m=tree.sum_below(step_m),
        carried_m=tree.sum_above(np.where(on_axis, step_m, 0.0)),
        below_node=parent.tolist(),
        by_parent=RootedTree(np.where(on_axis, parent, -1).astype(np.int32)).by_parent,
    )


def _find_meetings(
    axes_tree: _Tree, radius_m: NDArray[np.float64], window_m: float, settings: FrontSettings
) -> list[_Meeting]:
    """The best one of each tip, if there is any."""
    tree = cKDTree(axes_tree.center_m[axes_tree.nodes])
    along_m = np.maximum(settings.windows * window_m, settings.radii * radius_m)
    reach_m = np.maximum(settings.reach_windows * window_m, settings.reach_radii * radius_m)
    behind_m = axes_tree.places_below(along_m)
    meetings = []
    around = tree.query_ball_point(axes_tree.center_m[axes_tree.tips], reach_m[axes_tree.tips])
    for tip, near in zip(axes_tree.tips.tolist(), around, strict=True):
        best: _Meeting | None = None
        down: list[int] = []  # from the tip,
        there: dict[int, int] = {}  # and how far each node is on it
        others = axes_tree.nodes[near]
        others = others[others != tip]
        own_m = behind_m[tip]
        onwards = axes_tree.center_m[tip] - own_m
        back = behind_m[others] - axes_tree.center_m[others]
        across = behind_m[others] - own_m
        led = np.broadcast_to(onwards, across.shape)
        pairs = np.concatenate([led, across, led]), np.concatenate([across, back, back])
        turns = _angles(*pairs).reshape(3, -1).max(axis=0, initial=0)
        gaps_m = np.linalg.norm(axes_tree.center_m[others] - axes_tree.center_m[tip], axis=1)
        nearest = np.argsort(gaps_m, kind="stable")
        asked = 0
        for index in nearest[turns[nearest] <= settings.in_line].tolist():
            other = int(others[index])
            if not down:
                down = axes_tree.below(tip)
                there = {node: k for k, node in enumerate(down)}
            second, common = axes_tree.below_until(other, there)
            if common < 0 or common in (tip, other):
                continue
            lengths_m = axes_tree.path_m[[tip, other]] - axes_tree.path_m[common]
            if lengths_m.sum() < 4 * reach_m[tip] or lengths_m.min() < 0.7 * along_m[tip]:
                continue
            first = down[: there[common]]
            # Of what is between the two nothing is to be left over.
            loss = float(turns[index] + settings.near * gaps_m[index] / along_m[tip])
            for end, arm in ((tip, second), (other, first)):
                found = _cut_off(axes_tree, end, arm, loss, float(along_m[arm[0]]), behind_m, settings)
                if found is not None and (best is None or found.gain > best.gain):
                    best = found
            asked += 1
            if asked == _ASKED:
                break
        if best is not None:
            meetings.append(best)
    return sorted(meetings, key=lambda meeting: -meeting.gain)


def _cut_off(
    axes_tree: _Tree,
    tip: int,
    path: list[int],
    loss: float,
    length_m: float,
    behind_m: NDArray[np.float64],
    settings: FrontSettings,
) -> _Meeting | None:
    """The arm at the end of a path, from where the path turns most sharply, not far from its end; None where it turns
    nowhere so sharply that it is one."""
    nodes = np.array([*path, axes_tree.below_node[path[-1]]])
    arc_m = axes_tree.path_m[path[0]] - axes_tree.path_m[nodes]
    # No turn is sharper than back.
    may = np.pi - loss - settings.near * arc_m / length_m > settings.sharper
    may &= arc_m >= 0.5 * length_m
    may[-1] = True
    may[0] = False
    at = np.flatnonzero(may)
    forks_m = axes_tree.center_m[nodes[at]]
    place_m = np.maximum(arc_m[at] - length_m, 0.0)
    ahead_m = np.stack([np.interp(place_m, arc_m, column) for column in axes_tree.center_m[nodes].T], axis=1)
    turns = _angles(forks_m - behind_m[nodes[at]], ahead_m - forks_m)
    gains = turns - loss - settings.near * arc_m[at] / length_m
    best = int(gains.argmax())
    if gains[best] <= settings.sharper:
        return None
    count = int(at[best])
    backwards = forks_m[best] - ahead_m[best]
    return _Meeting(gain=float(gains[best]), tip=tip, arm=path[:count], fork=int(nodes[count]), backwards=backwards)


def _turn_round(
    axes_tree: _Tree,
    radius_m: NDArray[np.float64],
    window_m: float,
    settings: FrontSettings,
    meetings: Sequence[_Meeting],
) -> NDArray[np.int32]:
    """(S,) parents where arms go on from the tips that they meet; each node changes once."""
    parent = axes_tree.parent.copy()
    changed = np.zeros(len(parent), bool)

    def carries(node: int, other: int) -> bool:
        while other >= 0 and other != node:
            other = int(parent[other])
        return other == node

    for meeting in meetings:
        first = meeting.arm[-1]  # from the fork on
        touched = [*meeting.arm, meeting.fork, meeting.tip]
        if changed[touched].any() or carries(first, meeting.tip):
            continue
        changed[touched] = True
        parent[meeting.arm[0]] = meeting.tip
        parent[meeting.arm[1:]] = meeting.arm[:-1]
        along_m = max(settings.windows * window_m, settings.radii * float(radius_m[meeting.fork]))
        into = axes_tree.center_m[meeting.fork] - axes_tree.place_below(meeting.fork, along_m)
        for child in axes_tree.children(meeting.fork):
            out = axes_tree.place_above(meeting.fork, child, along_m) - axes_tree.center_m[meeting.fork]
            goes_with = _angle(meeting.backwards, out) < _angle(into, out)
            if child != first and goes_with and parent[child] == meeting.fork and not carries(child, meeting.tip):
                parent[child] = first
    return parent


def _place_along(center_m: NDArray[np.float64], path: Iterable[int], length_m: float) -> Point:
    """(3,) so far along a path of two nodes or more, or at its end."""
    for node, following in pairwise(path):
        step_m = float(np.linalg.norm(center_m[following] - center_m[node]))
        if step_m >= length_m:
            return np.asarray(center_m[node] + (center_m[following] - center_m[node]) * (length_m / max(step_m, 1e-12)))
        length_m -= step_m
    return np.asarray(center_m[following])


def _angle(one: Point, other: Point) -> float:
    """Between two directions; of one without a length a right angle."""
    return float(_angles(one, other[None])[0])


def _angles(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) between directions (N, 3), or one (3,), and others (N, 3); of one without a length a right angle."""
    lengths = np.sqrt((one * one).sum(axis=-1) * (other * other).sum(axis=-1))
    cosine = np.divide((one * other).sum(axis=-1), lengths, out=np.zeros(len(other)), where=lengths > 0)
    return np.asarray(np.arccos(np.minimum(np.maximum(cosine, -1), 1)))
