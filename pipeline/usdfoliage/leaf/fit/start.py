"""Where fits begin: even samples of the points of leaves, without those that lie apart, and first poses."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.leaf.points import FREE_EDGE, LeafPoints

BEFORE_SPREAD = 4  # times as many points are looked at as are wanted
APART = 3.0  # typical distances to a near neighbour, beyond which a point lies apart from its leaf
POSE_POINTS = 96  # of a leaf, for its pose
POSE_ROUNDS = 4  # of leaving out what is far from the others


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafSamples:
    """Some points of N leaves, leaf after leaf."""

    points_m: NDArray[np.float64]  # (P, 3)
    edge: NDArray[np.uint8]  # (P,), 1 where the leaf ends, else 0
    weights: NDArray[np.float64]  # (P,), 0 for points that lie apart, equal for the others of a leaf
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

    def take(self, chosen: NDArray[np.integer]) -> "LeafPoses":
        """The poses of these leaves, in this order."""
        return LeafPoses(**{name: getattr(self, name)[chosen] for name in self.__dataclass_fields__})

    def append(self, other: "LeafPoses") -> "LeafPoses":
        """These poses, then the others."""
        both = {name: (getattr(self, name), getattr(other, name)) for name in self.__dataclass_fields__}
        return LeafPoses(**{name: np.concatenate(pair) for name, pair in both.items()})


def sample_points(points: LeafPoints, interior: int, edge: int, evidence: float, *, threads: int = 0) -> LeafSamples:
    """At most so many points of either kind of each leaf, spread evenly, always the same ones.

    Points whose neighbours are far, measured by the typical distance in the leaf, get no weight. The weights of a leaf
    sum to
    evidence: points beside each other have the same error. No point that is not finite is taken.
    """
    is_edge = np.equal(points.kind, FREE_EDGE).astype(np.uint8)
    sampled = _native.sample_leaf_points(
        np.ascontiguousarray(points.points_m, np.float64),
        is_edge,
        np.asarray(points.offsets, np.int64),
        settings=_native.SampleSettings(interior=interior, edge=edge, before_spread=BEFORE_SPREAD, apart=APART),
        threads=threads,
    )
    chosen, beside = sampled.index, (sampled.apart == 0).astype(np.float64)
    return _weighed(points.points_m[chosen], is_edge[chosen], beside, sampled.offsets, evidence)


def thin_samples(samples: LeafSamples, step: int) -> LeafSamples:
    """Every so manieth sample of either kind, with the weight of all."""
    leaf = np.repeat(np.arange(len(samples.offsets) - 1), np.diff(samples.offsets))
    kept = np.zeros(len(leaf), bool)
    for kind in (0, 1):
        kept[np.flatnonzero(samples.edge == kind)[::step]] = True
    offsets = np.searchsorted(leaf[kept], np.arange(len(samples.offsets))).astype(np.int64)
    return LeafSamples(
        points_m=samples.points_m[kept], edge=samples.edge[kept], weights=samples.weights[kept] * step, offsets=offsets
    )


def _weighed(
    points_m: NDArray[np.float64],
    edge: NDArray[np.uint8],
    weights: NDArray[np.float64],
    offsets: NDArray[np.int64],
    evidence: float,
) -> LeafSamples:
    total = np.diff(np.concatenate([[0.0], np.cumsum(weights)])[offsets])
    factor = evidence / np.maximum(total, evidence)
    return LeafSamples(
        points_m=points_m, edge=edge, weights=weights * np.repeat(factor, np.diff(offsets)), offsets=offsets
    )


def start_poses(samples: LeafSamples, towards: NDArray[np.float64]) -> LeafPoses:
    """Principal axes of leaves: y along the longest, z towards the cameras; base and apex where the points end.

    Args:
        towards: (N, 3), the mean normal of each leaf.
    """
    sizes = np.diff(samples.offsets)
    places = samples.offsets[:-1, None] + np.arange(POSE_POINTS) * sizes[:, None] // POSE_POINTS
    points, weights = samples.points_m[places], (samples.weights[places] > 0).astype(np.float64)
    given, local = weights, points
    for _ in range(POSE_ROUNDS):
        center = np.einsum("nk,nkc->nc", weights, points) / np.maximum(weights.sum(axis=1), 1e-12)[:, None]
        offsets = points - center[:, None]
        _, vectors = np.linalg.eigh(np.einsum("nk,nki,nkj->nij", weights, offsets, offsets))
        local = offsets @ vectors
        typical = np.maximum(1.4826 * np.median(np.abs(local), axis=1), np.finfo(np.float64).tiny)
        far = np.abs(local) / typical[:, None]
        beside = np.maximum(far[..., 1:].max(axis=-1) - 2, 0)
        weights = given / (1 + np.square(far[..., 0] / 4) + np.square(beside)) ** 2
    y, z = vectors[..., 2], vectors[..., 0]
    z = z * np.where(np.einsum("nc,nc->n", towards, z) < 0, -1.0, 1.0)[:, None]
    x = np.cross(y, z)
    across = np.where(weights > 0.1, np.einsum("nkc,nc->nk", offsets, x), np.nan)
    along = np.where(weights > 0.1, np.einsum("nkc,nc->nk", offsets, y), np.nan)
    (left, low), (right, high) = ([_row_percentiles(each, percent) for each in (across, along)] for percent in (1, 99))
    return LeafPoses(
        axes=np.stack([x, y, z], axis=-1),
        base_m=center + ((left + right) / 2)[:, None] * x + low[:, None] * y,
        length_m=high - low,
        width_m=right - left,
    )


def turn_across(poses: LeafPoses) -> LeafPoses:
    """The same extents with y along what was the width."""
    x, y, z = np.moveaxis(poses.axes, -1, 0)
    middle = poses.base_m + poses.length_m[:, None] / 2 * y
    return LeafPoses(
        axes=np.stack([-y, x, z], axis=-1),
        base_m=middle - poses.width_m[:, None] / 2 * x,
        length_m=poses.width_m,
        width_m=poses.length_m,
    )


def _row_percentiles(values: NDArray[np.float64], percent: float) -> NDArray[np.float64]:
    """np.nanpercentile along the rows (N, K), for all of them at once; NaN for rows without numbers."""
    ordered = np.sort(values, axis=1)  # NaN last
    last = np.maximum(np.count_nonzero(~np.isnan(values), axis=1) - 1, 0)
    place = percent / 100 * last
    below = np.floor(place).astype(np.int64)
    rows = np.arange(len(values))
    low, high = ordered[rows, below], ordered[rows, np.minimum(below + 1, last)]
    return np.asarray(low + (high - low) * (place - below))
