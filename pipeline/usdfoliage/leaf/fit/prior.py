"""What leaves of a set look like: a normal distribution, first guessed, then learned from the set.

A prior completes what a leaf does not show. It is over the 21 parameters and the logarithm of the length. A leaf may
lie either way round in its fit and a species may grow both left- and right-handed leaves, so that a prior has four
versions: as it is, with base and apex exchanged, mirrored, and both. Our own idea.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NUMBERS = 22  # the parameters of a leaf, row after row, and the logarithm of its length
LENGTH_SPREAD = 0.35  # standard deviation of the logarithm of the length, before leaves were seen
MIN_SPREAD = 0.01  # of any number, so that many similar leaves do not exclude another

# Rows of the parameters, as in leaf.model.PARAMETERS.
_ENDS_EXCHANGED = [1, 0, 4, 3, 2, 5, 6]
_FROM_BASE = np.array([1, 4, 6, 9, 12])  # numbers measured from base to apex
_TO_THE_RIGHT = np.array([0, 3])  # numbers that a mirror negates


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafPrior:
    """A normal distribution of leaves."""

    mean: NDArray[np.float64]  # (22,), parameters row after row, logarithm of the length in metres
    covariance: NDArray[np.float64]  # (22, 22)
    learned: int = 0  # of so many leaves

    def __post_init__(self) -> None:
        if self.mean.shape != (NUMBERS,) or self.covariance.shape != (NUMBERS, NUMBERS):
            raise ValueError(f"a prior is (22,) and (22, 22), not {self.mean.shape} and {self.covariance.shape}")

    def versions(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Means (4, 22) and precisions (4, 22, 22) of the prior, its ends exchanged, mirrored, and both."""
        precision = np.linalg.inv(self.covariance)
        matrices, shifts = _symmetries()
        means = matrices @ self.mean + shifts
        return means, matrices @ precision @ matrices.transpose(0, 2, 1)

    def exchanged(self) -> "LeafPrior":
        """The prior with base and apex exchanged."""
        matrices, shifts = _symmetries()
        matrix = matrices[1]
        return LeafPrior(
            mean=matrix @ self.mean + shifts[1],
            covariance=matrix @ self.covariance @ matrix.T,
            learned=self.learned,
        )


def generic_prior(length_m: float, width: float) -> LeafPrior:
    """What is known of a leaf before any was seen: flat, an ellipse, not sure of anything.

    Args:
        length_m: Of a leaf, from base to apex.
        width: Of a leaf, in leaf lengths.
    """
    half = width / 2
    mean = np.zeros((7, 3))
    mean[:2, 1] = 1 / 3, 2 / 3
    mean[2:5, 0] = 0.07, 0.5, 0.93
    mean[2:5, 1] = 0.9 * half, 1.2 * half, 0.9 * half
    deviations = np.full((7, 3), 0.1)
    deviations[:2] = 0.15, 0.05, 0.15  # sideways, along, upwards
    deviations[2] = deviations[4] = 0.04, 0.4 * half, 0.1
    deviations[3] = 0.06, 0.5 * half, 0.12
    return LeafPrior(
        mean=np.append(mean.ravel(), np.log(length_m)),
        covariance=np.diag(np.square(np.append(deviations.ravel(), LENGTH_SPREAD))),
    )


def learn_prior(leaves: NDArray[np.float64], before: LeafPrior, strength: float = 10.0) -> LeafPrior:
    """The prior of a set of leaves, from those of them that are well seen.

    Each leaf counts in the version that is nearest to the mean, so that the ends of the mean differ if those of the
    leaves do. Few leaves change little: the prior counts as `strength` leaves in the covariance.

    Args:
        leaves: (N, 22), parameters and logarithm of the length.
        before: What was known before.
        strength: How many leaves the spread known before is worth.
    """
    if len(leaves) < 2:
        return before
    aligned, _ = align_leaves(leaves, before)
    mean, weights = _robust_mean(aligned)
    offsets = (aligned - mean) * np.sqrt(weights)[:, None]
    share = weights.sum() / (weights.sum() + strength)
    covariance = offsets.T @ offsets / max(weights.sum() - 1, 1.0)
    return LeafPrior(
        mean=share * mean + (1 - share) * before.mean,
        covariance=share * covariance + (1 - share) * before.covariance + MIN_SPREAD**2 * np.eye(NUMBERS),
        learned=len(leaves),
    )


def align_leaves(leaves: NDArray[np.float64], prior: LeafPrior) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Leaves (N, 22) in the version in which they are most similar, and the version (N,) of each.

    The first is the version nearest to the prior; then mean and versions in turns.
    """
    matrices, shifts = _symmetries()
    versions = np.einsum("gij,nj->gni", matrices, leaves) + shifts[:, None]
    deviations = np.sqrt(np.diag(prior.covariance))
    scaled = versions / deviations
    # Begin with what is most off the middle: ends and sides of these leaves differ the most surely.
    lopsided = np.square(scaled[0] - scaled.mean(axis=0)).sum(axis=1)
    mean = scaled[0, np.argsort(lopsided)[len(lopsided) * 3 // 4]]
    chosen = np.zeros(len(leaves), np.int64)
    for _ in range(20):
        nearest = np.square(np.clip(scaled - mean, -3, 3)).sum(axis=-1).argmin(axis=0)
        if (nearest == chosen).all() and _:
            break
        chosen = nearest
        mean = np.median(scaled[chosen, np.arange(len(leaves))], axis=0)
    return versions[chosen, np.arange(len(leaves))], chosen


def exchange_ends(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same leaves (N, 7, 3) with base and apex exchanged, turned by half a turn about z."""
    matrices, shifts = _symmetries()
    flat = parameters.reshape(-1, 21)
    return np.asarray((flat @ matrices[1, :21, :21].T + shifts[1, :21]).reshape(-1, 7, 3))


def _symmetries() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matrices (4, 22, 22) and shifts (4, 22) that take leaves to their versions."""
    exchanged, shift = np.zeros((NUMBERS, NUMBERS)), np.zeros(NUMBERS)
    for row, source in enumerate(_ENDS_EXCHANGED):
        for c in range(3):
            along = 2 - c if row >= 5 else c  # inner and outer hold three heights from base to apex
            exchanged[3 * row + c, 3 * source + along] = 1
    exchanged[-1, -1] = 1
    exchanged[_FROM_BASE] *= -1
    shift[_FROM_BASE] = 1
    mirrored = np.eye(NUMBERS)
    mirrored[_TO_THE_RIGHT, _TO_THE_RIGHT] = -1
    exchanged[_TO_THE_RIGHT] *= -1  # half a turn about z
    none = np.zeros(NUMBERS)
    matrices = np.stack([np.eye(NUMBERS), exchanged, mirrored, mirrored @ exchanged])
    return matrices, np.stack([none, shift, none, mirrored @ shift])


def _robust_mean(leaves: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean (22,) and weights (N,) of leaves (N, 22): those far from the others count little."""
    mean = np.median(leaves, axis=0)
    deviations = np.maximum(1.4826 * np.median(np.abs(leaves - mean), axis=0), 1e-3)
    far = np.square((leaves - mean) / deviations).mean(axis=1)  # 1 for a typical leaf
    weights = np.minimum(1.0, 2.0 / np.maximum(far, 1e-9))
    return np.average(leaves, axis=0, weights=weights), weights
