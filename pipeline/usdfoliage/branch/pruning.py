"""Leaving branches out of a skeleton without losing what they carry. The method is our own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton


@dataclass(frozen=True, kw_only=True, eq=False)
class PrunedSkeleton:
    """A skeleton of K branches that stay of B."""

    skeleton: Skeleton
    number: NDArray[np.int32]  # (B,), of each old branch in it; -1 of those that are left out
    prefix_m: NDArray[np.float64]  # (K,), by how much each one begins before its old first point


def prune_branches(skeleton: Skeleton, stays: NDArray[np.bool_]) -> PrunedSkeleton:
    """Leave out branches, and let what they carry go on from what they sprang from, along their axes.

    Args:
        skeleton: All B branches.
        stays: (B,), one at least.

    Raises:
        ValueError: None stays.
    """
    if not stays.any():
        raise ValueError("a skeleton has a branch at least")
    number = np.where(stays, np.cumsum(stays) - 1, -1).astype(np.int32)
    parent_curve, leaves = skeleton.parent_curve.astype(np.int64), skeleton.parent_vertex.astype(np.int64)
    prefixes: dict[int, NDArray[np.int64]] = {}  # old points before a branch's own first
    for branch in np.flatnonzero(stays & (parent_curve >= 0)).tolist():
        passed, below, vertex = pass_through(skeleton, branch, stays)
        if len(passed):
            prefixes[branch] = passed
        parent_curve[branch], leaves[branch] = below, vertex
    kept = np.flatnonzero(stays)
    added = np.array([len(prefixes.get(branch, ())) for branch in kept.tolist()], np.int64)
    counts = skeleton.counts[kept] + added
    first = np.cumsum(counts) - counts
    source = np.concatenate(
        [np.concatenate([prefixes.get(branch, kept[:0]), _own(skeleton, branch)]) for branch in kept.tolist()]
    )
    radius_m = skeleton.radius_m[source]
    for index in np.flatnonzero(added).tolist():  # what was passed through may have been thicker or thinner
        radius_m[first[index] : first[index] + added[index]] = radius_m[first[index] + added[index]]
    parent, vertex_of = parent_curve[kept], leaves[kept]
    child = parent >= 0
    above = number[parent]
    within = vertex_of - skeleton.first[parent] + added[above] + first[above]
    order = np.zeros(len(kept), np.int32)
    for index in np.flatnonzero(child).tolist():  # parents first
        order[index] = order[above[index]] + 1
    pruned = Skeleton(
        points_m=skeleton.points_m[source],
        radius_m=radius_m,
        counts=counts.astype(np.int32),
        parent_curve=np.where(child, above, -1).astype(np.int32),
        parent_vertex=np.where(child, within, -1).astype(np.int32),
        order=order,
        inferred=skeleton.inferred[kept],
    )
    return PrunedSkeleton(skeleton=pruned, number=number, prefix_m=pruned.arcs_m[first + added])


def pass_through(skeleton: Skeleton, branch: int, stays: NDArray[np.bool_]) -> tuple[NDArray[np.int64], int, int]:
    """The way of a branch through those below it that do not stay (B,): vertices (n,) that come before its own first
    one, and the branch and the vertex that it leaves then, -1 where none stays."""
    passed = [np.zeros(0, np.int64)]
    below, vertex = int(skeleton.parent_curve[branch]), int(skeleton.parent_vertex[branch])
    while below >= 0 and not stays[below]:
        passed.insert(0, np.arange(skeleton.first[below], vertex))  # its last point is the next one's first
        below, vertex = int(skeleton.parent_curve[below]), int(skeleton.parent_vertex[below])
    return np.concatenate(passed), below, vertex


def _own(skeleton: Skeleton, branch: int) -> NDArray[np.int64]:
    part = skeleton.branch(branch)
    return np.arange(part.start, part.stop)
