"""Leaves that may be there: fitted to patches, to be judged against all views."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage import _native
from usdfoliage.leaf.fit.prior import LeafPrior, generic_prior
from usdfoliage.leaf.fit.start import LeafSamples, sample_points, start_poses
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.segmentation.model import LeafPoints

EVIDENCE = 100.0  # independent points that all points of a leaf are worth at most
FIRST_CUTOFF, LAST_CUTOFF = 6.0, 2.5  # noises beyond which points count less
EDGE_NOISE = 2.0  # of points of the edge, in that of the interior
FOLD_WEIGHT = 2000.0
START_NOISE, NOISE = 0.02, 0.015  # leaf lengths by which a leaf of the model may miss its points, at first and later
LENGTHS = (0.5, 1.5)  # of the usual length, within which fits begin


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
    """A leaf for each set of points, fitted from its principal axes under a prior that knows the usual size alone.

    Args:
        points: Of M leaves.
        length_m: The usual length.
        width: The usual width, in lengths.
        tolerance_m: Within it a point lies on a leaf.
    """
    samples = sample_points(points, 150, 80, EVIDENCE)
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(points.normals, axis=0)])
    poses = start_poses(samples, sums[points.offsets[1:]] - sums[points.offsets[:-1]])
    prior = generic_prior(length_m, width)
    count = len(points)
    every, version = np.arange(count), np.zeros(count, np.int64)
    parameters = np.repeat(prior.mean[:21].reshape(1, 7, 3), count, axis=0)
    lengths = np.clip(poses.length_m, LENGTHS[0] * length_m, LENGTHS[1] * length_m)
    noise_m = np.full(count, START_NOISE * length_m)
    fits, _ = _fit(
        samples, noise_m, prior, every, version, parameters, poses.axes, poses.base_m, lengths, iterations=12,
        threads=threads,
    )  # fmt: skip
    return Proposals(leaves=fits, explained=_explained(samples, fits, tolerance_m, threads))


def refit_proposals(
    points: LeafPoints, proposals: Proposals, prior: LeafPrior, tolerance_m: float, *, threads: int = 0
) -> Proposals:
    """The proposals, one for each set of points, improved under a prior learned of the set, in its best version."""
    samples = sample_points(points, 200, 100, EVIDENCE)
    count, leaves = len(points), proposals.leaves
    means, precisions = prior.versions()
    offsets = proposals.numbers() - means[:, None]
    cost = np.einsum("gni,gij,gnj->gn", offsets, precisions, offsets, optimize=True)
    noise_m = np.full(count, NOISE * float(np.exp(prior.mean[-1])))
    axes = Rotation.from_quat(leaves.orientation).as_matrix() if count else np.zeros((0, 3, 3))
    best: Leaves | None = None
    # The version that suits a leaf as it is, and the next best: the others lie far off.
    order = np.argsort(cost, axis=0, kind="stable")
    least = np.full(count, np.inf)
    for rank in range(2):
        fits, total = _fit(
            samples, noise_m, prior, np.arange(count), order[rank].astype(np.int64), leaves.parameters, axes,
            leaves.base_m, leaves.length_m, iterations=10, threads=threads,
        )  # fmt: skip
        if best is None:
            best, least = fits, total
            continue
        better = total < least
        best = replace(
            best,
            **{
                name: np.where(better.reshape(-1, *[1] * (getattr(fits, name).ndim - 1)), getattr(fits, name),
                               getattr(best, name))
                for name in ("parameters", "base_m", "orientation", "length_m")
            },
        )  # fmt: skip
    assert best is not None
    return Proposals(leaves=best, explained=_explained(samples, best, tolerance_m, threads))


def _fit(
    samples: LeafSamples,
    noise_m: NDArray[np.float64],
    prior: LeafPrior,
    leaf: NDArray[np.int64],
    version: NDArray[np.int64],
    parameters: NDArray[np.float64],
    axes: NDArray[np.float64],
    base_m: NDArray[np.float64],
    length_m: NDArray[np.float64],
    *,
    iterations: int,
    threads: int,
) -> tuple[Leaves, NDArray[np.float64]]:
    """The fits, and what each costs."""
    means, precisions = prior.versions()
    parameters, axes, base_m, length_m = (
        np.array(array, np.float64, order="C") for array in (parameters, axes, base_m, length_m)
    )
    costs = np.empty((len(leaf), 3))
    _native.fit_leaf_surfaces(
        samples.points_m, samples.edge, samples.weights, samples.offsets, noise_m, means,
        np.ascontiguousarray(precisions), leaf, version, parameters, axes, base_m, length_m, costs, iterations,
        FIRST_CUTOFF, LAST_CUTOFF, EDGE_NOISE, FOLD_WEIGHT, threads,
    )  # fmt: skip
    leaves = Leaves(
        parameters=parameters,
        base_m=base_m,
        orientation=Rotation.from_matrix(axes).as_quat() if len(axes) else np.zeros((0, 4)),
        length_m=length_m,
        phase=np.zeros(len(leaf)),
    )
    return leaves, costs.sum(axis=1)


def _explained(samples: LeafSamples, leaves: Leaves, tolerance_m: float, threads: int) -> NDArray[np.float64]:
    uv, distance_m = np.empty((len(samples.points_m), 2)), np.empty(len(samples.points_m))
    axes = Rotation.from_quat(leaves.orientation).as_matrix() if len(leaves) else np.zeros((0, 3, 3))
    _native.project_to_leaves(
        samples.points_m, np.zeros_like(samples.edge), samples.offsets, leaves.parameters, np.ascontiguousarray(axes),
        leaves.base_m, leaves.length_m, uv, distance_m, threads,
    )  # fmt: skip
    leaf = np.repeat(np.arange(len(leaves)), np.diff(samples.offsets))
    counted = samples.weights > 0
    total = np.bincount(leaf[counted], minlength=len(leaves))
    close = np.bincount(leaf[counted], np.abs(distance_m[counted]) < tolerance_m, minlength=len(leaves))
    return np.asarray(close / np.maximum(total, 1))
