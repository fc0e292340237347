"""Points in the cells of a grid, each cell's as one."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree


def number_cells(points_m: NDArray[np.float64], cell_m: float) -> NDArray[np.int64]:
    """(N,) which of the cells that hold any of the points (N, 3) each is in, numbered without gaps."""
    cell = np.floor((points_m - points_m.min(axis=0)) / cell_m).astype(np.int64)
    sides = cell.max(axis=0) + 1
    key = (cell[:, 0] * sides[1] + cell[:, 1]) * sides[2] + cell[:, 2]
    return np.asarray(np.unique(key, return_inverse=True)[1], np.int64).reshape(-1)


def cell_means(values: NDArray[np.number], cell: NDArray[np.integer]) -> NDArray[np.float64]:
    """(C, K) mean of the values (N, K) in each cell; cell (N,) as number_cells gives it."""
    held = np.bincount(cell)
    return np.column_stack([np.bincount(cell, column) / held for column in values.T])


def touching_parts(points_m: NDArray[np.float64], cell_m: float) -> NDArray[np.int64]:
    """(N,) parts of a cloud between which there is no point in a cell's width or more, numbered from 0.

    Points of one cell, and of cells that touch by a side, an edge or a corner, are of one part.
    """
    cell = number_cells(points_m, cell_m)
    corner = np.rint(cell_means(np.floor((points_m - points_m.min(axis=0)) / cell_m), cell))
    beside = cKDTree(corner).query_pairs(1.5, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(beside), bool), (beside[:, 0], beside[:, 1])), shape=(len(corner),) * 2)
    return np.asarray(connected_components(links, directed=False)[1][cell], np.int64)
