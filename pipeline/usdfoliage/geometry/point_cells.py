"""Points in the cells of a grid, each cell's as one."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

_MAX_CELLS = 1_000_000  # along a side, so that numbers of cells stay whole numbers
_FINER = 1.3  # by which cells grow until there are few enough of them


def number_cells(points_m: NDArray[np.float64], cell_m: float) -> NDArray[np.int64]:
    """(N,) which of the cells that hold any of the points (N, 3) each is in, numbered without gaps."""
    cell = _corners(points_m, cell_m)
    sides = cell.max(axis=0) + 1
    key = (cell[:, 0] * sides[1] + cell[:, 1]) * sides[2] + cell[:, 2]
    return np.asarray(np.unique(key, return_inverse=True)[1], np.int64).reshape(-1)


def cell_means(values: NDArray[np.number], cell: NDArray[np.integer]) -> NDArray[np.float64]:
    """(C, K) mean of the values (N, K) in each cell; cell (N,) as number_cells gives it."""
    count = np.bincount(cell)
    return np.column_stack([np.bincount(cell, column) / count for column in values.T])


def one_in_each_cell(points_m: NDArray[np.float64], max_points: int) -> tuple[NDArray[np.int64], float]:
    """Points of a cloud (N, 3) of which there are at most so many: the first in each cell of a grid.

    Returns:
        Which (K,), in their order, and how wide a cell is; all of them, and 0, where they are few enough.
    """
    if len(points_m) <= max_points:
        return np.arange(len(points_m)), 0.0
    cell_m = float(np.ptp(points_m, axis=0).max()) / min(max_points, _MAX_CELLS)
    if cell_m == 0:
        return np.zeros(1, np.int64), 0.0
    while True:
        cell = number_cells(points_m, cell_m)
        if cell.max() < max_points:
            return np.sort(np.unique(cell, return_index=True)[1]).astype(np.int64), cell_m
        # Cells of a cloud that fills space are fewer by their volume; those of a line by their side.
        cell_m *= max(_FINER, (cell.max() / max_points) ** (1 / 3))


def touching_parts(points_m: NDArray[np.float64], cell_m: float) -> NDArray[np.int64]:
    """(N,) parts of a cloud between which there is no point in a cell's width or more, numbered from 0.

    Points of one cell, and of cells that touch by a side, an edge or a corner, are of one part.
    """
    cell = number_cells(points_m, cell_m)
    corner = np.rint(cell_means(_corners(points_m, cell_m), cell))
    beside = cKDTree(corner).query_pairs(1.5, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(beside), bool), (beside[:, 0], beside[:, 1])), shape=(len(corner),) * 2)
    return np.asarray(connected_components(links, directed=False)[1][cell], np.int64)


def _corners(points_m: NDArray[np.float64], cell_m: float) -> NDArray[np.int64]:
    """(N, 3) places of cells in the grid, counted from the cloud's lowest corner."""
    return np.floor((points_m - points_m.min(axis=0)) / cell_m).astype(np.int64)
