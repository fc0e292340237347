"""Strays and spacing of clouds whose points are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from usdfoliage.capture.cloud import Cloud
from usdfoliage.capture.cloud_cleaning import CleaningSettings, drop_strays, thin_to_disks


def cloud_of(points_m):
    count = len(points_m)
    return Cloud(
        points_m=np.asarray(points_m, float),
        normals=np.tile(np.float32([0, 0, 1]), (count, 1)),
        srgb=np.zeros((count, 3), np.uint8),
        confidence=np.ones(count, np.float32),
        views=np.arange(count, dtype=np.int32),
    )


def sheet(side=40, step=0.01):
    grid = np.arange(side) * step
    return np.array([(x, y, 0.0) for x in grid for y in grid])


@pytest.mark.parametrize("scale", [0.001, 1.0, 1000.0])
def test_points_alone_in_the_air_are_strays_at_any_scale(scale):
    strays = np.array([(0.2, 0.2, 0.5), (0.5, 0.1, 0.2), (0.51, 0.1, 0.2)])
    cleaned = drop_strays(cloud_of(np.concatenate([sheet(), strays]) * scale))
    assert cleaned.points_m == pytest.approx(sheet() * scale)
    assert np.array_equal(cleaned.views, np.arange(1600))
    assert len(drop_strays(cloud_of(strays), CleaningSettings(neighbors=0))) == 3


@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.5))
def test_disks_are_apart_and_leave_no_gap(seed, spacing_m):
    points = np.random.default_rng(seed).random((400, 3))
    thin = thin_to_disks(cloud_of(points), CleaningSettings(spacing_m=spacing_m, seed=seed))
    tree = cKDTree(thin.points_m)
    assert not tree.query_pairs(spacing_m * (1 - 1e-12))
    assert tree.query(points)[0].max() <= spacing_m
    again = thin_to_disks(cloud_of(points), CleaningSettings(spacing_m=spacing_m, seed=seed))
    assert np.array_equal(thin.points_m, again.points_m)


def test_little_is_left_as_it_is():
    empty = cloud_of(np.zeros((0, 3)))
    assert len(drop_strays(empty)) == len(thin_to_disks(empty, CleaningSettings(spacing_m=1.0))) == 0
    assert len(thin_to_disks(cloud_of(sheet()))) == 1600
    with pytest.raises(ValueError, match="must"):
        CleaningSettings(spacing_m=-1.0)
