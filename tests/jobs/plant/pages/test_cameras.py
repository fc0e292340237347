import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.plant.pages.cameras import FILLED, box_corners, choose_cameras, frame_box

from tests.support.captures import look_at

BOX = np.array([[-1.0, 0.0, -1.0], [1.0, 3.0, 1.0]])


def camera_at(position, target=(0, 1.5, 0)):
    return Pinhole(
        width_px=400,
        height_px=600,
        focal_px=(500.0, 500.0),
        center_px=(200.0, 300.0),
        cam_from_world=look_at(position, target),
    )


def ring_of(count, radius=10.0, height=1.5):
    angles = 2 * np.pi * np.arange(count) / count
    return [camera_at((radius * np.sin(angle), height, radius * np.cos(angle))) for angle in angles]


def test_cameras_on_a_ring_are_chosen_from_all_sides():
    assert choose_cameras(ring_of(12), BOX, 4) in ([0, 3, 6, 9], [1, 4, 7, 10], [2, 5, 8, 11])


def test_all_are_chosen_where_there_are_few():
    assert choose_cameras(ring_of(3), BOX, 6) == [0, 1, 2]
    assert choose_cameras([], BOX, 6) == []
    assert choose_cameras(ring_of(3), BOX, 0) == []


def test_cameras_that_look_elsewhere_serve_only_where_too_few_see_it():
    away = [camera_at((0, 1.5, 10 + n), target=(0, 1.5, 100)) for n in range(3)]
    cameras = [*away, *ring_of(4)]
    assert choose_cameras(cameras, BOX, 4) == [3, 4, 5, 6]
    assert len(choose_cameras(cameras, BOX, 5)) == 5


def test_of_cameras_in_one_place_each_is_chosen_once():
    cameras = [camera_at((0, 1.5, 10))] * 4
    assert choose_cameras(cameras, BOX, 3) == [0, 1, 2]


def test_the_camera_that_sees_the_plant_largest_is_chosen_first():
    cameras = [camera_at((0, 1.5, distance)) for distance in (30, 9, 20)]
    assert choose_cameras(cameras, BOX, 1) == [1]


@given(
    azimuth_rad=st.floats(-7, 7),
    elevation_rad=st.floats(-1.5, 1.5),
    size_m=st.tuples(*[st.floats(0.01, 50)] * 3),
    low_m=st.tuples(*[st.floats(-100, 100)] * 3),
    size_px=st.sampled_from([(512, 512), (800, 500), (300, 900)]),
)
def test_all_of_a_box_is_in_the_picture_and_fills_it(azimuth_rad, elevation_rad, size_m, low_m, size_px):
    box = np.array([low_m, np.add(low_m, size_m)])
    camera = frame_box(box, azimuth_rad, elevation_rad, size_px)
    rotation = camera.cam_from_world[:, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    places, depth_m = camera.project(box_corners(box))
    reach = np.abs(places - np.array(size_px) / 2) / (np.array(size_px) / 2)
    assert (depth_m > 0).all()
    assert reach.max() == pytest.approx(FILLED, abs=1e-6)


def test_the_camera_stands_in_the_direction_of_the_angles():
    camera = frame_box(BOX, np.radians(90), 0.0, (100, 100))
    assert camera.position_m[0] > 1
    np.testing.assert_allclose(camera.position_m[1:], (1.5, 0), atol=1e-9)
    (above, right), _ = camera.project(np.array([[0, 2.5, 0], [0, 1.5, -0.5]]))  # up is up, and -Z right, from +X
    assert above[1] < 50
    assert right[0] > 50
