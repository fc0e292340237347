"""What colours show of wood, learnt from the plant itself: no colour is that of leaves at all seasons.

What geometry takes for wood and for leaves are samples of both, with faults. The faults make their colours more similar
than they are, so that what is learnt is never bolder than it should be; where bark and leaves do not differ in colour,
or geometry decides nothing, it is nothing.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

_BINS = (4, 16)  # of each of the three numbers of a tone, for few points and for many
_IN_A_BIN = 20  # points, so that no chance is learnt
_SPAN = 0.005  # share of the points on either side, that is in the last bins
_BLUR = 1.0  # bins
_UNSEEN = 0.1  # points that every bin has from the start
_FEW = 100  # points of either kind, from which colours can be learnt
_DARK = 0.01  # of white, added to what colours are divided by
_NEIGHBORS, _REACH = 24, 3.7  # points at most, and distances to the sixth neighbour, over which colours are averaged


def blur_colors(points_m: NDArray[np.float64], colors: NDArray[np.number], spacing_m: float) -> NDArray[np.float64]:
    """(N, 3) mean colours of each point's surroundings. A twig is some pixels wide in a photograph, so that single
    points of it have colours of what is behind it, and a leaf's veins and glosses those of bark.

    Args:
        points_m: (N, 3).
        colors: (N, 3), 0 to 255; black ones are no colours and do not count. A black point stays black.
        spacing_m: To the sixth neighbour.
    """
    known = np.asarray(colors, np.float64)
    has = known.any(axis=1)
    blurred = np.zeros_like(known)
    if not has.any():
        return blurred
    count = min(_NEIGHBORS, int(has.sum()))
    away_m, near = cKDTree(points_m[has]).query(
        points_m[has], k=[*range(1, count + 1)], distance_upper_bound=_REACH * spacing_m, workers=-1
    )
    is_near = np.isfinite(away_m)
    summed = np.einsum("nk,nkc->nc", is_near, known[has][np.where(is_near, near, 0)])
    blurred[has] = summed / is_near.sum(axis=1)[:, None]  # every point is its own neighbour
    return blurred


def color_odds(colors: NDArray[np.number], is_wood: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(N,) logarithm of how much more often a point's colour is found in wood than in leaves.

    Hue and brightness count together: what is dark has no certain hue.

    Args:
        colors: (N, 3), red, green and blue, 0 to 255; black ones are no colours and do not count.
        is_wood: (N,), what is taken for wood so far; the others are taken for leaves.
    """
    has = np.asarray(np.asarray(colors).any(axis=1))
    if min(int((is_wood & has).sum()), int((~is_wood & has).sum())) < _FEW:
        return np.zeros(len(colors))
    shade = np.asarray(colors, np.float64) / 255 + _DARK
    whole = shade.sum(axis=1)
    tone = np.column_stack([shade[:, 1] / whole, (shade[:, 0] - shade[:, 2]) / whole, np.log(whole)])
    low, high = np.quantile(tone[has], [_SPAN, 1 - _SPAN], axis=0)
    bins = int(np.clip(np.cbrt(has.sum() / _IN_A_BIN), *_BINS))
    scale = np.where(high > low, bins / np.where(high > low, high - low, 1), 0)
    place = np.clip(((tone - low) * scale).astype(np.int64), 0, bins - 1)
    key = np.ravel_multi_index(tuple(place.T), (bins,) * 3)
    wood, leaves = (_shares(key[kind & has], bins) for kind in (is_wood, ~is_wood))
    return np.asarray(np.where(has, np.log(wood / leaves)[key], 0.0))


def _shares(key: NDArray[np.int64], bins: int) -> NDArray[np.float64]:
    """(bins³,) share of the points in each bin."""
    counts = np.bincount(key, minlength=bins**3).astype(np.float64).reshape((bins,) * 3)
    smooth = gaussian_filter(counts, _BLUR) + _UNSEEN
    return np.asarray((smooth / smooth.sum()).ravel())
