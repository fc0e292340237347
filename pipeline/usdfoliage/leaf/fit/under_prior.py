"""Leaves improved by the closest places of their points, under a prior: from anywhere near, many at once."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.leaf.fit.prior import LeafPrior
from usdfoliage.leaf.fit.start import LeafSamples
from usdfoliage.native_settings import native_settings


@dataclass(frozen=True, kw_only=True)
class DescentSettings:
    """How fits go on."""

    iterations: int
    edge_noise: float = 1.0  # noise of points of the edge, in that of the interior
    fold_weight: float = 2000.0  # of leaves that fold over themselves
    first_cutoff: float = 6.0  # noises beyond which points count less, at first
    cutoff: float = 2.5  # the same in the last third of the iterations


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedLeaves:
    """N leaves under way."""

    parameters: NDArray[np.float64]  # (N, 7, 3)
    axes: NDArray[np.float64]  # (N, 3, 3), the leaf's x, y and z in the columns
    base_m: NDArray[np.float64]  # (N, 3)
    length_m: NDArray[np.float64]  # (N,)
    costs: NDArray[np.float64]  # (N, 3), of points, prior and folds

    def take(self, index: NDArray[np.integer]) -> "PosedLeaves":
        fields = {name: getattr(self, name)[index] for name in self.__dataclass_fields__}
        return replace(self, **fields)

    def numbers(self) -> NDArray[np.float64]:
        """(N, 22), as priors take them: parameters, logarithm of the length."""
        return np.concatenate([self.parameters.reshape(-1, 21), np.log(self.length_m)[:, None]], axis=1)


def fit_under_prior(
    samples: LeafSamples,
    start: PosedLeaves,
    prior: LeafPrior,
    leaf: NDArray[np.int64],
    version: NDArray[np.int64],
    noise_m: NDArray[np.float64],
    settings: DescentSettings,
    *,
    threads: int = 0,
) -> PosedLeaves:
    """N fits from where they start.

    Args:
        samples: Of M leaves.
        leaf: (N,), whose points each is fitted to.
        version: (N,), of the prior, as in LeafPrior.versions.
        noise_m: (M,), standard deviation of the points of the interior.
        threads: At most so many, 0 for one per core; the result does not depend on it.
    """
    means, precisions = prior.versions()
    parameters, axes, base_m, length_m = (
        np.array(array, np.float64, order="C") for array in (start.parameters, start.axes, start.base_m, start.length_m)
    )
    costs = np.empty((len(leaf), 3))
    _native.fit_leaf_surfaces(
        _native.SurfacePoints(
            points_m=samples.points_m,
            edge=samples.edge,
            weights=samples.weights,
            offsets=samples.offsets,
            noise_m=noise_m,
        ),
        _native.SurfacePriors(means=means, precisions=np.ascontiguousarray(precisions)),
        _native.SurfaceFits(
            leaf=leaf,
            version=version,
            parameters=parameters,
            axes=axes,
            base_m=base_m,
            length_m=length_m,
            costs=costs,
        ),
        settings=native_settings(_native.SurfaceFitSettings, settings),
        threads=threads,
    )
    return PosedLeaves(parameters=parameters, axes=axes, base_m=base_m, length_m=length_m, costs=costs)


def find_closest_places(
    samples: LeafSamples, edge: NDArray[np.uint8], leaves: PosedLeaves, *, threads: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Closest places (P, 2) of leaves to their samples, as u and v, and the distances (P,).

    Args:
        edge: (P,), 1 for samples whose places are on the silhouette.
    """
    closest = _native.project_to_leaves(
        samples.points_m,
        _native.PosedLeaves(
            parameters=leaves.parameters,
            axes=np.ascontiguousarray(leaves.axes),
            base_m=leaves.base_m,
            length_m=leaves.length_m,
        ),
        edge=edge,
        offsets=samples.offsets,
        threads=threads,
    )
    return closest.uv, closest.distance_m


def version_costs(numbers: NDArray[np.float64], prior: LeafPrior) -> NDArray[np.float64]:
    """How far leaves (N, 22) are from each version of a prior: (4, N), twice its cost."""
    means, precisions = prior.versions()
    offsets = numbers - means[:, None]
    return np.asarray(np.einsum("gni,gij,gnj->gn", offsets, precisions, offsets, optimize=True))
