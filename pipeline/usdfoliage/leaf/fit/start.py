"""Where fits begin: even samples of the points of leaves, without those that lie apart, and first poses."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.leaf.segmentation.model import FREE_EDGE, LeafPoints

MORTON_BITS = 10  # an axis


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafSamples:
    """Some points of N leaves, leaf after leaf."""

    points_m: NDArray[np.float64]  # (P, 3)
    edge: NDArray[np.uint8]  # (P,), 1 where the leaf ends, else 0
    weights: NDArray[np.float64]  # (P,), 0 for points that lie apart, the others of a leaf alike
    offsets: NDArray[np.int64]  # (N + 1,)

    def take(self, leaves: NDArray[np.integer]) -> "LeafSamples":
        """The samples of these leaves, in this order."""
        sizes = np.diff(self.offsets)[leaves]
        offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        index = np.arange(offsets[-1]) + np.repeat(self.offsets[:-1][leaves] - offsets[:-1], sizes)
        return LeafSamples(
            points_m=self.points_m[index], edge=self.edge[index], weights=self.weights[index], offsets=offsets
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafPoses:
    """Places of N leaves."""

    axes: NDArray[np.float64]  # (N, 3, 3), the leaf's x, y and z in the columns
    base_m: NDArray[np.float64]  # (N, 3)
    length_m: NDArray[np.float64]  # (N,)
    width_m: NDArray[np.float64]  # (N,), across y


def sample_points(points: LeafPoints, interior: int, edge: int, evidence: float) -> LeafSamples:
    """At most so many points of either kind of each leaf, spread evenly, always the same ones.

    Points whose neighbours are far, measured by what is usual in the leaf, get no weight. The weights of a leaf sum to
    evidence: points beside each other err alike.
    """
    leaf = np.repeat(np.arange(len(points)), np.diff(points.offsets))
    is_edge: NDArray[np.bool_] = np.equal(points.kind, FREE_EDGE)
    finite = np.isfinite(points.points_m).all(axis=1)
    order = np.argsort(
        _morton_codes(np.where(finite[:, None], points.points_m, 0.0), leaf, points.offsets), kind="stable"
    )
    order = order[finite[order]]
    chosen = np.sort(
        np.concatenate([_thin(order[~is_edge[order]], leaf, interior), _thin(order[is_edge[order]], leaf, edge)])
    )
    offsets = np.searchsorted(leaf[chosen], np.arange(len(points) + 1)).astype(np.int64)
    samples, edges = points.points_m[chosen], is_edge[chosen]
    weights = np.ones(len(chosen))
    for first, last in pairwise(offsets):
        weights[first:last] = ~_lie_apart(samples[first:last])
    total = np.add.reduceat(np.append(weights, 0.0), offsets[:-1]) if len(points) else np.zeros(0)
    total = np.where(np.diff(offsets) > 0, total, 0.0)
    weights *= np.repeat(evidence / np.maximum(total, evidence), np.diff(offsets))
    return LeafSamples(points_m=samples, edge=edges.astype(np.uint8), weights=weights, offsets=offsets)


def _morton_codes(
    points_m: NDArray[np.float64], leaf: NDArray[np.int64], offsets: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Numbers (P,) that rise from leaf to leaf, and along a curve that fills the box of each."""
    if not len(points_m):
        return np.zeros(0, np.int64)
    filled = np.diff(offsets) > 0
    low, high = np.zeros((2, len(filled), 3))
    low[filled] = np.minimum.reduceat(points_m, offsets[:-1][filled])
    high[filled] = np.maximum.reduceat(points_m, offsets[:-1][filled])
    extent = np.maximum((high - low).max(axis=1), np.finfo(np.float64).tiny)
    cell = ((points_m - low[leaf]) / extent[leaf, None] * ((1 << MORTON_BITS) - 1)).astype(np.int64)
    codes = leaf.astype(np.int64) << (3 * MORTON_BITS)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            codes |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return codes


def _thin(order: NDArray[np.int64], leaf: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """At most so many of each leaf's points, at even steps along an order that goes leaf by leaf."""
    counts = np.bincount(leaf[order], minlength=1)
    rank = np.arange(len(order)) - np.repeat(np.cumsum(counts) - counts, counts)
    count = np.repeat(counts, counts)
    kept = np.minimum(count, most)
    return order[(rank * kept) // count != ((rank - 1) * kept) // count]


def _lie_apart(points_m: NDArray[np.float64], neighbours: int = 4, factor: float = 3.0) -> NDArray[np.bool_]:
    if len(points_m) <= neighbours:
        return np.zeros(len(points_m), bool)
    distance = np.asarray(cKDTree(points_m).query(points_m, k=[neighbours + 1])[0])[:, 0]
    return np.asarray(distance > factor * np.median(distance))


def start_poses(samples: LeafSamples, towards: NDArray[np.float64]) -> LeafPoses:
    """Principal axes of leaves: y along the longest, z towards the cameras; base and apex where the points end.

    Args:
        towards: (N, 3), the mean normal of each leaf.
    """
    count = len(samples.offsets) - 1
    axes, base, length, width = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty(count), np.empty(count)
    for i in range(count):
        part = slice(samples.offsets[i], samples.offsets[i + 1])
        points = samples.points_m[part][samples.weights[part] > 0]
        center = np.median(points, axis=0)
        weights = np.ones(len(points))
        for _ in range(4):
            center = np.average(points, axis=0, weights=weights)
            offsets = points - center
            covariance = (offsets * weights[:, None]).T @ offsets / weights.sum()
            _, vectors = np.linalg.eigh(covariance)
            local = offsets @ vectors
            distance = np.abs(local) / np.maximum(1.4826 * np.median(np.abs(local), axis=0), 1e-12)
            weights = (
                1 / (1 + np.square(distance[:, 0] / 4) + np.square(np.maximum(distance[:, 1:].max(axis=1) - 2, 0))) ** 2
            )
        y, z = vectors[:, 2], vectors[:, 0]
        z = -z if towards[i] @ z < 0 else z
        x = np.cross(y, z)
        inside = weights > 0.1
        low, high = np.percentile(offsets[inside] @ np.stack([x, y], axis=1), [1, 99], axis=0)
        axes[i] = np.stack([x, y, z], axis=1)
        base[i] = center + (low[0] + high[0]) / 2 * x + low[1] * y
        length[i], width[i] = high[1] - low[1], high[0] - low[0]
    return LeafPoses(axes=axes, base_m=base, length_m=length, width_m=width)
