"""Pinhole cameras."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.geometry.pinhole import Pinhole


def camera(seed=0):
    cam_from_world = np.column_stack([Rotation.random(random_state=seed).as_matrix(), [0.1, -0.2, 0.5]])
    return Pinhole(
        width_px=40, height_px=30, focal_px=(50.0, 52.0), center_px=(19.0, 15.5), cam_from_world=cam_from_world
    )


@pytest.mark.parametrize("count", [0, 1, 20_000])
def test_points_project_as_by_the_matrix(count):
    points, cam = np.random.default_rng(0).normal(size=(count, 3)), camera()

    places, depth_m = cam.project(points)

    x, y, z = cam.cam_from_world @ np.column_stack([points, np.ones(count)]).T
    before = z > 0
    assert depth_m == pytest.approx(z, abs=1e-12)
    assert np.isnan(places[~before]).all()
    assert places[before, 0] == pytest.approx(x[before] / z[before] * 50 + 19, rel=1e-9)
    assert places[before, 1] == pytest.approx(y[before] / z[before] * 52 + 15.5, rel=1e-9)


def test_what_is_seen_is_where_it_was():
    rng, cam = np.random.default_rng(1), camera(3)
    places, depth_m = rng.uniform(0, 40, (9000, 2)), rng.uniform(0.1, 5, 9000)

    points = cam.unproject(places, depth_m)

    again, its_depth_m = cam.project(points)
    assert again == pytest.approx(places, abs=1e-8)
    assert its_depth_m == pytest.approx(depth_m, abs=1e-12)


def test_arrays_of_other_types_and_orders_are_taken():
    cam = camera()
    points = np.asfortranarray(np.random.default_rng(2).normal(size=(50, 3)).astype(np.float32))
    exact = cam.project(np.ascontiguousarray(points, np.float64))
    assert np.array_equal(cam.project(points)[0], exact[0], equal_nan=True)
    places = np.array([[3, 4], [5, 6]])
    assert cam.unproject(places, np.ones(2, np.float32)) == pytest.approx(cam.unproject(places * 1.0, np.ones(2)))


def test_the_ray_through_a_pixel_leads_to_it():
    cam = camera()
    rows, columns = np.indices((30, 40)).reshape(2, -1)
    points = cam.unproject(np.column_stack([columns + 0.5, rows + 0.5]), np.full(1200, 2.0))
    rays = cam.rays().reshape(-1, 3) * 2 - cam.cam_from_world[:, 3]
    assert points == pytest.approx(rays @ cam.cam_from_world[:, :3], abs=1e-12)
    assert cam.position_m == pytest.approx(cam.unproject(np.array([[7.0, 9.0]]), np.zeros(1))[0])


def test_a_resized_picture_shows_the_same_at_the_same_share_of_it():
    points, cam = np.random.default_rng(1).normal(size=(50, 3)), camera()
    large = cam.resized(100, 60)
    assert (large.width_px, large.height_px) == (100, 60)
    before, depth_m = cam.project(points)
    after, same_m = large.project(points)
    assert after == pytest.approx(before * (100 / 40, 60 / 30), nan_ok=True)
    assert np.array_equal(depth_m, same_m)
