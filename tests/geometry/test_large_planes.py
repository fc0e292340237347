"""Large planes of clouds whose walls are known."""

import numpy as np
import pytest
from usdfoliage.geometry.large_planes import LargePlaneSettings, find_large_planes

from tests.support.branch_clouds import block, cone, gabled_house, rectangle


@pytest.mark.parametrize("noise_m", [0.0, 0.05])
def test_the_walls_and_roofs_of_a_house_are_found(noise_m):
    planes = find_large_planes(gabled_house(noise_m=noise_m))
    assert len(planes.normals) == 6
    assert (planes.of_point >= 0).mean() > 0.97
    upright = np.abs(planes.normals[:, 1]) < 0.05
    assert upright.sum() == 4
    np.testing.assert_allclose(np.abs(planes.normals[~upright][:, 1]), 0.8, atol=0.02)


def test_points_beside_a_wall_do_not_hide_it():
    wall_m = rectangle((0, 0, 0), (10, 0, 0), (0, 5, 0), 200, 0.01, 0)
    beside_m = np.random.default_rng(1).uniform([0, 0, -2], [10, 5, 2], (2000, 3))
    planes = find_large_planes(np.concatenate([wall_m, beside_m]))
    assert (planes.of_point[: len(wall_m)] >= 0).mean() > 0.95
    assert (planes.of_point[len(wall_m) :] >= 0).mean() < 0.2


def test_a_trunk_and_a_block_of_points_have_none():
    trunk_m = cone([0, 0, 0], [0, 4, 0], 0.4, 5000, noise_m=0.004)
    for points_m in (trunk_m, block((2, 2, 2), 8000)):
        assert not len(find_large_planes(points_m).normals)


def test_clutter_is_none_on_a_wall_and_much_in_a_block():
    points_m = np.concatenate([rectangle((0, 0, -3), (4, 0, 0), (0, 4, 0), 300, 0.0, 0), block((4, 4, 4), 5000)])
    clutter = find_large_planes(points_m).clutter
    assert np.median(clutter[:4800]) < 0.01
    assert np.median(clutter[4800:]) > 0.4


def test_points_too_few_for_a_plane_have_none():
    assert not len(find_large_planes(np.random.default_rng(0).uniform(0, 1, (5, 3))).normals)
    assert not len(find_large_planes(np.column_stack([np.linspace(0, 1, 60), np.zeros((60, 2))])).normals)


@pytest.mark.parametrize("wrong", [{"max_cells": 10}, {"around": 1.5}, {"turn_deg": 90.0}, {"side": 0.0}])
def test_settings_are_checked(wrong):
    with pytest.raises(ValueError, match="must be"):
        LargePlaneSettings(**wrong)
