"""Which points of a plant are leaves, by their colour. Our own."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.isolation.vegetation import MIN_EXCESS, green_excess

_MIN_SHARE = 0.1  # share of the points that must be green, and of the plant's height that these must span
_MIN_HEIGHT = 0.3
_ASKED = 5  # coloured points that decide whether one without colour is a leaf


def find_green_points(points_m: NDArray[np.floating], colors: NDArray[np.number]) -> NDArray[np.bool_] | None:
    """(N,) which points are green; None where few are, or only low ones, as of a plant without leaves in a meadow.

    Black points have no colour, as those of a scan where no photograph was taken: they are as most of the coloured
    ones nearest to them are.

    Args:
        points_m: (N, 3), Y up.
        colors: (N, 3), red, green and blue, 0 to 255.
    """
    has = have_color(colors)
    if has.mean() < _MIN_SHARE:
        return None
    green = np.asarray(green_excess(colors) > MIN_EXCESS) & has
    if green.sum() < _MIN_SHARE * has.sum():
        return None
    low, high = np.quantile(points_m[green, 1], [0.1, 0.9])
    if high - low < _MIN_HEIGHT * np.ptp(points_m[:, 1]):
        return None
    if not has.all():
        count = min(_ASKED, int(has.sum()))
        _, near = cKDTree(points_m[has]).query(points_m[~has], k=count, workers=-1)
        green[~has] = green[has][np.reshape(near, (-1, count))].mean(axis=1) > 0.5
    return green


def have_color(colors: NDArray[np.number]) -> NDArray[np.bool_]:
    """(N,) which points have a colour; what is black has none."""
    return np.asarray(np.asarray(colors).any(axis=1))
