"""Mixtures of normal distributions of colours."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MAX_SAMPLES = 6000  # that a mixture is fitted to, drawn at random of more
ROUNDS = 12
WIDEN = 4.0  # variance that is added, of 8-bit colours: what one camera's noise has
_BLOCK = 65_536  # colours at once
_MIDDLE = 128.0  # of 8-bit colours


@dataclass(frozen=True, kw_only=True, eq=False)
class Mixture:
    """K normal distributions of colours."""

    weight: Floats  # (K,)
    mean: Floats  # (K, 3)
    covariance: Floats  # (K, 3, 3)

    def __len__(self) -> int:
        return len(self.weight)

    def weighted(self, factor: Floats) -> "Mixture":
        """All components, with their weights by factors (K,)."""
        return Mixture(weight=self.weight * factor, mean=self.mean, covariance=self.covariance)

    def only(self, some: NDArray[np.bool_]) -> "Mixture":
        """These components, with their weights in proportion."""
        weight = self.weight[some]
        return Mixture(weight=weight / weight.sum(), mean=self.mean[some], covariance=self.covariance[some])


def fit_mixture(colors: Floats, components: int, seed: int) -> Mixture:
    """A mixture of so many components by expectation and maximisation, or of fewer where colours are few.

    Args:
        colors: (N, 3), at least one; 0 to 255.
        components: K, at least 1.
        seed: Of the samples and the start.
    """
    rng = np.random.default_rng(seed)
    chosen = colors if len(colors) <= MAX_SAMPLES else colors[rng.choice(len(colors), MAX_SAMPLES, replace=False)]
    # Equal colours, as a drawn picture has them, would have no variance.
    samples = chosen + rng.normal(0, 0.5, chosen.shape)
    count = max(1, min(components, len(samples) // 8))
    odds = np.ones((len(samples), 1))
    if count > 1:
        cv2.setRNGSeed(int(rng.integers(2**31 - 1)))
        stop = (cv2.TERM_CRITERIA_MAX_ITER, 10, 0.0)
        _, labels, _ = cv2.kmeans(samples.astype(np.float32), count, None, stop, 1, cv2.KMEANS_PP_CENTERS)
        odds = np.eye(count)[labels.ravel()]
    mixture = _maximise(samples, odds)
    for _ in range(ROUNDS if count > 1 else 0):
        parts = log_parts(mixture, samples)
        odds = np.exp(parts - parts.max(axis=1, keepdims=True))
        mixture = _maximise(samples, odds / odds.sum(axis=1, keepdims=True))
    return mixture


def _maximise(samples: Floats, odds: Floats) -> Mixture:
    """The components that fit samples (N, 3) best, of which each is with odds (N, K)."""
    total = odds.sum(axis=0) + 1e-9
    mean = odds.T @ samples / total[:, None]
    away = samples[:, None] - mean
    covariance = np.einsum("nk,nka,nkb->kab", odds, away, away, optimize=True) / total[:, None, None]
    return Mixture(weight=total / total.sum(), mean=mean, covariance=covariance + WIDEN * np.eye(3))


def log_parts(mixture: Mixture, colors: Floats) -> Floats:
    """(N, K) logarithm of weight times density of each component at colours (N, 3)."""
    # Each is a polynomial of second degree in the colour about the middle of all: one product of matrices.
    terms = np.stack([_polynomial(mixture, number) for number in range(len(mixture))], axis=1)
    parts = np.empty((len(colors), len(mixture)))
    for start in range(0, len(colors), _BLOCK):
        r, g, b = (colors[start : start + _BLOCK] - _MIDDLE).T
        powers = np.stack([np.ones_like(r), r, g, b, r * r, r * g, r * b, g * g, g * b, b * b], axis=1)
        parts[start : start + _BLOCK] = powers @ terms
    return parts


def _polynomial(mixture: Mixture, number: int) -> Floats:
    """(10,) coefficients of log_parts for one component, of the powers there."""
    root = np.linalg.cholesky(mixture.covariance[number])
    constant = np.log(max(mixture.weight[number], 1e-12)) - np.log(np.diag(root)).sum() - 1.5 * np.log(2 * np.pi)
    inverse = np.linalg.inv(root)
    form = -0.5 * inverse.T @ inverse
    mean = mixture.mean[number] - _MIDDLE
    rows, columns = np.triu_indices(3)
    return np.concatenate(
        [
            [constant + mean @ form @ mean],
            -2 * form @ mean,
            form[rows, columns] * np.where(rows == columns, 1, 2),
        ]
    )


def log_density(mixture: Mixture, colors: Floats) -> Floats:
    """(N,) logarithm of a mixture's density at colours (N, 3)."""
    parts = log_parts(mixture, colors)
    highest = parts.max(axis=1)
    return np.asarray(highest + np.log(np.exp(parts - highest[:, None]).sum(axis=1)))
