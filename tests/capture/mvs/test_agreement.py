"""Which depth is believed, on pictures whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.capture.mvs.agreement import (
    AgreementSettings,
    choose_pixels,
    confirm_depth,
    drop_fringe,
    drop_small_pieces,
    smooth_depth,
)
from usdfoliage.capture.mvs.patch_match import MatchedPlanes

from tests.support.stereo_pictures import CAMERAS, HEIGHT, SLANTED, WIDTH, draw, exact_planes, inside

SIZE = HEIGHT, WIDTH


def test_what_the_others_confirm_is_kept_and_what_not_is_not():
    planes = [exact_planes(cam, SLANTED[0][0]) for cam in CAMERAS]
    wrong = planes[0].planes.copy()
    wrong[30:50, 40:60, 0] *= 1.2
    own = MatchedPlanes(camera=CAMERAS[0], planes=wrong, cost=planes[0].cost)
    view = draw(CAMERAS[0], SLANTED)
    # A texture of noise has any colour anywhere, so colours do not show what lies behind.
    found = confirm_depth(own, [*planes[1:], None], [], view.srgb, AgreementSettings(fringe_px=0))
    assert not found.depth_m[33:47, 43:57].any()
    good = inside(18).copy()
    good[26:54, 36:64] = False
    assert (found.depth_m[good] > 0).all()
    assert found.depth_m[good] == pytest.approx(view.depth_m[good], rel=3e-3)
    assert (found.confidence[good] > 0.9).all()
    assert (found.agreeing[good] >= 2).all()
    assert not found.normals[found.depth_m == 0].any()


def test_nothing_is_believed_without_other_views_that_agree():
    plane = exact_planes(CAMERAS[0], SLANTED[0][0])
    far = [exact_planes(cam, SLANTED[0][0] * 0.7) for cam in CAMERAS[1:]]
    view = draw(CAMERAS[0], SLANTED)
    assert not confirm_depth(plane, far, [], view.srgb).depth_m.any()
    poor = MatchedPlanes(camera=plane.camera, planes=plane.planes, cost=np.full(SIZE, 1.4, np.float32))
    agreeing = [exact_planes(cam, SLANTED[0][0]) for cam in CAMERAS[1:]]
    assert not confirm_depth(poor, agreeing, [], view.srgb).depth_m.any()


def test_what_more_views_see_through_than_agree_with_is_dropped():
    # Two planes: behind the near one every other view but two sees the far one.
    near, far = SLANTED[0][0], SLANTED[0][0] * 0.8
    own = exact_planes(CAMERAS[0], near)
    agreeing = [exact_planes(cam, near) for cam in CAMERAS[1:3]]
    through = [exact_planes(CAMERAS[3], far)] * 3
    view = draw(CAMERAS[0], SLANTED)
    settings = AgreementSettings(fringe_px=0, smoothness=0, min_region_px=0, filter_px=0)
    middle = inside(24)
    assert (confirm_depth(own, [*agreeing, *through[:2]], [], view.srgb, settings).depth_m[middle] > 0).all()
    assert not confirm_depth(own, [*agreeing, *through], [], view.srgb, settings).depth_m[middle].any()
    lenient = replace(settings, through=1.5)
    assert (confirm_depth(own, [*agreeing, *through], [], view.srgb, lenient).depth_m[middle] > 0).all()


def test_the_fringe_of_a_thin_thing_is_what_has_the_colour_behind_it():
    depth_m, srgb = np.full((40, 60), 3, np.float32), np.full((40, 60, 3), 230, np.uint8)
    depth_m[:, 26:34] = 1  # what windows made of a stem 4 pixels wide
    srgb[:, 28:32] = (60, 90, 20)
    found = drop_fringe(depth_m, srgb)
    stem = np.zeros((40, 60), bool)
    stem[:, 28:32] = True
    assert (found[stem] == 1).all()
    assert not (found[~stem] == 1).any()
    assert np.array_equal(drop_fringe(depth_m, srgb, AgreementSettings(fringe_px=0)), depth_m)
    low = AgreementSettings(fringe_contrast=700)  # a smaller difference in brightness does not count
    assert np.array_equal(drop_fringe(depth_m, srgb, low), depth_m)


def test_the_cut_follows_edges_of_the_photograph():
    # Depth runs five pixels beyond the leaf's edge, onto a wall that has none.
    srgb = np.full((*SIZE, 3), (150, 150, 150), np.uint8)
    srgb[:, :40] = (50, 120, 40)
    depth_m = np.zeros(SIZE, np.float32)
    depth_m[:, :45] = 1.0
    likelihood = np.where(np.arange(WIDTH) < 40, 0.9, 0.3) * np.ones(SIZE)
    kept = choose_pixels(likelihood, depth_m > 0, depth_m, srgb, AgreementSettings(min_likelihood=0.35))
    assert kept[:, :40].all()
    assert not kept[:, 40:].any()
    # Holes in the leaf, where too few views agree, are filled; without a cut they stay.
    likelihood[20:23, 10:13] = 0
    confirmed = depth_m > 0
    confirmed[20:23, 10:13] = False
    assert choose_pixels(likelihood, confirmed, depth_m, srgb)[20:23, 10:13].all()
    assert not choose_pixels(likelihood, confirmed, depth_m, srgb, AgreementSettings(smoothness=0.0))[
        20:23, 10:13
    ].any()


def test_the_filter_smooths_a_plane_and_keeps_a_step():
    rng = np.random.default_rng(5)
    step = np.where(np.arange(WIDTH) < 48, 1.0, 1.3) * np.ones(SIZE)
    noisy = (step * (1 + rng.normal(0, 0.001, SIZE))).astype(np.float32)
    srgb = np.full((*SIZE, 3), 128, np.uint8)
    srgb[:, 48:] = 60
    smooth = smooth_depth(noisy, np.ones(SIZE), srgb)
    before, after = (np.abs(depth / step - 1) for depth in (noisy, smooth))
    assert np.median(after) < 0.5 * np.median(before)
    assert after.max() < 0.01
    assert np.array_equal(smooth_depth(noisy, np.ones(SIZE), srgb, AgreementSettings(filter_px=0)), noisy)


def test_small_pieces_are_dropped():
    depth_m = np.zeros(SIZE, np.float32)
    depth_m[5:8, 5:8] = 1.0
    depth_m[20:30, 20:30] = 1.0
    depth_m[24:27, 24:27] = 1.5  # a jump parts it
    kept = drop_small_pieces(depth_m, 0.01, 12)
    assert not kept[5:8, 5:8].any()
    assert not kept[24:27, 24:27].any()
    assert np.count_nonzero(kept) == 91
    assert np.array_equal(drop_small_pieces(depth_m, 0.01, 0), depth_m)


@pytest.mark.parametrize("wrong", [{"max_cost": 4.0}, {"agree_px": 0.0}, {"edge": np.nan}, {"smoothness": -1.0}])
def test_wrong_settings(wrong):
    with pytest.raises(ValueError, match="must be"):
        AgreementSettings(**wrong)
