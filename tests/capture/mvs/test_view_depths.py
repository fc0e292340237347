"""Depth of views in memory, against the truth, and as the rounds one by one find it."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.capture.clear_sky import ClearSkySettings
from usdfoliage.capture.mvs.patch_match import PatchMatchSettings
from usdfoliage.capture.mvs.rounds import MvsSettings, Round, estimate_depths
from usdfoliage.capture.mvs.view_depths import (
    MASK_MARGIN_PX,
    PhotographDepthSettings,
    estimate_view_depths,
    view_to_match,
)
from usdfoliage.errors import CaptureError

from tests.support.stereo_pictures import CAMERAS, STEP, camera, draw, inside

UP = np.array([0.0, -1.0, 0.0])
POINTS_M = np.random.default_rng(0).uniform((-0.3, -0.2, 0.8), (0.3, 0.2, 1.6), (200, 3))
DEPTH = MvsSettings(
    rounds=(Round(level=1, iterations=3, coherent=False), Round(level=0, iterations=2, coherent=True)),
    matching=PatchMatchSettings(best_sources=2),
)
SETTINGS = PhotographDepthSettings(depth=DEPTH)


@pytest.fixture(scope="module")
def views():
    return [draw(cam, STEP, f"{k}.png") for k, cam in enumerate(CAMERAS)]


@pytest.fixture(scope="module")
def found(views):
    return estimate_view_depths(views, UP, POINTS_M, SETTINGS)


def test_depth_is_that_of_the_planes(views, found):
    assert found.remarks == ()
    assert [view.name for view in found.views] == [view.name for view in views]
    for view, seen in zip(views, found.views, strict=True):
        kept = (seen.depth_m > 0) & inside(10)
        assert kept.sum() > 0.5 * inside(10).sum()
        error = np.abs(seen.depth_m / view.depth_m - 1)[kept]
        assert np.median(error) < 0.006
        assert np.mean(error < 0.03) > 0.93


def test_it_is_what_the_rounds_find(views, found):
    for seen, estimate in zip(found.views, estimate_depths(views, POINTS_M, DEPTH), strict=True):
        assert np.array_equal(seen.depth_m, estimate.depth_m)


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_change_nothing(views, found, threads):
    again = estimate_view_depths(views, UP, POINTS_M, SETTINGS, threads=threads)
    for one, other in zip(found.views, again.views, strict=True):
        assert np.array_equal(one.depth_m, other.depth_m)


def test_the_progress_counts_rounds_and_the_end(views):
    calls = []
    estimate_view_depths(views, UP, POINTS_M, SETTINGS, lambda *at: calls.append(at))
    assert calls == [(k, 12) for k in range(1, 13)]


def test_a_reduced_photograph_has_depth_at_its_own_size(views):
    small = replace(SETTINGS, depth=replace(DEPTH, max_side_px=64))
    seen = estimate_view_depths(views, UP, POINTS_M, small).views[0]
    assert seen.depth_m.shape == views[0].depth_m.shape
    kept = (seen.depth_m > 0) & inside(10)
    assert kept.mean() > 0.2
    assert np.median(np.abs(seen.depth_m / views[0].depth_m - 1)[kept]) < 0.015


def test_nothing_is_found_outside_a_mask_and_its_margin(views):
    left = np.zeros(views[0].depth_m.shape, bool)
    left[:, :48] = True
    masked = [replace(view, mask=left) for view in views]
    for view in estimate_view_depths(masked, UP, POINTS_M, SETTINGS).views:
        assert not view.depth_m[:, 48 + MASK_MARGIN_PX :].any()
    unmasked = estimate_view_depths(masked, UP, POINTS_M, replace(SETTINGS, mask="none")).views[0]
    assert unmasked.depth_m[~left].any()
    assert np.array_equal(unmasked.mask, left)  # who looks for leaves sees the mask nevertheless


def test_a_view_that_sees_something_else_has_no_depth_and_is_named(views):
    away = draw(camera(0.0, 0.0, (0.0, np.pi, 0.0)), STEP, "away.png")
    found = estimate_view_depths([*views[:3], away], UP, POINTS_M, SETTINGS)
    assert not found.views[3].has_depth
    assert all(view.has_depth for view in found.views[:3])
    (one_remark,) = [each for each in found.remarks if each.code == "photographs-without-companion"]
    assert one_remark.subject == "away.png"


def test_depth_that_was_there_is_not_looked_at(views, found):
    bare = [replace(view, depth_m=np.zeros_like(view.depth_m)) for view in views]
    again = estimate_view_depths(bare, UP, POINTS_M, SETTINGS)
    assert all(np.array_equal(a.depth_m, b.depth_m) for a, b in zip(found.views, again.views, strict=True))


def test_views_from_one_place_cannot_be_matched(views):
    with pytest.raises(CaptureError, match=r"no two of 3 photographs .* only turned"):
        estimate_view_depths([replace(views[0], name=f"{k}.png") for k in range(3)], UP, POINTS_M, SETTINGS)


def test_sky_is_no_part_of_a_view_that_has_no_mask(views):
    srgb = views[0].srgb.copy()
    srgb[:30] = (120, 170, 240)
    view = replace(views[0], srgb=srgb)
    assert view_to_match(view, 96, None, UP).mask is None
    mask = view_to_match(view, 96, ClearSkySettings(), UP).mask
    assert mask is not None
    assert not mask[:25].any()
    assert mask[40:].mean() > 0.9
    everything = np.ones_like(view.mask if view.mask is not None else view.depth_m, bool)
    assert view_to_match(replace(view, mask=everything), 96, ClearSkySettings(), UP).mask.all()
