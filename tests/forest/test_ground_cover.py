"""Places that are drawn: even, never closer than the spacing, of one seed."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from usdfoliage.forest.ground_cover import scatter_blue_noise


@given(st.integers(0, 1000), st.floats(0.4, 3.0))
def test_no_two_are_closer_and_all_are_in_cells(seed, spacing_m):
    row, column = np.mgrid[:20, :20]
    cells_m = np.stack([column, row], axis=-1).reshape(-1, 2) + 0.5
    cells_m = cells_m[(row + column).reshape(-1) % 3 > 0]
    placed = scatter_blue_noise(cells_m, 1.0, spacing_m, np.random.default_rng(seed))
    again = scatter_blue_noise(cells_m, 1.0, spacing_m, np.random.default_rng(seed))
    np.testing.assert_array_equal(placed, again)
    assert len(cKDTree(placed).query_pairs(spacing_m * (1 - 1e-9))) == 0
    inside = np.abs(placed[:, None] - cells_m).max(axis=2).min(axis=1)
    assert (inside <= 0.5 + 1e-9).all()


def test_they_are_nearly_as_dense_as_can_be():
    cells_m = np.stack(np.meshgrid(np.arange(40) + 0.5, np.arange(40) + 0.5), axis=-1).reshape(-1, 2)
    placed = scatter_blue_noise(cells_m, 1.0, 2.0, np.random.default_rng(0))
    assert 0.6 < len(placed) * 2.0**2 / 1600 < 0.85  # saturated darts cover .7 of a square a spacing wide


def test_without_ground_there_is_none():
    assert len(scatter_blue_noise(np.zeros((0, 2)), 1.0, 1.0, np.random.default_rng(0))) == 0
