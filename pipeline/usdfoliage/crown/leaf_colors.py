"""Which points of a plant are leaves, by their colour. Our own."""

import numpy as np
from numpy.typing import NDArray

_DARK = 0.01  # of white, added to what colours are divided by
_GREENER = 0.06  # excess of green, of all light, from which on a point is green: walls, pots and soil have less
_LEAST = 0.1  # share of the points that must be green, and of the plant's height that these must span
_LEAST_HEIGHT = 0.3


def find_green_points(points_m: NDArray[np.floating], colors: NDArray[np.number]) -> NDArray[np.bool_] | None:
    """(N,) which points are green; None where few are, or only low ones, as of a plant without leaves in a meadow.

    Args:
        points_m: (N, 3), Y up.
        colors: (N, 3), red, green and blue, 0 to 255.
    """
    shade = np.asarray(colors, np.float64) / 255 + _DARK
    excess = (2 * shade[:, 1] - shade[:, 0] - shade[:, 2]) / shade.sum(axis=1)
    green = np.asarray(excess > _GREENER)
    if green.mean() < _LEAST:
        return None
    low, high = np.quantile(points_m[green, 1], [0.1, 0.9])
    return green if high - low >= _LEAST_HEIGHT * np.ptp(points_m[:, 1]) else None
