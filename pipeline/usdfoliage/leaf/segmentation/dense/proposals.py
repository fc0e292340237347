"""Leaves that may be there: fitted to patches, to be judged against all views."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.leaf.fit.prior import LeafPrior, generic_prior
from usdfoliage.leaf.fit.start import LeafSamples, sample_points, start_poses
from usdfoliage.leaf.fit.under_prior import (
    DescentSettings,
    PosedLeaves,
    find_closest_places,
    fit_under_prior,
    version_costs,
)
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.points import LeafPoints

EVIDENCE = 100.0  # independent points that all points of a leaf are worth at most
START, AGAIN = DescentSettings(iterations=12, edge_noise=2.0), DescentSettings(iterations=10, edge_noise=2.0)
START_NOISE, NOISE = 0.02, 0.015  # leaf lengths by which a leaf of the model may miss its points, at first and later
LENGTHS = (0.5, 1.5)  # of the median length, within which fits begin


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposals:
    """N leaves that may be there."""

    leaves: Leaves
    explained: NDArray[np.float64]  # (N,), share of the points each was fitted to that lie on it

    def __len__(self) -> int:
        return len(self.leaves)

    def take(self, chosen: NDArray[np.generic]) -> "Proposals":
        return Proposals(leaves=self.leaves.take(chosen), explained=self.explained[chosen])

    def numbers(self) -> NDArray[np.float64]:
        """(N, 22), as priors take them: parameters, logarithm of the length."""
        return np.column_stack([self.leaves.parameters.reshape(-1, 21), np.log(self.leaves.length_m)])


def join_proposals(first: Proposals, second: Proposals) -> Proposals:
    """Those of the first, then those of the second."""
    a, b = first.leaves, second.leaves
    joined = Leaves(
        parameters=np.concatenate([a.parameters, b.parameters]),
        base_m=np.concatenate([a.base_m, b.base_m]),
        orientation=np.concatenate([a.orientation, b.orientation]),
        length_m=np.concatenate([a.length_m, b.length_m]),
        phase=np.concatenate([a.phase, b.phase]),
    )
    return Proposals(leaves=joined, explained=np.concatenate([first.explained, second.explained]))


def propose_leaves(
    points: LeafPoints, length_m: float, width: float, tolerance_m: float, *, threads: int = 0
) -> Proposals:
    """A leaf for each set of points, fitted from its principal axes under a prior that knows the median size alone.

    Args:
        points: Of M leaves.
        length_m: The median length.
        width: The median width, in lengths.
        tolerance_m: Within it a point lies on a leaf.
    """
    samples = sample_points(points, 150, 80, EVIDENCE)
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(points.normals, axis=0)])
    poses = start_poses(samples, sums[points.offsets[1:]] - sums[points.offsets[:-1]])
    prior = generic_prior(length_m, width)
    count = len(points)
    start = PosedLeaves(
        parameters=np.repeat(prior.mean[:21].reshape(1, 7, 3), count, axis=0),
        axes=poses.axes,
        base_m=poses.base_m,
        length_m=np.clip(poses.length_m, LENGTHS[0] * length_m, LENGTHS[1] * length_m),
        costs=np.zeros((count, 3)),
    )
    every, version = np.arange(count), np.zeros(count, np.int64)
    noise_m = np.full(count, START_NOISE * length_m)
    fits = _as_leaves(fit_under_prior(samples, start, prior, every, version, noise_m, START, threads=threads))
    return Proposals(leaves=fits, explained=_explained(samples, fits, tolerance_m, threads))


def refit_proposals(
    points: LeafPoints, proposals: Proposals, prior: LeafPrior, tolerance_m: float, *, threads: int = 0
) -> Proposals:
    """The proposals, one for each set of points, improved under a prior learned of the set, in its best version."""
    samples = sample_points(points, 200, 100, EVIDENCE)
    count, start = len(points), _posed(proposals.leaves)
    noise_m = np.full(count, NOISE * float(np.exp(prior.mean[-1])))
    # The version that suits a leaf as it is, and the next best: the others lie far off.
    likely = np.argsort(version_costs(proposals.numbers(), prior), axis=0, kind="stable")[:2].astype(np.int64)
    every = np.arange(count)
    tried = fit_under_prior(
        samples, start.take(np.tile(every, 2)), prior, np.tile(every, 2), likely.ravel(), noise_m, AGAIN,
        threads=threads,
    )  # fmt: skip
    better = tried.costs.sum(axis=1).reshape(2, count).argmin(axis=0)
    best = _as_leaves(tried.take(better * count + every))
    return Proposals(leaves=best, explained=_explained(samples, best, tolerance_m, threads))


def _posed(leaves: Leaves) -> PosedLeaves:
    count = len(leaves)
    return PosedLeaves(
        parameters=leaves.parameters,
        axes=Rotation.from_quat(leaves.orientation).as_matrix() if count else np.zeros((0, 3, 3)),
        base_m=leaves.base_m,
        length_m=leaves.length_m,
        costs=np.zeros((count, 3)),
    )


def _as_leaves(posed: PosedLeaves) -> Leaves:
    count = len(posed.length_m)
    return Leaves(
        parameters=posed.parameters,
        base_m=posed.base_m,
        orientation=Rotation.from_matrix(posed.axes).as_quat() if count else np.zeros((0, 4)),
        length_m=posed.length_m,
        phase=np.zeros(count),
    )


def _explained(samples: LeafSamples, leaves: Leaves, tolerance_m: float, threads: int) -> NDArray[np.float64]:
    anywhere = np.zeros_like(samples.edge)
    _, distance_m = find_closest_places(samples, anywhere, _posed(leaves), threads=threads)
    leaf = np.repeat(np.arange(len(leaves)), np.diff(samples.offsets))
    counted = samples.weights > 0
    total = np.bincount(leaf[counted], minlength=len(leaves))
    close = np.bincount(leaf[counted], np.abs(distance_m[counted]) < tolerance_m, minlength=len(leaves))
    return np.asarray(close / np.maximum(total, 1))
