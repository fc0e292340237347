"""Plants that no picture shows singly: places at even distances, and none closer (blue noise)."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]

DARTS = 16  # thrown for each place that may be
ROUNDS = 5


def scatter_blue_noise(cells_m: Floats, cell_m: float, spacing_m: float, rng: np.random.Generator) -> Floats:
    """(N, 2) places in cells of the ground, no two closer than the spacing, nearly as many as can be.

    Darts are thrown in rounds (Cook, Stochastic sampling in computer graphics, 1986); of those that are too close, the
    earlier one stays.

    Args:
        cells_m: (C, 2) middles of square cells in which plants may stand.
        cell_m: Side of a cell.
        spacing_m: Between two plants, above 0.
        rng: For the darts.
    """
    if not len(cells_m):
        return np.zeros((0, 2))
    many = int(np.ceil(DARTS * len(cells_m) * cell_m**2 / spacing_m**2 / ROUNDS)) + 1
    placed = np.zeros((0, 2))
    for _ in range(ROUNDS):
        darts = cells_m[rng.integers(len(cells_m), size=many)] + rng.uniform(-cell_m / 2, cell_m / 2, (many, 2))
        if len(placed):
            darts = darts[np.asarray(cKDTree(placed).query(darts, distance_upper_bound=spacing_m)[0]) == np.inf]
        placed = np.concatenate([placed, darts[_earliest(darts, spacing_m)]])
    return placed


def _earliest(places_m: Floats, spacing_m: float) -> NDArray[np.bool_]:
    """(N,) which places stay when each takes away later ones that are too close: settled in parallel, until none is."""
    stays = np.ones(len(places_m), bool)
    if len(places_m) < 2:
        return stays
    pairs = cKDTree(places_m).query_pairs(spacing_m, output_type="ndarray")
    first, later = pairs.min(axis=1), pairs.max(axis=1)
    open_ = np.ones(len(places_m), bool)  # not settled yet
    while len(first):
        blocked = np.zeros(len(places_m), bool)
        blocked[later] = True
        settled = open_ & ~blocked  # nothing earlier is close: it stays
        gone = np.zeros(len(places_m), bool)
        gone[later[settled[first]]] = True
        stays[gone] = False
        open_ &= ~settled & ~gone
        keep = open_[first] & open_[later]
        first, later = first[keep], later[keep]
    return stays
