"""Which points of a plant are leaves, by their colour. Our own."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.isolation.vegetation import LEAST_EXCESS, green_excess

_LEAST = 0.1  # share of the points that must be green, and of the plant's height that these must span
_LEAST_HEIGHT = 0.3


def find_green_points(points_m: NDArray[np.floating], colors: NDArray[np.number]) -> NDArray[np.bool_] | None:
    """(N,) which points are green; None where few are, or only low ones, as of a plant without leaves in a meadow.

    Args:
        points_m: (N, 3), Y up.
        colors: (N, 3), red, green and blue, 0 to 255.
    """
    green = np.asarray(green_excess(colors) > LEAST_EXCESS)
    if green.mean() < _LEAST:
        return None
    low, high = np.quantile(points_m[green, 1], [0.1, 0.9])
    return green if high - low >= _LEAST_HEIGHT * np.ptp(points_m[:, 1]) else None
