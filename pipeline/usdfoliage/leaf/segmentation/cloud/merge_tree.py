"""A tree of regions: points that lie in one smooth surface are joined first, what hardly touches last.

Each region joins the neighbour with which it is linked most strongly, where that is so the other way round too. That is
about the tree that joining the strongest pair of all, again and again, would give, in far fewer rounds. Every region
that could be a leaf is a node of it.

Source:
    F. Murtagh, A survey of recent advances in hierarchical clustering algorithms, 1983, section 3, for joining
    reciprocal nearest neighbours; links and linkage are our own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.leaf.segmentation.cloud.settings import CloudSegmentationSettings
from usdfoliage.leaf.segmentation.cloud.working_cloud import WorkingCloud

_OFF_BY_DISTANCE = 0.15  # by which a point may lie off its neighbour's plane, in their distance: leaves bend
_WEAKEST = 1e-3  # linkage at which nothing is joined any more


@dataclass(frozen=True, kw_only=True, eq=False)
class Links:
    """E pairs of neighbouring points."""

    first: NDArray[np.int64]  # (E,)
    second: NDArray[np.int64]  # (E,), above the first
    weight: NDArray[np.float64]  # (E,), 0 of different surfaces to 1 in one plane


@dataclass(frozen=True, kw_only=True, eq=False)
class MergeTree:
    """M nodes: the W points, then the regions in the order in which they were joined."""

    parent: NDArray[np.int64]  # (M,), -1 for none
    children: NDArray[np.int64]  # (M, 2), the larger first; -1 of points
    linkage: NDArray[np.float64]  # (M,), between the two children; 0 of points
    across: NDArray[np.float64]  # (M,), sum of the links between the two children
    count: NDArray[np.int64]  # (M,), points
    rounds: NDArray[np.int64]  # (R + 1,), where the nodes of each round begin: those of one do not touch each other
    start: NDArray[np.int64]  # (M,), where its points begin in order
    order: NDArray[np.int64]  # (W,), points, those of every node beside each other

    def __len__(self) -> int:
        return len(self.parent)

    @property
    def points(self) -> int:
        return len(self.order)

    def spans(self) -> list[slice]:
        """The nodes of each round, the first joined first."""
        return [slice(low, high) for low, high in zip(self.rounds[:-1].tolist(), self.rounds[1:].tolist(), strict=True)]


def link_points(cloud: WorkingCloud, settings: CloudSegmentationSettings = CloudSegmentationSettings()) -> Links:
    """Link points that are near each other, the more strongly the more they lie in one surface."""
    near = min(settings.linked_neighbours, cloud.neighbours.shape[1])
    count = len(cloud)
    first = np.repeat(np.arange(count), near)
    second = cloud.neighbours[:, :near].ravel()
    reach_m = settings.reach * cloud.local_spacing_m
    beside = (cloud.distance_m[:, :near].ravel() <= np.minimum(reach_m[first], reach_m[second])) & (first != second)
    first, second = first[beside], second[beside]
    first, second = np.divmod(np.unique(np.minimum(first, second) * count + np.maximum(first, second)), count)
    offset_m = cloud.points_m[second] - cloud.points_m[first]
    normal, other = cloud.normals[first], cloud.normals[second]
    bend_rad = np.arccos(np.clip(np.abs(np.einsum("ni,ni->n", normal, other)), 0, 1))
    off_m = np.maximum(np.abs(np.einsum("ni,ni->n", normal, offset_m)), np.abs(np.einsum("ni,ni->n", other, offset_m)))
    allowed_m = settings.offset_noises * cloud.thickness_m + _OFF_BY_DISTANCE * np.linalg.norm(offset_m, axis=1)
    weight = np.exp(-0.5 * (np.square(bend_rad / settings.bend_rad) + np.square(off_m / allowed_m)))
    return Links(first=first, second=second, weight=weight)


def merge_points(count: int, links: Links, size_power: float) -> MergeTree:
    """Join points to regions, and regions to larger ones.

    Args:
        count: Of points.
        links: Between them.
        size_power: Of the size of the smaller region, by which the sum of links is divided.
    """
    divisor = np.arange(count + 1, dtype=np.float64) ** size_power
    joined, strength, weight, size, rounds = _native.merge_regions(
        count, links.first, links.second, links.weight, divisor, _WEAKEST
    )
    nodes = count + len(joined)
    rounds = rounds + count
    children = np.concatenate([np.full((count, 2), -1, np.int64), joined])
    parent = np.full(nodes, -1, np.int64)
    parent[joined] = np.arange(count, nodes)[:, None]
    sizes = np.concatenate([np.ones(count, np.int64), size])
    start, order = _arrange(parent, children, sizes, rounds, count)
    return MergeTree(
        parent=parent,
        children=children,
        linkage=np.concatenate([np.zeros(count), strength]),
        across=np.concatenate([np.zeros(count), weight]),
        count=sizes,
        rounds=rounds,
        start=start,
        order=order,
    )


def _arrange(
    parent: NDArray[np.int64],
    children: NDArray[np.int64],
    size: NDArray[np.int64],
    rounds: NDArray[np.int64],
    count: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each node's points begin (M,), and the points (W,) in that order."""
    start = np.zeros(len(parent), np.int64)
    roots = np.flatnonzero(parent < 0)
    start[roots] = np.cumsum(size[roots]) - size[roots]
    for low, high in zip(rounds[-2::-1].tolist(), rounds[:0:-1].tolist(), strict=True):
        one, two = children[low:high].T
        start[one] = start[low:high]
        start[two] = start[low:high] + size[one]
    order = np.empty(count, np.int64)
    order[start[:count]] = np.arange(count)
    return start, order
