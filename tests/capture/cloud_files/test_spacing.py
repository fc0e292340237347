"""How far apart points are: near and far, thinned, alone."""

import numpy as np
import pytest
from usdfoliage.capture.cloud_files.spacing import point_widths

from tests.support.captures import LENS, look_at


def test_points_are_as_wide_as_they_are_apart():
    grid = np.stack(np.meshgrid(*[np.arange(8) * 0.01] * 2, [0.0]), -1).reshape(-1, 3)
    np.testing.assert_allclose(point_widths(grid, []), 0.015, rtol=1e-6)
    np.testing.assert_allclose(point_widths(100 * grid, []), 1.5, rtol=1e-6)
    assert (point_widths(np.zeros((5, 3)), []) > 0).all()
    assert (point_widths(np.zeros((1, 3)), []) > 0).all()


def test_points_far_off_are_wider_and_single_ones_are_not():
    camera = LENS.pinhole(look_at((0, 0, 2), (0, 0, 0)))
    grid = np.stack(np.meshgrid(*[np.arange(8) * 0.01] * 2, [0.0]), -1).reshape(-1, 3)
    near, far, single = grid, 100 * grid - (0, 0, 200), np.array([[0.0, 5.0, 0.0]])
    widths_m = point_widths(np.concatenate([near, far, single]), [camera])
    pixel = 1 / np.sqrt(80 * 82)
    np.testing.assert_allclose(widths_m[:64], 1.5 * 2 * pixel, rtol=0.01)
    np.testing.assert_allclose(widths_m[64:128], 1.5 * 202 * pixel, rtol=0.01)
    assert widths_m[128] == pytest.approx(1.5 * np.hypot(5, 2) * pixel, rel=0.01)


def test_points_that_stand_for_many_are_wider():
    camera = LENS.pinhole(look_at((0, 0, 2), (0, 0, 0)))
    points = np.random.default_rng(0).uniform(-0.01, 0.01, (200, 3))
    np.testing.assert_allclose(point_widths(points, [camera], 9.0), 3 * point_widths(points, [camera]), rtol=1e-5)
