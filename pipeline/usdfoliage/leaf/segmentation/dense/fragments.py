"""Leaves of which only parts were found: pieces that belong together, and which of them to try as one."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.leaf.points import LeafPoints
from usdfoliage.leaf.segmentation.dense.proposals import Proposals

MAX_POINTS = 150  # of a piece, to measure gaps with
GAP, LENGTH, SHORT = 0.12, 1.6, 1.2  # median leaf lengths: between pieces, of both together, of the shorter piece


def pair_fragments(proposals: Proposals, points: LeafPoints, median_m: float) -> NDArray[np.int64]:
    """Pairs (K, 2) of proposals near each other that together are not longer than a leaf.

    Args:
        proposals: N.
        points: Of the N proposals.
        median_m: The median length of a leaf.
    """
    count = len(proposals)
    few = [_few(points, leaf) for leaf in range(count)]
    middles = np.array([part.mean(axis=0) if len(part) else np.full(3, np.inf) for part in few]).reshape(-1, 3)
    known = np.flatnonzero(np.isfinite(middles[:, 0]))
    if len(known) < 2:
        return np.zeros((0, 2), np.int64)
    near = known[cKDTree(middles[known]).query_pairs(median_m, output_type="ndarray")]
    lengths = proposals.leaves.length_m
    chosen = []
    for first, second in near[np.lexsort((near[:, 1], near[:, 0]))]:
        if min(lengths[first], lengths[second]) > SHORT * median_m:
            continue
        if np.min(cKDTree(few[first]).query(few[second])[0]) > GAP * median_m:
            continue
        both = np.concatenate([few[first], few[second]])
        both = both - both.mean(axis=0)
        longest = np.linalg.eigh(both.T @ both)[1][:, 2]
        if np.ptp(both @ longest) < LENGTH * median_m:
            chosen.append((first, second))
    return np.asarray(chosen, np.int64).reshape(-1, 2)


def join_points(points: LeafPoints, pairs: NDArray[np.integer]) -> LeafPoints:
    """The points of the leaves of each row (K, S) together, as K leaves; the view is that of the first."""
    parts = [np.arange(points.offsets[leaf], points.offsets[leaf + 1]) for pair in pairs for leaf in pair]
    index = np.concatenate([*parts, np.zeros(0, np.int64)]).astype(np.int64)
    sizes = np.array([len(part) for part in parts], np.int64).reshape(pairs.shape).sum(axis=1)
    return LeafPoints(
        points_m=points.points_m[index],
        normals=points.normals[index],
        kind=points.kind[index],
        point_view=points.point_view[index],
        offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        confidence=points.confidence[pairs].min(axis=1),
        view=points.view[pairs[:, 0]],
    )


def take_leaves(points: LeafPoints, chosen: NDArray[np.integer]) -> LeafPoints:
    """The points of the leaves of these numbers, in this order."""
    return join_points(points, chosen[:, None])


def append_points(first: LeafPoints, second: LeafPoints) -> LeafPoints:
    """The leaves of the first, then those of the second."""
    return LeafPoints(
        points_m=np.concatenate([first.points_m, second.points_m]),
        normals=np.concatenate([first.normals, second.normals]),
        kind=np.concatenate([first.kind, second.kind]),
        point_view=np.concatenate([first.point_view, second.point_view]),
        offsets=np.concatenate([first.offsets, second.offsets[1:] + first.offsets[-1]]),
        confidence=np.concatenate([first.confidence, second.confidence]),
        view=np.concatenate([first.view, second.view]),
    )


def _few(points: LeafPoints, leaf: int) -> NDArray[np.float64]:
    part = points.points_m[points.offsets[leaf] : points.offsets[leaf + 1]]
    return part[:: max(1, len(part) // MAX_POINTS)]
