"""Axes: which nodes of a tree make one branch, and which are too short to be any."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.rooted_tree import RootedTree, step_lengths


@dataclass(frozen=True, kw_only=True, eq=False)
class Axes:
    """Branches as chains of nodes; a branch comes after its parent."""

    nodes: NDArray[np.int64]  # (M,), axis after axis, from the parent's node or the root to the tip
    first: NDArray[np.int64]  # (A + 1,), where each one begins in nodes, and M
    parent: NDArray[np.int64]  # (A,), the axis that each springs from, -1 for a root

    def __len__(self) -> int:
        return len(self.parent)

    def axis(self, number: int) -> NDArray[np.int64]:
        """The nodes of one."""
        return self.nodes[self.first[number] : self.first[number + 1]]

    @property
    def axis_of(self) -> NDArray[np.int64]:
        """(M,) the axis of each entry."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))

    @property
    def own(self) -> NDArray[np.bool_]:
        """(M,) whether the node is its axis' own, and not that of the parent it springs from."""
        own = np.ones(len(self.nodes), bool)
        own[self.first[:-1][self.parent >= 0]] = False
        return own

    @property
    def order(self) -> NDArray[np.int64]:
        """(A,) 0 for an axis from a root, else its parent's and one more."""
        return RootedTree(self.parent.astype(np.int32)).depth.astype(np.int64)

    def parent_node(self, count: int) -> NDArray[np.int32]:
        """(count,) the node before each one on its axis; -1 for roots and for what is on no axis."""
        before = np.full(count, -1, np.int32)
        after = np.ones(len(self.nodes), bool)
        after[self.first[:-1]] = False
        before[self.nodes[after]] = self.nodes[np.flatnonzero(after) - 1]
        return before

    def lengths_along(self, center_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(M,) length along its axis from the first node; nodes at center_m (S, 3)."""
        points_m = center_m[self.nodes]
        steps_m = np.concatenate([[0.0], np.linalg.norm(np.diff(points_m, axis=0), axis=1)])
        steps_m[self.first[:-1]] = 0
        path_m = np.cumsum(steps_m)
        return path_m - path_m[self.first[:-1]][self.axis_of]


def find_axes(center_m: NDArray[np.float64], parent: NDArray[np.int32], min_m: NDArray[np.floating] | float) -> Axes:
    """Follow at every fork the child that carries most; what is left begins a branch of its own.

    Args:
        center_m: (S, 3), of the nodes.
        parent: (S,), -1 for a root.
        min_m: Of a node (S,) or all: a branch that springs there and whose longest path is shorter is left out.
    """
    step_m = step_lengths(center_m, parent)
    tree = RootedTree(parent)
    reach_m = tree.farthest_above(step_m) + step_m
    main = tree.first_child(tree.sum_above(step_m))
    order, begin = tree.by_parent
    min_at = np.broadcast_to(np.asarray(min_m, np.float64), len(parent))
    forks = tree.child_counts() > 1
    chains: list[list[int]] = []
    parents: list[int] = []
    waiting = [(-1, -1, int(root)) for root in np.flatnonzero(parent < 0)]
    for axis_parent, fork, start in waiting:  # grows as it is gone through: parents first
        chain = [start] if fork < 0 else [fork, start]
        node = start
        while node >= 0:
            following = int(main[node])
            if forks[node]:
                for child in order[begin[node] : begin[node + 1]]:
                    if child != following and reach_m[child] >= min_at[node]:
                        waiting.append((len(chains), node, int(child)))
            if following >= 0:
                chain.append(following)
            node = following
        chains.append(chain)
        parents.append(axis_parent)
    return Axes(
        nodes=np.array([node for chain in chains for node in chain], np.int64),
        first=np.cumsum([0, *(len(chain) for chain in chains)], dtype=np.int64),
        parent=np.array(parents, np.int64),
    )
