"""Links across gaps: from where a branch leaves off to where it goes on, when none of its own points lie between.

Nearest points are linked with what is near, and there is much of it: at the edge of a gap all of them are on the same
side, so that a path through the graph goes round by whatever touches. Two points see each other across a gap if the
ball between them is empty (K. Gabriel and R. Sokal, A new statistical approach to geographic variation analysis, 1969);
the cheapest paths over all pairs of points, where a link costs the square of its length, use no other links than these.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from usdfoliage.geometry.point_cells import one_in_each_cell

_TOUCHES = 1 - 1e-6  # of half a link's length: points on the ball around it are not in it


def link_across_gaps(
    points_m: NDArray[np.float64], tree: cKDTree, max_points: int, threads: int = -1
) -> NDArray[np.int64]:
    """(L, 2) pairs of points between which there is none: no other one lies in the ball whose diameter they are.

    Of more than max_points only one in each cell of a grid is linked, and links shrink until they are empty; those
    that become shorter than a cell are left out, since there is no gap.
    Where all points lie in one plane, or there are fewer than five of them, there are no links.

    Args:
        points_m: (N, 3).
        tree: Of these points.
        max_points: That are linked, none if fewer than 5.
        threads: That ask the tree, -1 for all.
    """
    if min(max_points, len(points_m)) < 5:
        return np.zeros((0, 2), np.int64)
    some, cell_m = one_in_each_cell(points_m, max_points)
    try:
        corners = Delaunay(points_m[some]).simplices.astype(np.int64)
    except QhullError:
        return np.zeros((0, 2), np.int64)
    edges = np.concatenate([corners[:, [one, two]] for two in range(4) for one in range(two)])
    key = np.unique(edges.min(axis=1) * len(some) + edges.max(axis=1))
    pairs = some[np.stack([key // len(some), key % len(some)], axis=1)]
    linked = np.zeros((0, 2), np.int64)
    while len(pairs):
        ends_m = points_m[pairs]
        half_m = 0.5 * np.linalg.norm(ends_m[:, 0] - ends_m[:, 1], axis=1)
        wide = 2 * half_m >= cell_m
        pairs, ends_m, half_m = pairs[wide], ends_m[wide], half_m[wide]
        nearest_m, between = (np.asarray(each) for each in tree.query(ends_m.mean(axis=1), workers=threads))
        empty = nearest_m >= _TOUCHES * half_m
        linked = np.concatenate([linked, pairs[empty]])
        pairs, ends_m, between = pairs[~empty], ends_m[~empty], between[~empty]
        away_m = np.linalg.norm(ends_m - points_m[between, None], axis=2)
        pairs[np.arange(len(pairs)), away_m.argmin(axis=1)] = between
        # Of points that all but lie on each other the one between is an end; only what shrinks is looked at again.
        pairs = pairs[away_m.max(axis=1) < 2 * half_m[~empty]]
    key = np.unique(linked.min(axis=1) * len(points_m) + linked.max(axis=1))
    return np.stack([key // len(points_m), key % len(points_m)], axis=1)
