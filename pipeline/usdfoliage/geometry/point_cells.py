"""Points in the cells of a grid, each cell's as one."""

import numpy as np
from numpy.typing import NDArray


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
