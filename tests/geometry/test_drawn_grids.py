"""Grids cover the pixels whose centres they cover, at the depth that they have."""

import numpy as np
import pytest
from usdfoliage.geometry.drawn_grids import NO_GRID, draw_grids

from tests.support.leaves.pictures import front_camera

CAMERA = front_camera(width_px=60, height_px=40, focal_px=100.0)  # 1 m before the plane z = 0: a pixel is 0.01 m


def square(left_px, top_px, side_px, z_m=0.0):
    """A quadrilateral (1, 2, 2, 3) that covers whole pixels."""
    x = (np.array([left_px, left_px + side_px]) - 30) / 100 * (1 - z_m)
    y = (20 - np.array([top_px, top_px + side_px])) / 100 * (1 - z_m)
    return np.array([[[[x[0], y[0], z_m], [x[1], y[0], z_m]], [[x[0], y[1], z_m], [x[1], y[1], z_m]]]])


def test_a_square_covers_its_pixels_and_no_others():
    drawn = draw_grids(square(10, 5, 20), CAMERA)
    expected = np.full((40, 60), NO_GRID)
    expected[5:25, 10:30] = 0
    np.testing.assert_array_equal(drawn.ids, expected)
    np.testing.assert_allclose(drawn.depth_m[expected == 0], 1, rtol=1e-6)
    assert not drawn.depth_m[expected != 0].any()


def test_the_nearer_square_is_seen():
    drawn = draw_grids(np.concatenate([square(10, 5, 20), square(20, 5, 20, z_m=0.2)]), CAMERA)
    assert (drawn.ids[5:25, 20:40] == 1).all()
    assert (drawn.ids[5:25, 10:20] == 0).all()


def test_nothing_is_drawn_of_no_grids():
    assert (draw_grids(np.zeros((0, 2, 2, 3)), CAMERA).ids == NO_GRID).all()


@pytest.mark.parametrize("shape", [(2, 2, 3), (1, 1, 2, 3), (1, 2, 2, 2)])
def test_what_is_no_grid_is_refused(shape):
    with pytest.raises(ValueError, match="must be"):
        draw_grids(np.zeros(shape), CAMERA)
