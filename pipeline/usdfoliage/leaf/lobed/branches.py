"""A flat lobed leaf as branches: the limbs of its skeleton joined to curves, from the base to each tip.

Source:
    L. Mündermann et al., Modeling lobed leaves, sections 3.2 and 4. Which limb goes on at a fork is our own.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.lines import arc_lengths, points_at
from usdfoliage.leaf.lobed.ties import Ties

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_DIRECTION = 0.3  # at a fork: towards what is so far along the skeleton, as a part of the longest route from the base


@dataclass(frozen=True, kw_only=True, eq=False)
class LobedShape:
    """A lobed leaf in its plane, in any unit with y up.

    Branch 0 is the axis, which begins at the base; every other branch begins at a node of an earlier one. The nodes of
    a branch are neighbours in the arrays, from where it begins to its tip, and the ties of a node too.
    """

    nodes: Floats  # (N, 2), of the skeleton, the base first, each after its parent
    parents: Ints  # (N,), -1 for the base
    branches: Ints  # (N,), the branch that leads to each node; 0 for the base
    tie_nodes: Ints  # (T,), where each tie begins, rising
    feet: Floats  # (T, 2), where it ends on the silhouette
    faces: Ints  # (T, 4), counter-clockwise, into places

    @property
    def branch_count(self) -> int:
        return int(self.branches.max()) + 1

    @property
    def places(self) -> Floats:
        """(N + T, 2) the points of the faces: nodes, then feet."""
        return np.concatenate([self.nodes, self.feet])

    def headings(self) -> Floats:
        """(N,) in which direction the skeleton comes to each node, radians from +x; at the base, in which it leaves."""
        step = self.nodes[1:] - self.nodes[self.parents[1:]]
        angle = np.arctan2(step[:, 1], step[:, 0])
        return np.concatenate([angle[:1], angle])

    def spans(self) -> Floats:
        """(N, 2) the parts of its branch's length at which the step to a node begins and ends; 0, 0 for the base."""
        length = np.concatenate([[0.0], np.linalg.norm(self.nodes[1:] - self.nodes[self.parents[1:]], axis=1)])
        route = np.cumsum(length)
        first = self.branch_starts()
        before = np.concatenate([[0.0], route[first[1:] - 1]])[self.branches]
        whole = np.maximum(np.add.reduceat(length, first), np.finfo(np.float64).tiny)[self.branches]
        return np.clip(np.column_stack([route - length - before, route - before]) / whole[:, None], 0, 1)

    def branch_starts(self) -> Ints:
        """(B,) the first node of each branch: for the axis the base, else the one after the fork."""
        return np.searchsorted(self.branches, np.arange(self.branch_count))


def build_branches(ties: Ties) -> LobedShape:
    """Join the limbs of a leaf to branches: at each fork the straightest and longest limb goes on.

    Args:
        ties: Of the leaf, with the nodes of its limbs.

    Raises:
        ValueError: The limbs are no tree from the base.
    """
    at: list[list[int]] = [[] for _ in ties.nodes]
    for number, passed in enumerate(ties.limb_nodes):
        at[int(passed[0])].append(number)
        at[int(passed[-1])].append(number)
    outward = _outward(ties, at)
    visited = np.concatenate([[ties.base], *(passed[1:] for passed in outward.values())])
    if len(visited) != len(ties.nodes) or len(np.unique(visited)) != len(visited):
        raise ValueError("the limbs of the skeleton are no tree")
    reach: dict[int, float] = {}
    for number in reversed(outward):
        beyond = [reach[other] for other in at[int(outward[number][-1])] if other != number]
        reach[number] = float(arc_lengths(ties.nodes[outward[number]])[-1]) + max(beyond, default=0.0)
    far = _DIRECTION * max(reach[number] for number in at[ties.base])

    order, parents, branches = [ties.base], [-1], [0]
    index = {ties.base: 0}
    waiting = deque(at[ties.base])
    branch = 0
    while waiting:
        first = waiting.popleft()
        behind = [int(outward[first][0])]  # nodes of the branch until now
        limb: int | None = first
        while limb is not None:
            passed = outward[limb]
            for before, node in zip(passed[:-1].tolist(), passed[1:].tolist(), strict=True):
                index[node] = len(order)
                order.append(node)
                parents.append(index[before])
                branches.append(branch)
                behind.append(node)
            others = [other for other in at[int(passed[-1])] if other != limb]
            scores = {other: _score(ties.nodes, behind, _routes(outward, at, other), far) for other in others}
            limb = max(others, key=scores.__getitem__) if others else None
            waiting.extend(other for other in others if other != limb)
        branch += 1

    new = np.empty(len(ties.nodes), np.int64)
    new[order] = np.arange(len(order))
    tie_order = np.argsort(new[ties.node], kind="stable")
    place = np.empty(len(ties.nodes) + len(ties.node), np.int64)
    place[: len(new)] = new
    place[len(new) + tie_order] = len(new) + np.arange(len(tie_order))
    return LobedShape(
        nodes=ties.nodes[order],
        parents=np.array(parents),
        branches=np.array(branches),
        tie_nodes=new[ties.node][tie_order],
        feet=ties.foot[tie_order],
        faces=place[ties.quads()],
    )


def _outward(ties: Ties, at: list[list[int]]) -> dict[int, Ints]:
    """The nodes of each limb in the direction that leads away from the base, limbs after those that they leave."""
    found: dict[int, Ints] = {}
    waiting = [ties.base]
    while waiting:
        node = waiting.pop()
        for number in at[node]:
            if number in found:
                continue
            passed = np.asarray(ties.limb_nodes[number], np.int64)
            found[number] = passed if int(passed[0]) == node else passed[::-1]
            waiting.append(int(found[number][-1]))
    return found


def _routes(outward: dict[int, Ints], at: list[list[int]], number: int) -> list[Ints]:
    """The nodes of each route that begins with a limb and ends in a tip."""
    found, waiting = [], [(number, [outward[number]])]
    while waiting:
        number, route = waiting.pop()
        others = [other for other in at[int(outward[number][-1])] if other != number]
        if not others:
            found.append(np.concatenate(route))
        waiting += [(other, [*route, outward[other][1:]]) for other in others]
    return found


def _score(nodes: Floats, behind: list[int], routes: list[Ints], far: float) -> float:
    """How straight and long the best of several routes is that go on from a branch."""
    lines = [nodes[route] for route in routes]
    return max(_straightness(nodes[behind], line, far) ** 2 * float(arc_lengths(line)[-1]) for line in lines)


def _straightness(came: Floats, goes: Floats, far: float) -> float:
    """1 where one line goes straight on in another, 0 where it turns back, by what is so far from where they meet."""
    behind, front = (points_at(line, np.array([min(far, arc_lengths(line)[-1])]))[0] for line in (came[::-1], goes))
    step, on = goes[0] - behind, front - goes[0]
    size = float(np.linalg.norm(step) * np.linalg.norm(on))
    return 0.5 + 0.5 * float(step @ on) / size if size > 0 else 0.5
