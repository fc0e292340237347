"""Nodes that know their parents: orders, sums and ways in them, whatever the nodes are."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class RootedTree:
    """One tree or several, by the parent of each node, -1 for a root."""

    parent: NDArray[np.int32]  # (S,)

    @cached_property
    def depth(self) -> NDArray[np.int32]:
        """(S,) nodes between each one and its root."""
        depth = np.full(len(self.parent), -1, np.int32)
        at = np.flatnonzero(self.parent < 0)
        level = 0
        while len(at):
            depth[at] = level
            level += 1
            at = self.children_of(at)
        if (depth < 0).any():
            raise ValueError("some nodes have no root: their parents go in a circle")
        return depth

    @cached_property
    def by_parent(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Nodes ordered by their parent, and (S + 1,) where the children of each begin among them."""
        order = np.argsort(self.parent, kind="stable")
        return order, np.searchsorted(self.parent[order], np.arange(len(self.parent) + 1))

    @cached_property
    def levels(self) -> list[NDArray[np.int64]]:
        """Nodes of each depth, from the roots on."""
        order = np.argsort(self.depth, kind="stable")
        return np.split(order, np.searchsorted(self.depth[order], np.arange(1, int(self.depth.max(initial=0)) + 1)))

    def children_of(self, nodes: NDArray[np.integer]) -> NDArray[np.int64]:
        """The children of these nodes, in their order."""
        order, begin = self.by_parent
        counts = begin[nodes + 1] - begin[nodes]
        starts = np.repeat(begin[nodes], counts)
        within = np.arange(len(starts)) - np.repeat(np.cumsum(counts) - counts, counts)
        return order[starts + within]

    def child_counts(self) -> NDArray[np.int64]:
        """(S,)"""
        return np.bincount(self.parent[self.parent >= 0], minlength=len(self.parent))

    def sum_above(self, own: NDArray[np.floating]) -> NDArray[np.float64]:
        """(S,) what each node and all that it carries hold together."""
        total = np.array(own, np.float64)
        for level in reversed(self.levels[1:]):
            np.add.at(total, self.parent[level], total[level])
        return total

    def sum_below(self, own: NDArray[np.floating]) -> NDArray[np.float64]:
        """(S,) what each node and all on its way to the root hold together."""
        total = np.array(own, np.float64)
        for level in self.levels[1:]:
            total[level] += total[self.parent[level]]
        return total

    def farthest_above(self, step: NDArray[np.floating]) -> NDArray[np.float64]:
        """(S,) length of the longest way up from each node; step (S,) leads to it from its parent."""
        farthest = np.zeros(len(self.parent))
        for level in reversed(self.levels[1:]):
            np.maximum.at(farthest, self.parent[level], farthest[level] + step[level])
        return farthest

    def first_child(self, rank: NDArray[np.floating]) -> NDArray[np.int64]:
        """(S,) of each node's children that of the highest rank (S,), the first of equals; -1 where there is none."""
        first = np.full(len(self.parent), -1, np.int64)
        child = np.flatnonzero(self.parent >= 0)
        ordered = child[np.lexsort((-child, rank[child]))]
        first[self.parent[ordered]] = ordered  # of several the last one stays
        return first


def step_lengths(center_m: NDArray[np.float64], parent: NDArray[np.integer]) -> NDArray[np.float64]:
    """(S,) distance of each node (S, 3) to its parent, 0 of a root."""
    step_m = np.linalg.norm(center_m - center_m[np.maximum(parent, 0)], axis=1)
    step_m[parent < 0] = 0
    return step_m
