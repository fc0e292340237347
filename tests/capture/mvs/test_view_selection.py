"""Which photographs are matched with one, for cameras on a known ring."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.capture.mvs.view_selection import ViewSelectionSettings, select_views
from usdfoliage.geometry.pinhole import Pinhole


def on_ring(angle_deg, radius_m=2.0):
    """A camera on a ring about the origin that looks at it, y down."""
    turn = Rotation.from_euler("y", angle_deg, degrees=True).as_matrix().T
    return Pinhole(
        width_px=200,
        height_px=200,
        focal_px=(250.0, 250.0),
        center_px=(100.0, 100.0),
        cam_from_world=np.column_stack([turn, (0.0, 0.0, radius_m)]),
    )


def test_neighbors_at_good_angles_come_first_and_others_never():
    angles = [0, 0.2, 3, 10, -15, 35, 60, 180]
    chosen = select_views([on_ring(angle) for angle in angles], 0, (1.5, 2.5), 8)
    names = [angles[k] for k in chosen]
    assert set(names[:2]) == {10, -15}
    assert {3, 35} < set(names)
    assert not {0.2, 180} & set(names)
    assert select_views([on_ring(angle) for angle in angles], 0, (1.5, 2.5), 2) == chosen[:2]


def test_scale_changes_nothing():
    angles = [0, 3, 10, -15, 35]
    for scale in (0.001, 1000.0):
        cameras = [on_ring(angle, 2.0 * scale) for angle in angles]
        assert select_views(cameras, 0, (1.5 * scale, 2.5 * scale), 8) == select_views(
            [on_ring(angle) for angle in angles], 0, (1.5, 2.5), 8
        )


def test_what_looks_elsewhere_is_not_chosen():
    away = on_ring(10)
    turned = Rotation.from_euler("y", 90, degrees=True).as_matrix() @ away.cam_from_world
    cameras = [on_ring(0), Pinhole(**{**away.__dict__, "cam_from_world": turned})]
    assert select_views(cameras, 0, (1.5, 2.5), 8) == []


def test_wrong_arguments():
    cameras = [on_ring(0), on_ring(10)]
    for range_m in ((0.0, 1.0), (2.0, 1.0)):
        with pytest.raises(ValueError, match="near < far"):
            select_views(cameras, 0, range_m, 1)
    for index, count in ((2, 1), (0, 0)):
        with pytest.raises(ValueError, match="cannot be chosen"):
            select_views(cameras, index, (1.0, 2.0), count)
    with pytest.raises(ValueError, match="min_angle_deg"):
        ViewSelectionSettings(min_angle_deg=10.0)
    with pytest.raises(ValueError, match="min_overlap"):
        ViewSelectionSettings(min_overlap=2.0)
