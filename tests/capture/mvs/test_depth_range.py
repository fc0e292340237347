"""The range of depths that a photograph is searched for."""

import numpy as np
import pytest
from usdfoliage.capture.mvs.depth_range import depth_range_m
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.pinhole import Pinhole

WIDTH, HEIGHT, FOCAL = 160, 120, 150.0


def camera(x_m, y_m=0.0, turn_deg=0.0):
    """Looks along z, from x, y, 0, turned about the vertical."""
    turn = np.radians(turn_deg)
    rotation = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    position = np.array([x_m, y_m, 0.0])
    return Pinhole(
        width_px=WIDTH,
        height_px=HEIGHT,
        focal_px=(FOCAL, FOCAL),
        center_px=(WIDTH / 2, HEIGHT / 2),
        cam_from_world=np.column_stack([rotation, -rotation @ position]),
    )


CAMERAS = [camera(-0.2, 0.02, 6), camera(-0.1, -0.01, 3), camera(0.0), camera(0.1, 0.01, -3), camera(0.2, -0.02, -6)]


def test_range_is_that_of_the_points_seen():
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-0.2, 0.2, (500, 2)), rng.uniform(0.8, 1.2, 500)])
    behind = points * (1, 1, -1)
    near, far = depth_range_m(CAMERAS, 2, np.concatenate([points, behind]))
    assert 0.7 < near < 0.81
    assert 1.19 < far < 1.35


def test_range_without_points_is_around_what_all_look_at():
    cameras = [camera(x, turn_deg=-np.degrees(np.arctan(x))) for x in (-0.3, 0.0, 0.3)]
    assert depth_range_m(cameras, 1) == pytest.approx((0.5, 2.0))


def test_cameras_that_look_at_nothing_need_points():
    away = [camera(x, turn_deg=np.degrees(np.arctan(x))) for x in (-0.3, 0.0, 0.3)]
    with pytest.raises(CaptureError, match="give points3D"):
        depth_range_m(away, 1)
