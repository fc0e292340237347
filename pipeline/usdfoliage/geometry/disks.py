"""Poisson disks: points that lie a distance apart, and close enough that none fits between them."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree


def choose_disks(points_m: NDArray[np.floating], spacing_m: float, seed: int = 0) -> NDArray[np.int64]:
    """Which of given points lie at least spacing_m apart, so many that no further one fits between them; in order.

    Args:
        points_m: (N, 3), of which are chosen.
        spacing_m: Least distance, above 0.
        seed: Of the order in which points come: of any that conflict the first stays.

    Source:
        M. Corsini et al., Efficient and flexible sampling with blue noise properties of triangular meshes, 2012,
        pruning of samples.
    """
    rank = np.random.default_rng(seed).permutation(len(points_m))
    kept: NDArray[np.int64] = np.zeros(0, np.int64)
    waiting = np.arange(len(points_m))
    while len(waiting):
        # The first of every cell of a grid as wide as a disk; then what of these conflicts, and what they cover.
        cells = np.floor(points_m[waiting] / spacing_m).astype(np.int64)
        order = np.lexsort((rank[waiting], cells[:, 2], cells[:, 1], cells[:, 0]))
        first = np.ones(len(order), bool)
        first[1:] = (cells[order][1:] != cells[order][:-1]).any(axis=1)
        chosen = waiting[order[first]]
        chosen = chosen[np.argsort(rank[chosen])]
        tree = cKDTree(points_m[chosen])
        pairs = tree.query_pairs(spacing_m, output_type="ndarray")
        beaten = np.zeros(len(chosen), bool)
        beaten[pairs.max(axis=1)] = True  # a pair's later one; it may come again once the others are settled
        chosen = chosen[~beaten]
        kept = np.concatenate([kept, chosen])
        near = cKDTree(points_m[chosen]).query(points_m[waiting], distance_upper_bound=spacing_m, workers=-1)[0]
        waiting = waiting[~np.isfinite(near)]
    return np.sort(kept)
