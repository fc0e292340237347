"""Which points of a cloud are of the trees at some roots, and which of others beside them."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.geometry.point_cells import touching_parts

_GAP_OF_HEIGHT = 0.02  # without any points, between trees that do not touch
_GAP_SPACINGS = 3.0  # distances to the sixth neighbour, that it is at least


def find_other_trees(
    points_m: NDArray[np.float64],
    roots_m: NDArray[np.float64],
    other_roots_m: NDArray[np.float64],
    spacing_m: float,
) -> NDArray[np.bool_]:
    """(N,) points of what stands on other roots and does not touch what stands on those that are meant.

    A part of the cloud with neither goes with the nearest part that has one: crowns are seen in pieces.

    Args:
        points_m: (N, 3), without ground.
        roots_m: (R, 3), those that are meant.
        other_roots_m: (Q, 3), of all trees, those that are meant among them.
        spacing_m: From a point to its sixth neighbour, usually.
    """
    nothing = np.zeros(len(points_m), bool)
    if not len(points_m) or not len(other_roots_m):
        return nothing
    gap_m = max(_GAP_OF_HEIGHT * float(np.ptp(points_m[:, 1])), _GAP_SPACINGS * spacing_m)
    if not gap_m > 0:
        return nothing
    part = touching_parts(points_m, gap_m)
    tree = cKDTree(points_m)
    meant = np.unique(part[np.asarray(tree.query(roots_m)[1])])
    others = np.setdiff1d(part[np.asarray(tree.query(other_roots_m)[1])], meant)
    if not len(others):
        return nothing
    rooted = np.isin(part, np.concatenate([meant, others]))
    is_other = np.isin(part, others)
    loose = np.flatnonzero(~rooted)
    if len(loose):
        away_m, nearest = (np.asarray(each) for each in cKDTree(points_m[rooted]).query(points_m[loose], workers=-1))
        order = np.lexsort((away_m, part[loose]))
        first = order[np.concatenate([[True], np.diff(part[loose][order]) > 0])]
        goes = np.zeros(int(part.max()) + 1, bool)
        goes[part[loose][first]] = is_other[rooted][nearest[first]]
        is_other[loose] = goes[part[loose]]
    return np.asarray(is_other)
