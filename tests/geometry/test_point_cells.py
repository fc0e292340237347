"""Points in cells, and the means of what they hold."""

import numpy as np
import pytest
from usdfoliage.geometry.point_cells import cell_means, number_cells, touching_parts


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_points_of_one_cell_have_one_number():
    points_m = np.array([[0, 0, 0], [0.9, 0.2, 0.3], [1.1, 0, 0], [0, 5.5, 0], [0.4, 0.4, 0.4]])
    cell = number_cells(points_m, 1.0)
    assert cell[0] == cell[1] == cell[4]
    assert len({cell[0], cell[2], cell[3]}) == 3
    assert set(cell) == {0, 1, 2}


def test_means_are_those_of_the_cells(rng):
    points_m = rng.uniform(-3, 3, (500, 3))
    cell = number_cells(points_m, 1.5)
    means = cell_means(points_m, cell)
    for number in range(cell.max() + 1):
        np.testing.assert_allclose(means[number], points_m[cell == number].mean(axis=0))
        assert (np.ptp(points_m[cell == number], axis=0) <= 1.5).all()


def test_parts_are_what_a_gap_of_two_cells_divides():
    rng = np.random.default_rng(0)
    lumps = [rng.uniform([x, 0, 0], [x + 0.5, 0.5, 0.5], (40, 3)) for x in (0.0, 0.6, 3.0)]
    part = touching_parts(np.concatenate(lumps), 0.4)
    assert part.tolist() == [0] * 80 + [1] * 40 or part.tolist() == [1] * 80 + [0] * 40
    assert len(set(touching_parts(np.concatenate(lumps), 3.0).tolist())) == 1
