"""Outliers and spacing of clouds whose points are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from usdfoliage.capture.cloud.cleaning import CleaningSettings, drop_floating, drop_outliers, thin_to_disks

from tests.support.plain_clouds import cloud_of


def sheet(side=40, step=0.01):
    grid = np.arange(side) * step
    return np.array([(x, y, 0.0) for x in grid for y in grid])


def moved(points, *offset):
    return points + np.array(offset)


@pytest.mark.parametrize("scale", [0.001, 1.0, 1000.0])
def test_points_alone_in_the_air_are_outliers_at_any_scale(scale):
    outliers_m = np.array([(0.2, 0.2, 0.5), (0.5, 0.1, 0.2), (0.51, 0.1, 0.2)])
    cleaned = drop_outliers(cloud_of(np.concatenate([sheet(), outliers_m]) * scale))
    assert cleaned.points_m == pytest.approx(sheet() * scale)
    assert np.array_equal(cleaned.views, np.arange(1600))
    assert len(drop_outliers(cloud_of(outliers_m), CleaningSettings(neighbors=0))) == 3


@pytest.mark.parametrize("scale", [0.001, 1.0, 1000.0])
def test_pieces_that_float_are_dropped_and_leaves_beside_a_plant_stay(scale):
    piece = sheet(side=10)  # 9 x 9 of what the plant's sheet has 39 x 39; 0.13 from corner to corner
    leaf = moved(piece, 0.1, 0.1, 0.2)
    twig = moved(piece * (0.1, 1, 0), 0.1, 0.1, 0.4)  # beside the leaf
    false = moved(piece, 0.1, 0.1, 1.3)
    two = np.concatenate([moved(piece, 0.1, 0.1, -2.0), moved(piece, 0.25, 0.1, -2.0)])  # each has the other beside it
    plant = np.concatenate([sheet(), leaf, twig])
    cleaned = drop_floating(cloud_of(np.concatenate([plant, false, two]) * scale))
    assert cleaned.points_m == pytest.approx(plant * scale)
    assert np.array_equal(cleaned.views, np.arange(len(plant)))
    kept = drop_floating(cloud_of(np.concatenate([plant, false]) * scale), CleaningSettings(isolation=0.0))
    assert len(kept) == len(plant) + len(false)


@given(st.integers(0, 2**32 - 1))
def test_one_piece_stays_whole_however_far_another_is(seed):
    rng = np.random.default_rng(seed)
    points = rng.random((300, 3))
    away = points[:40] * 0.05 + rng.normal(size=3) * 1e4
    cleaned = drop_floating(cloud_of(np.concatenate([points, away])))
    assert np.array_equal(cleaned.views, np.arange(300))
    assert len(drop_floating(cloud_of(np.ones((5, 3))))) == 5


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
    assert (
        len(drop_outliers(empty))
        == len(drop_floating(empty))
        == len(thin_to_disks(empty, CleaningSettings(spacing_m=1.0)))
        == 0
    )
    assert len(thin_to_disks(cloud_of(sheet()))) == 1600
    with pytest.raises(ValueError, match="must"):
        CleaningSettings(spacing_m=-1.0)
    with pytest.raises(ValueError, match="isolation"):
        CleaningSettings(isolation=-1.0)
