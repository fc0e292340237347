"""Directions in space, many at once."""

import numpy as np
from numpy.typing import NDArray


def unit_vectors(vectors: NDArray[np.floating]) -> NDArray[np.float64]:
    """Vectors (..., 3) divided by their length, which is not 0."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def vectors_across(along: NDArray[np.floating], towards: NDArray[np.floating]) -> NDArray[np.float64]:
    """Unit vectors (K, 3) at right angles to unit vectors along and, where they are not parallel to it, towards."""
    across = np.cross(along, towards)
    lost = np.linalg.norm(across, axis=-1) < 1e-6
    across[lost] = np.cross(along[lost], np.eye(3)[np.argmin(np.abs(along[lost]), axis=-1)])
    return unit_vectors(across)


def two_across(direction: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit vectors (N, 3) each, across unit directions (N, 3) and each other; direction, first, second turn right.

    Of a direction that is 0 both are 0.
    """
    helper = np.where(np.abs(direction[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(direction, helper)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
    return first, np.cross(direction, first)
