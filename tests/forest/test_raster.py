"""Rasters: where pixels lie, and what is read between them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.forest.raster import (
    Raster,
    is_inside,
    pixel_grid,
    sample_bilinear,
    sample_nearest,
    to_ground,
    to_pixels,
    upright_grid,
)

angles = st.floats(-3, 3)


def turned(angle: float, values: np.ndarray) -> Raster:
    """A raster of half metres, turned about its corner."""
    c, s = 0.5 * np.cos(angle), 0.5 * np.sin(angle)
    return Raster(values=values, ground_from_pixel=np.array([[c, s, 1000.0], [s, -c, 2000.0]]))


@given(angles)
def test_pixels_and_ground_are_inverse(angle):
    raster = turned(angle, np.zeros((4, 6)))
    places = np.array([[0.5, 0.5], [3.2, 1.7], [5.9, 3.9]])
    np.testing.assert_allclose(to_pixels(raster, to_ground(raster, places)), places, atol=1e-9)
    assert is_inside(raster, to_ground(raster, places)).all()
    assert not is_inside(raster, to_ground(raster, np.array([[-0.1, 1.0], [6.1, 1.0]]))).any()
    assert abs(raster.cell_m - 0.5) < 1e-12


@given(angles, st.floats(-2, 2), st.floats(-2, 2))
def test_a_plane_is_read_exactly_between_middles(angle, east, north):
    flat = turned(angle, np.zeros((8, 8)))
    grid = pixel_grid(flat)
    raster = turned(angle, east * grid[..., 0] + north * grid[..., 1])
    places = to_ground(raster, np.random.default_rng(0).uniform(0.5, 7.5, (20, 2)))
    np.testing.assert_allclose(sample_bilinear(raster, places), places @ [east, north], atol=1e-6)


def test_beyond_the_middles_values_continue_and_the_nearest_pixel_is_read():
    raster = turned(0.0, np.array([[1.0, 2.0], [3.0, 4.0]]))
    corner = to_ground(raster, np.array([[0.0, 0.0], [2.0, 2.0], [0.9, 0.1]]))
    np.testing.assert_allclose(sample_bilinear(raster, corner[:2]), [1, 4])
    np.testing.assert_allclose(sample_nearest(raster, corner), [1, 4, 1])


def test_colors_are_read_by_channel():
    values = np.stack([np.full((3, 3), 0.2), np.full((3, 3), 0.4)], axis=-1)
    assert sample_bilinear(turned(0.3, values), pixel_grid(turned(0.3, values))[1]).tolist() == [[0.2, 0.4]] * 3


def test_an_upright_grid_holds_a_turned_raster_and_no_more():
    upright = Raster(values=np.ones((3, 5)), ground_from_pixel=np.array([[0.5, 0.0, 100.0], [0.0, -0.5, 200.0]]))
    assert upright_grid(upright) is upright
    for angle in (0.4, 2.0, -1.0):
        raster = turned(angle, np.zeros((9, 12)))
        around = upright_grid(raster)
        assert around.ground_from_pixel[0, 1] == around.ground_from_pixel[1, 0] == 0
        np.testing.assert_allclose(np.diag(around.ground_from_pixel[:, :2]), [0.5, -0.5], rtol=0.15)
        inside = to_pixels(around, to_ground(raster, np.array([[0, 0], [12, 0], [0, 9], [12, 9.0]])))
        height, width = around.values.shape
        np.testing.assert_allclose([inside.min(axis=0), inside.max(axis=0)], [[0, 0], [width, height]], atol=1e-9)
