"""A skeleton as nodes that each know the one before: the form in which branches grow and are cut off."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree


@dataclass(frozen=True, kw_only=True, eq=False)
class NodeTree:
    """Nodes of axes; those of an axis, and axes, come in the order in which they spring from each other."""

    position_m: NDArray[np.float64]  # (N, 3)
    radius_m: NDArray[np.float64]  # (N,), NaN where it is not known yet
    parent: NDArray[np.int32]  # (N,), the node before each one, of its own axis or of that which it springs from; -1
    axis: NDArray[np.int32]  # (N,)
    fork: NDArray[np.int32]  # (A,), the node that each axis springs from, -1 for a root's
    parent_axis: NDArray[np.int32]  # (A,), the axis that it springs from: at its own fork a node is another axis'; -1
    base_radius_m: NDArray[np.float64]  # (A,), of the axis at its fork; NaN: as of its first node

    def __len__(self) -> int:
        return len(self.parent)

    def carried_by(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(A,) axes that are chosen (A,), or spring from such at last."""
        carried = chosen.copy()
        for level in RootedTree(self.parent_axis).levels[1:]:
            carried[level] |= carried[self.parent_axis[level]]
        return carried

    def without(self, cut: NDArray[np.bool_]) -> "NodeTree":
        """What is left where axes (A,) are cut off, with all that they carry."""
        gone = self.carried_by(cut)
        stays = ~gone[self.axis]
        number = np.cumsum(stays, dtype=np.int32) - 1
        axis_number = np.cumsum(~gone, dtype=np.int32) - 1
        parent, fork, parent_axis = self.parent[stays], self.fork[~gone], self.parent_axis[~gone]
        return NodeTree(
            position_m=self.position_m[stays],
            radius_m=self.radius_m[stays],
            parent=np.where(parent < 0, -1, number[parent]).astype(np.int32),
            axis=axis_number[self.axis[stays]],
            fork=np.where(fork < 0, -1, number[fork]).astype(np.int32),
            parent_axis=np.where(parent_axis < 0, -1, axis_number[parent_axis]).astype(np.int32),
            base_radius_m=self.base_radius_m[~gone],
        )


def node_tree(skeleton: Skeleton, longest_m: float) -> NodeTree:
    """The vertices of a skeleton, and others between them where they are farther apart than longest_m."""
    count = len(skeleton.points_m)
    shared = np.zeros(count, bool)
    shared[skeleton.first[skeleton.parent_curve >= 0]] = True
    before = np.arange(count) - 1
    before[skeleton.first] = -1
    step_m = np.linalg.norm(skeleton.points_m - skeleton.points_m[before], axis=1)
    pieces = np.where(before < 0, 1, np.maximum(1, np.ceil(step_m / longest_m - 1e-9))).astype(np.int64)
    of = np.repeat(np.arange(count), pieces)
    share = (np.arange(len(of)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 1) / pieces[of]
    start = np.where(before[of] < 0, of, before[of])
    own = ~shared[of]
    number = np.cumsum(own, dtype=np.int32) - 1
    vertex = np.where(shared, -1, number[np.cumsum(pieces) - 1])  # of each of the skeleton's own
    for vertex_shared in np.flatnonzero(shared):  # parents first: one may spring from its parent's own fork
        vertex[vertex_shared] = vertex[skeleton.parent_vertex[skeleton.curve[vertex_shared]]]
    position_m = skeleton.points_m[start] + share[:, None] * (skeleton.points_m[of] - skeleton.points_m[start])
    radius_m = skeleton.radius_m[start] + share * (skeleton.radius_m[of] - skeleton.radius_m[start])
    whole = share == 1
    position_m[whole], radius_m[whole] = skeleton.points_m[of[whole]], skeleton.radius_m[of[whole]]
    first_piece = np.concatenate([[True], of[1:] != of[:-1]])
    parent = np.where(first_piece, np.where(before[of] < 0, -1, vertex[before[of]]), number - 1)
    fork = np.where(skeleton.parent_vertex < 0, -1, vertex[skeleton.parent_vertex])
    return NodeTree(
        position_m=position_m[own],
        radius_m=radius_m[own],
        parent=parent[own].astype(np.int32),
        axis=skeleton.curve[of[own]],
        fork=fork.astype(np.int32),
        parent_axis=skeleton.parent_curve,
        base_radius_m=skeleton.radius_m[skeleton.first],
    )


def as_skeleton(tree: NodeTree) -> Skeleton:
    """The axes as polylines.

    Raises:
        ValueError: A radius is not known, or an axis without a fork has a single node.
    """
    axes = len(tree.fork)
    order = np.argsort(tree.axis, kind="stable")
    forked = tree.fork >= 0
    counts = np.bincount(tree.axis, minlength=axes) + forked
    first = np.cumsum(counts) - counts
    place = np.zeros(len(tree), np.int64)
    place[order] = np.arange(len(tree)) + np.cumsum(forked)[tree.axis[order]]
    total = int(counts.sum())
    points_m, radius_m = np.empty((total, 3)), np.empty(total)
    points_m[place], radius_m[place] = tree.position_m, tree.radius_m
    points_m[first[forked]] = tree.position_m[tree.fork[forked]]
    begins_m = tree.base_radius_m[forked]
    radius_m[first[forked]] = np.where(np.isnan(begins_m), radius_m[first[forked] + 1], begins_m)
    from_fork = forked & (tree.axis[tree.fork] != tree.parent_axis)
    leaves_from = np.where(from_fork, first[tree.parent_axis], place[tree.fork])
    return Skeleton(
        points_m=points_m,
        radius_m=radius_m,
        counts=counts.astype(np.int32),
        parent_curve=tree.parent_axis,
        parent_vertex=np.where(forked, leaves_from, -1).astype(np.int32),
        order=RootedTree(tree.parent_axis).depth,
    )
