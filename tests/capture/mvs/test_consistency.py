"""Depth maps of planes that agree, and what becomes of pixels that do not."""

import numpy as np
import pytest
from usdfoliage.capture.mvs.consistency import ConsistencySettings, keep_consistent
from usdfoliage.geometry.pinhole import Pinhole

SIZE = 60, 80
STEP_M = 0.01


def camera(x_m):
    return Pinhole(
        width_px=SIZE[1],
        height_px=SIZE[0],
        focal_px=(80.0, 80.0),
        center_px=(40.0, 30.0),
        cam_from_world=np.column_stack([np.eye(3), [-x_m, 0.0, 0.0]]),
    )


CAMERAS = [camera(-0.05), camera(0.0), camera(0.05)]


def keep(depths, **settings):
    return keep_consistent(CAMERAS, depths, [np.full(SIZE, STEP_M) for _ in depths], ConsistencySettings(**settings))


def wall(depth_m=1.0):
    return [np.full(SIZE, depth_m) for _ in CAMERAS]


def test_depth_on_which_all_views_agree_stays():
    for kept in keep(wall()):
        np.testing.assert_allclose(kept[:, 6:-6], 1.0, rtol=1e-6)


def test_a_patch_that_others_look_through_is_dropped():
    depths = wall()
    depths[1][20:40, 30:50] = 0.8
    kept = keep(depths)[1]
    assert not kept[20:40, 30:50].any()
    np.testing.assert_allclose(kept[:15, 6:-6], 1.0, rtol=1e-6)


def test_a_patch_behind_what_others_see_is_not_confirmed():
    depths = wall()
    depths[1][20:40, 30:50] = 1.3
    assert not keep(depths)[1][20:40, 30:50].any()


def test_noise_becomes_less():
    rng = np.random.default_rng(0)
    depths = [depth + rng.normal(0, 0.3 * STEP_M, SIZE) for depth in wall()]
    kept = keep(depths)[1]
    known = kept > 0
    assert known.mean() > 0.8
    assert np.std(kept[known]) < 0.8 * 0.3 * STEP_M


def test_small_pieces_are_dropped():
    depths = wall()
    for depth in depths:
        depth[:] = 0
    depths[0][10:14, 24:28] = depths[1][10:14, 20:24] = depths[2][10:14, 16:20] = 1.0
    assert not keep(depths, min_region_px=30)[1].any()
    assert np.count_nonzero(keep(depths, min_region_px=10)[1]) == 16


def test_no_depth_anywhere_is_no_depth():
    assert not any(kept.any() for kept in keep([np.zeros(SIZE)] * 3))


def test_one_view_has_nobody_to_ask():
    alone = keep_consistent(CAMERAS[:1], wall()[:1], [np.full(SIZE, STEP_M)])
    assert not alone[0].any()
    unasked = keep_consistent(CAMERAS[:1], wall()[:1], [np.full(SIZE, STEP_M)], ConsistencySettings(min_confirmed=0))
    np.testing.assert_array_equal(unasked[0], 1.0)


@pytest.mark.parametrize("wrong", [{"max_steps": 0.0}, {"max_views": 0}, {"min_confirmed": -1}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        ConsistencySettings(**wrong)
