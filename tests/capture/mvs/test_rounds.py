"""Depth of a few small photographs by all the rounds, against the truth."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.capture.mvs.packed_planes import pack_planes, reader_of_planes, unpack_planes
from usdfoliage.capture.mvs.patch_match import MatchedPlanes
from usdfoliage.capture.mvs.rounds import (
    MvsSettings,
    Round,
    drop_limits,
    estimate_depths,
    finish_depth,
    match_round,
    match_views,
    plan_depths,
)
from usdfoliage.errors import CaptureError

from tests.support.stereo_pictures import CAMERAS, SLANTED, STEP, camera, draw, inside

POINTS_M = np.random.default_rng(0).uniform((-0.3, -0.2, 0.8), (0.3, 0.2, 1.6), (200, 3))
ROUNDS = (
    Round(level=1, iterations=4, coherent=False),
    Round(level=0, iterations=3, coherent=False),
    Round(level=0, iterations=1, coherent=True, segments=True),
)
SETTINGS = MvsSettings(rounds=ROUNDS)


@pytest.fixture(scope="module")
def views():
    return [draw(cam, STEP, f"{k}.png") for k, cam in enumerate(CAMERAS)]


@pytest.fixture(scope="module")
def estimates(views):
    return estimate_depths(views, POINTS_M, SETTINGS)


def test_depth_is_found_and_uncertain_depth_is_not_kept(views, estimates):
    for view, found in zip(views, estimates, strict=True):
        kept = (found.depth_m > 0) & inside(10)
        assert kept.sum() > 0.6 * inside(10).sum()
        error = np.abs(found.depth_m / view.depth_m - 1)[kept]
        assert np.median(error) < 0.004
        assert np.mean(error < 0.02) > 0.95
        assert found.confidence[found.depth_m == 0].max() == 0
        assert found.confidence[kept].min() > 0


def test_rounds_one_by_one_give_the_same(views, estimates):
    plan = plan_depths([view.camera for view in views], POINTS_M, SETTINGS)
    planes = [None] * len(views)
    for number in range(len(ROUNDS)):
        before = tuple(planes)
        for index in reversed(range(len(views))):
            matched = match_round(number, index, plan, views.__getitem__, before.__getitem__, SETTINGS, threads=1)
            planes[index] = unpack_planes(pack_planes(matched), views[index].camera)
    found = finish_depth(2, plan, views.__getitem__, planes.__getitem__, SETTINGS, threads=1)
    assert np.array_equal(found.depth_m, estimates[2].depth_m)
    assert np.array_equal(found.normals, estimates[2].normals)


def test_progress_counts_every_view_of_every_round(views):
    calls = []
    estimate_depths(views, POINTS_M, replace(SETTINGS, rounds=ROUNDS[:1]), lambda *at: calls.append(at))
    assert calls == [(k, 4) for k in range(1, 5)]


def test_a_view_that_sees_something_else_has_no_depth(views):
    away = draw(camera(0.0, 0.0, (0.0, np.pi, 0.0)), SLANTED, "away.png")
    found = estimate_depths([*views[:3], away], POINTS_M, replace(SETTINGS, rounds=ROUNDS[:1]))
    assert found[3] is None
    assert all(each is not None for each in found[:3])


def test_views_from_one_place_cannot_be_matched():
    same = [draw(camera(), SLANTED, f"{k}.png") for k in range(3)]
    with pytest.raises(CaptureError, match=r"no two of 3 photographs .* only turned"):
        estimate_depths(same, POINTS_M, SETTINGS)


def test_cameras_that_only_turned_and_cameras_that_look_apart_have_different_errors():
    turned = [camera(0.0, 0.0, (0.0, angle, 0.0)) for angle in (0.0, 0.1, 0.2)]
    with pytest.raises(CaptureError, match="only turned"):
        plan_depths(turned)
    apart = [camera(5.0 * k, 0.0, (0.0, k * np.pi / 2, 0.0)) for k in range(3)]
    with pytest.raises(CaptureError, match="nearer to each other, or check the poses"):
        plan_depths(apart, POINTS_M)


@pytest.mark.parametrize(
    "wrong", [{"max_side_px": 8}, {"rounds": ()}, {"sources": 2}, {"sources": 40}, {"seed": -1}, {"farther": 0.5}]
)
def test_wrong_settings(wrong):
    with pytest.raises(ValueError, match=r"must|<="):
        MvsSettings(**wrong)


def test_surfaces_behind_the_plant_are_separated_from_it(views):
    near_points_m = POINTS_M * (1, 1, 0) + (0, 0, 1) * np.linspace(0.85, 1.05, len(POINTS_M))[:, None]
    plan = plan_depths([view.camera for view in views], near_points_m, SETTINGS)
    read_planes = reader_of_planes(match_views(views, plan, SETTINGS), [view.camera for view in views])
    behind, before = (inside(10) & np.isclose(views[0].depth_m, depth_m) for depth_m in (1.4, 1.0))
    assert np.mean(np.abs(read_planes(0).depth_m[behind] - 1.4) < 0.02) > 0.8
    depth_m = finish_depth(0, plan, views.__getitem__, read_planes, SETTINGS).depth_m
    assert np.mean(depth_m[before] > 0) > 0.6
    assert np.mean(depth_m[behind] > 0) < 0.02


def test_what_lies_at_the_ends_of_the_range_is_no_depth():
    planes = np.zeros((1, 5, 3), np.float32)
    planes[0, :, 0] = 1 / np.array([1.0, 1.02, 1.5, 3.95, 4.05])
    camera = replace(CAMERAS[0], width_px=5, height_px=1)
    matched = MatchedPlanes(camera=camera, planes=planes, cost=np.zeros((1, 5), np.float32))
    kept = drop_limits(matched, (1.0, 9.0), 4.0).planes[0, :, 0]
    assert (kept > 0).tolist() == [False, True, True, False, False]
