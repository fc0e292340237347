"""What colours show of wood, learnt from the plant itself: no colour is that of leaves at all seasons.

What geometry takes for wood and for leaves are samples of both, with faults. The faults make their colours more similar
than they are, so that what is learnt is never bolder than it should be; where bark and leaves do not differ in colour,
or geometry decides nothing, it is nothing.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

_BINS = 32  # of each chromaticity
_SPAN = 0.005  # share of the points on either side, that is in the last bins
_BLUR = 1.0  # bins
_UNSEEN = 0.5  # points that every bin has from the start
_FEW = 100  # points of either kind, from which colours can be learnt
_DARK = 0.01  # of white, added to what colours are divided by


def color_odds(colors: NDArray[np.number], is_wood: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(N,) logarithm of how much more often a point's colour is found in wood than in leaves.

    Args:
        colors: (N, 3), red, green and blue, 0 to 255; black ones are no colours and do not count.
        is_wood: (N,), what is taken for wood so far; the others are taken for leaves.
    """
    has = np.asarray(np.asarray(colors).any(axis=1))
    if min(int((is_wood & has).sum()), int((~is_wood & has).sum())) < _FEW:
        return np.zeros(len(colors))
    # Without brightness, which is that of the light.
    shade = np.asarray(colors, np.float64) / 255 + _DARK
    tone = np.column_stack([shade[:, 1], shade[:, 0] - shade[:, 2]]) / shade.sum(axis=1, keepdims=True)
    low, high = np.quantile(tone[has], [_SPAN, 1 - _SPAN], axis=0)
    scale = np.where(high > low, _BINS / np.where(high > low, high - low, 1), 0)
    place = np.clip(((tone - low) * scale).astype(np.int64), 0, _BINS - 1)
    key = place[:, 0] * _BINS + place[:, 1]
    wood, leaves = (_shares(key[kind & has]) for kind in (is_wood, ~is_wood))
    return np.asarray(np.where(has, np.log(wood / leaves)[key], 0.0))


def _shares(key: NDArray[np.int64]) -> NDArray[np.float64]:
    """(bins,) share of the points in each bin."""
    counts = np.bincount(key, minlength=_BINS**2).astype(np.float64).reshape(_BINS, _BINS)
    smooth = gaussian_filter(counts, _BLUR) + _UNSEEN
    return np.asarray((smooth / smooth.sum()).ravel())
