"""The heights of clouds whose surface is known, and the size of their pixels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.forest.ground_frame import frame_ground
from usdfoliage.forest.ground_points import (
    SpacingSample,
    close_gaps,
    highest_heights,
    lowest_points,
    point_heights,
    spacing_of_points,
)

from tests.forest.test_mesh_heights import EAST_M, NORTH_M, ORIGIN_M, places_of, plane


def over_plane(plan):
    return np.column_stack([plan, plane(plan)])


def frame_over(plan, cell):
    return frame_ground(plan.min(axis=0), plan.max(axis=0), cell, "the DEM", whole=True)


@given(seed=st.integers(0, 30), cell=st.floats(0.8, 2.5))
def test_a_tilted_plane_keeps_its_heights_wherever_its_points_lie(seed, cell):
    plan = np.random.default_rng(seed).uniform(0, 40, (3_000, 2)) + ORIGIN_M
    frame = frame_over(plan, cell)
    parts = np.array_split(over_plane(plan), 4)
    heights = point_heights(parts, frame, 10.0)
    known = np.isfinite(heights)
    assert known[3:-3, 3:-3].all()  # along the edge a pixel may have no neighbour beyond it
    assert known.mean() > 0.95
    np.testing.assert_allclose(heights[known], plane(places_of(frame))[known], atol=1e-4)


def test_a_grid_keeps_the_height_of_each_point():
    rng = np.random.default_rng(1)
    row, column = np.mgrid[:30, :40]
    plan = np.stack([EAST_M + 0.5 * column, NORTH_M - 0.5 * row], axis=-1).reshape(-1, 2)
    z = rng.uniform(0, 9, 1200)
    assert spacing_of_points(plan) == pytest.approx(0.5)
    order = rng.permutation(1200)
    heights = point_heights([np.column_stack([plan, z])[order]], frame_over(plan, 0.5), 5.0)
    np.testing.assert_allclose(heights, z.reshape(30, 40), atol=1e-4)


def test_the_mean_of_a_pixel_its_lowest_point_and_its_highest():
    plan = np.repeat(np.stack(np.mgrid[:4, :4], axis=-1).reshape(-1, 2).astype(float), 2, axis=0)
    points = np.column_stack([plan, np.tile([1.0, 4.0], 16)])
    frame = frame_over(plan, 1.0)
    np.testing.assert_allclose(point_heights([points], frame, 0.0), 2.5)
    np.testing.assert_allclose(highest_heights([points, points[::-1]], frame), 4.0)
    low = lowest_points([points[::-1], points], frame)
    np.testing.assert_allclose(low[np.lexsort(low.T)], points[::2][np.lexsort(points[::2].T)])


def test_pixels_without_a_point_have_none():
    frame = frame_over(np.array([[0.0, 0], [3, 3]]), 1.0)
    points = np.array([[0.0, 0, 5], [3, 3, 7], [3.2, 3, 8], [9, 9, 9]])
    highest = highest_heights([points], frame)
    assert np.isfinite(highest).sum() == 2
    assert highest[3, 0] == 5
    assert highest[0, 3] == 8
    np.testing.assert_allclose(lowest_points([points], frame), [[3, 3, 7], [0, 0, 5]])


def test_small_holes_are_filled_linearly_and_large_ones_stay():
    row, column = np.mgrid[:60, :60]
    plan = np.stack([EAST_M + column, NORTH_M + row], axis=-1).reshape(-1, 2).astype(float)
    from_small, from_large = plan - [EAST_M + 12, NORTH_M + 12], plan - [EAST_M + 40, NORTH_M + 40]
    small, large = (np.abs(from_small) <= 3).all(axis=1), (np.abs(from_large) <= 6).all(axis=1)
    frame = frame_over(plan, 1.0)
    heights = point_heights([over_plane(plan[~small & ~large])], frame, 8.0)
    places = places_of(frame)
    unknown = np.isnan(heights)
    assert unknown.sum() == 13 * 13
    assert (np.abs(places[unknown] - [EAST_M + 40, NORTH_M + 40]) <= 6).all()
    np.testing.assert_allclose(heights[~unknown], plane(places)[~unknown], atol=1e-4)


def test_nothing_is_filled_beyond_the_points():
    covered = np.zeros((20, 20), bool)
    covered[5:15, 5:10] = True
    assert (close_gaps(covered, 3) == covered).all()


@pytest.mark.parametrize("count", [3_000, 120_000])
def test_nearly_all_pixels_of_the_spacing_hold_a_point(count):
    rng = np.random.default_rng(2)
    plan = rng.uniform(0, 1, (count, 2)) * [300, 200] + ORIGIN_M
    plan = plan[plan[:, 0] - EAST_M < 150 + 100 * np.sin((plan[:, 1] - NORTH_M) / 40)]  # a bay
    sample = SpacingSample(plan.min(axis=0), plan.max(axis=0), len(plan))
    for part in np.array_split(plan, 5):
        sample.add(part)
    density = count / 60_000
    assert 1.2 < sample.spacing() * np.sqrt(density) < 2.2
    assert sample.spacing() == float(f"{sample.spacing():.3g}")


def test_pairs_of_points_do_not_make_small_pixels():
    row, column = np.mgrid[:40, :40]
    plan = np.stack([column, row], axis=-1).reshape(-1, 2).astype(float)
    assert 0.9 < spacing_of_points(np.concatenate([plan, plan + np.array([0.01, 0.0])])) < 1.3


def test_one_place_has_no_spacing_and_a_line_has_one():
    assert spacing_of_points(np.zeros((50, 2))) == 0
    line = np.column_stack([np.arange(50.0), np.zeros(50)])
    assert spacing_of_points(line) == pytest.approx(1.0, rel=0.2)
