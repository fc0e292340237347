"""Directions across a direction."""

import numpy as np
from numpy.typing import NDArray


def two_across(direction: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit vectors (N, 3) each, across unit directions (N, 3) and each other; direction, first, second turn right.

    Of a direction that is 0 both are 0.
    """
    helper = np.where(np.abs(direction[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(direction, helper)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
    return first, np.cross(direction, first)
