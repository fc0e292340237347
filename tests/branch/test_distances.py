"""Distances between a cloud and branches: none on the surface, to either side what they are."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from usdfoliage.branch.distances import distances_to_cloud, distances_to_surface, place_on_axes, sample_axes

from tests.support.branch_clouds import cloud_of, cone, rings, small_tree
from tests.support.branch_shapes import fork, plant_of

STEP_M = 0.02


def pole(radius_m: float = 0.1):
    return plant_of((np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0]]), radius_m, None, 0))


def test_places_lie_in_even_steps_along_all_axes():
    plant = fork()
    places_m, radii_m, direction = sample_axes(plant, 0.25)
    assert len(places_m) == 4 + 4 + 4 + 3
    np.testing.assert_allclose(places_m[:8, 1], 0.125 + 0.25 * np.arange(8))
    np.testing.assert_allclose(direction[:8], np.broadcast_to([0, 1, 0], (8, 3)))
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1)
    np.testing.assert_allclose(radii_m, [0.05] * 8 + [0.03] * 4 + [0.015] * 3)


def test_radii_between_vertices_are_those_of_a_cone():
    plant = plant_of((np.array([[0, 0, 0], [0, 1, 0]]), np.array([0.1, 0.02]), None, 0))
    places_m, radii_m, _ = sample_axes(plant, 0.1)
    np.testing.assert_allclose(radii_m, 0.1 - 0.08 * places_m[:, 1])


@given(away=st.floats(0, 5), turn=st.floats(0, 7), height_m=st.floats(0.3, 1.7), radius_m=st.floats(0.01, 0.2))
def test_a_point_is_as_far_as_it_is_from_the_cylinder(away, turn, height_m, radius_m):
    """Inside as well, where the distance from a place of the axis is no measure."""
    point_m = np.array([[away * radius_m * np.cos(turn), height_m, away * radius_m * np.sin(turn)]])
    found_m = distances_to_surface(point_m, pole(radius_m), STEP_M)[0]
    assert found_m == pytest.approx(abs(away - 1) * radius_m, abs=1e-9)


def test_points_on_the_surface_of_a_tree_have_no_distance():
    away_m = distances_to_surface(cloud_of(small_tree(), 2000), small_tree(), STEP_M)
    assert away_m.max() < 0.001
    assert np.median(away_m) < 1e-4


def test_noise_is_found_as_what_it_is():
    points_m = cone([0, 0, 0], [0, 2, 0], 0.1, 20_000, noise_m=0.005)
    away_m = distances_to_surface(points_m, pole(), STEP_M)
    assert np.mean(away_m) == pytest.approx(0.005 * np.sqrt(2 / np.pi), rel=0.05)


def test_the_surface_is_near_a_dense_cloud_and_far_where_there_is_none():
    low_m = rings(0.1, np.arange(0, 1, 0.01), 64)
    away_m = distances_to_cloud(pole(), low_m, STEP_M)
    heights_m = sample_axes(pole(), STEP_M)[0][:, 1]
    assert away_m[heights_m < 1].max() < 0.01
    np.testing.assert_allclose(away_m[heights_m > 1.5], heights_m[heights_m > 1.5] - 0.99, atol=0.01)


def test_edges_without_length_have_no_direction_and_do_no_harm():
    plant = plant_of((np.array([[0, 0, 0], [0, 0, 0], [0, 1, 0]]), 0.1, None, 0))
    points_m = rings(0.1, np.linspace(0.2, 0.8, 7))
    np.testing.assert_allclose(distances_to_surface(points_m, plant, STEP_M), 0, atol=1e-9)
    assert np.isfinite(distances_to_cloud(plant, points_m, STEP_M)).all()


def test_no_points_have_no_distances():
    assert distances_to_surface(np.zeros((0, 3)), pole(), STEP_M).shape == (0,)


@pytest.mark.parametrize("apart_m", [0.3, 0.7, 5.0])
def test_places_on_axes_are_no_farther_apart_than_that(apart_m):
    plant = fork()
    places = place_on_axes(plant, apart_m)
    assert np.array_equal(np.unique(places.vertex), [0, 1, 3, 5])
    for vertex in (0, 1, 3, 5):
        start_m, end_m = plant.points_m[vertex], plant.points_m[vertex + 1]
        along_m = np.linalg.norm(places.points_m[places.vertex == vertex] - start_m, axis=1)
        length_m = np.linalg.norm(end_m - start_m)
        gaps_m = np.diff(np.concatenate([[-along_m[0]], along_m, [2 * length_m - along_m[-1]]]))
        assert (gaps_m <= apart_m + 1e-9).all() or len(along_m) == 1
        assert gaps_m == pytest.approx(gaps_m[0])
