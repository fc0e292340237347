"""Bases are distinguished from apices by stalks, and where there are none, by the other leaves."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.fit.flip import flip_leaves
from usdfoliage.leaf.photographs.base_and_apex import DirectionSettings, distinguish_base_from_apex, learn_direction
from usdfoliage.leaf.photographs.stalks import StalkSettings, find_stalk_points
from usdfoliage.leaf.shape.variation import default_leaf

from tests.support.leaves.captures import known_foliage
from tests.support.leaves.pictures import front_camera, photograph, place_leaves

CAMERA = front_camera(width_px=480, height_px=360, focal_px=700.0)
GREEN, BROWN = np.array([0.1, 0.3, 0.05]), (110, 80, 50)
SPREAD = 0.01
SYMMETRIC = default_leaf()
SYMMETRIC[[0, 1], :] = (0, 1 / 3, 0.05), (0, 2 / 3, 0.05)
SYMMETRIC[2:5] = (0.2, 0.2, 0.0), (0.5, 0.35, 0.0), (0.8, 0.2, 0.0)
SYMMETRIC[5:] = 0


def scatter(parameters, count=24, seed=2):
    """Leaves beside each other, turned as they come."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-0.25, 0.25, 6), np.linspace(-0.17, 0.17, 4))
    middle = np.column_stack([x.ravel(), y.ravel(), rng.uniform(-0.02, 0.02, x.size)])[:count]
    turn = rng.uniform(0, 360, count)
    along = np.column_stack([-np.sin(np.radians(turn)), np.cos(np.radians(turn)), np.zeros(count)])
    return place_leaves(parameters, middle - 0.025 * along, length_m=0.05, turn_deg=turn)


def scaled_view(view, scale):
    pose = view.camera.cam_from_world * np.array([1, 1, 1, scale])
    return replace(view, depth_m=view.depth_m * np.float32(scale), camera=replace(view.camera, cam_from_world=pose))


def photograph_with_stalks(leaves, chosen, camera=CAMERA):
    """A photograph in which the chosen leaves have stalks a third as long as they are."""
    view = photograph(leaves, camera, np.tile(GREEN, (len(leaves), 1)))
    apex = leaves.asset_from_leaf() @ [0, 1, 0, 1]
    for leaf in np.flatnonzero(chosen):
        ends = np.stack([leaves.base_m[leaf], leaves.base_m[leaf] + 0.35 * (leaves.base_m[leaf] - apex[leaf])])
        (start, end), depth_m = camera.project(ends)
        line = cv2.line(
            np.zeros(view.depth_m.shape, np.uint8), np.rint(start).astype(int), np.rint(end).astype(int), 1, 2
        )
        stalk = (line > 0) & (view.depth_m > depth_m[0])
        view.depth_m[stalk] = depth_m[0]
        view.srgb[stalk] = BROWN
    return view


@given(flip=st.lists(st.booleans(), min_size=24, max_size=24))
@settings(max_examples=5, deadline=None)
def test_stalks_show_the_base(flip):
    leaves = scatter(SYMMETRIC)
    view = photograph_with_stalks(leaves, np.ones(24, bool))
    directions = distinguish_base_from_apex(flip_leaves(leaves, np.array(flip)), [view])

    assert directions.flip.tolist() == flip
    assert directions.certainty.min() > 0.6


def test_stalks_before_the_open_sky_show_the_base():
    leaves = scatter(SYMMETRIC)
    view = photograph_with_stalks(leaves, np.ones(24, bool))
    view.depth_m[view.depth_m == np.float32(1.5)] = 0
    flip = np.arange(24) % 2 == 0

    assert distinguish_base_from_apex(flip_leaves(leaves, flip), [view]).flip.tolist() == flip.tolist()


@pytest.mark.parametrize(("noisy", "scale"), [(False, 1.0), (True, 1.0), (False, 10.0), (False, 0.1)])
def test_the_bases_of_nearly_all_leaves_of_a_known_bed_are_found(noisy, scale):
    known = known_foliage()
    seen = known.visible >= 0.5
    leaves = replace(known.leaves, base_m=known.leaves.base_m * scale, length_m=known.leaves.length_m * scale)
    views = [scaled_view(view, scale) for view in (known.noisy_views if noisy else known.views)]
    flip = np.random.default_rng(7).random(len(leaves)) < 0.5
    directions = distinguish_base_from_apex(flip_leaves(leaves, flip), views)

    assert np.mean((directions.flip == flip)[seen]) >= 0.95


def test_the_base_of_one_leaf_with_a_stalk_is_found():
    leaf = place_leaves(SYMMETRIC, [(0.0, 0.0, 0.0)])
    view = photograph_with_stalks(leaf, [True])

    for flip in (False, True):
        assert distinguish_base_from_apex(flip_leaves(leaf, np.array([flip])), [view]).flip.tolist() == [flip]


def test_a_third_of_leaves_with_stalks_teach_the_others_their_taper():
    leaf = SYMMETRIC.copy()
    leaf[2:5] = (0.1, 0.28, 0.0), (0.45, 0.35, 0.0), (0.85, 0.1, 0.0)
    leaves = scatter(leaf)
    flip = np.random.default_rng(5).random(24) < 0.5
    view = photograph_with_stalks(leaves, np.arange(24) % 3 == 0)
    directions = distinguish_base_from_apex(flip_leaves(leaves, np.array(flip)), [view])

    assert directions.flip.tolist() == flip.tolist()


def test_taper_may_run_in_either_direction():
    leaf = SYMMETRIC.copy()
    leaf[2:5] = (0.15, 0.1, 0.0), (0.55, 0.35, 0.0), (0.9, 0.28, 0.0)  # widest near the apex
    leaves = scatter(leaf)
    view = photograph_with_stalks(leaves, np.arange(24) % 3 == 0)

    assert not distinguish_base_from_apex(leaves, [view]).flip.any()


def test_without_any_evidence_nothing_is_certain():
    leaf = place_leaves(SYMMETRIC, [(0.0, 0.0, 0.0)])
    directions = distinguish_base_from_apex(leaf, [photograph(leaf, CAMERA, GREEN[None])])

    assert directions.certainty[0] < 0.8


def test_no_leaves_and_no_views_are_answered():
    leaves = scatter(SYMMETRIC)
    none = distinguish_base_from_apex(leaves.take([False] * 24), [photograph(leaves, CAMERA, np.tile(GREEN, (24, 1)))])
    assert none.flip.shape == none.certainty.shape == (0,)

    blind = distinguish_base_from_apex(leaves, [])
    assert np.isfinite(blind.certainty).all()


def test_stalks_are_found_where_they_are_and_nowhere_else():
    leaves = scatter(SYMMETRIC)
    chosen = np.arange(24) == 8
    found = find_stalk_points(leaves, [photograph_with_stalks(leaves, chosen)], SPREAD)

    along = leaves.base_m[8] - leaves.asset_from_leaf()[8] @ [0, 1, 0, 1]
    t = (found.points_m - leaves.base_m[8]) @ along / (along @ along)
    aside = np.linalg.norm(found.points_m - leaves.base_m[8] - t[:, None] * along, axis=1)
    assert len(found.points_m) >= 4
    assert aside.max() < 0.004
    assert t.min() > -0.05
    assert t.max() < 0.4
    assert found.foreign.min() > 0.5


def test_larger_photographs_show_the_same_stalks():
    leaves = scatter(SYMMETRIC)
    large = front_camera(width_px=2400, height_px=1800, focal_px=3500.0)
    view = photograph(leaves, large, np.tile(GREEN, (24, 1)))
    base, apex = leaves.base_m[8], leaves.asset_from_leaf()[8] @ [0, 1, 0, 1]
    (start, end), depth_m = large.project(np.stack([base, base + 0.35 * (base - apex)]))
    line = cv2.line(np.zeros(view.depth_m.shape, np.uint8), np.rint(start).astype(int), np.rint(end).astype(int), 1, 9)
    stalk = (line > 0) & (view.depth_m > depth_m[0])
    view.depth_m[stalk], view.srgb[stalk] = depth_m[0], BROWN
    found = find_stalk_points(leaves, [view], SPREAD)

    assert len(found.points_m) >= 4
    assert np.linalg.norm(found.points_m - base, axis=1).max() < 0.025


def test_threads_change_no_stalk():
    leaves = scatter(SYMMETRIC)
    views = [photograph_with_stalks(leaves, np.arange(24) % 3 == rest) for rest in range(3)]
    one, many = (find_stalk_points(leaves, views, SPREAD, threads=threads) for threads in (1, 5))

    assert np.array_equal(one.points_m, many.points_m)
    assert np.array_equal(one.foreign, many.foreign)


def test_noise_of_depth_makes_no_stalks():
    leaves = scatter(SYMMETRIC)
    view = photograph(leaves, CAMERA, np.tile(GREEN, (24, 1)))
    rng = np.random.default_rng(0)
    noisy = view.depth_m + np.where(view.depth_m > 1.4, 0.01, 0.0005) * rng.normal(size=view.depth_m.shape)
    noisy[rng.random(noisy.shape) < 0.02] += 0.03

    found = find_stalk_points(leaves, [replace(view, depth_m=noisy.astype(np.float32))], SPREAD)
    stalks = find_stalk_points(leaves, [photograph_with_stalks(leaves, np.ones(24, bool))], SPREAD)
    assert len(found.points_m) < 0.05 * len(stalks.points_m)


@given(
    flip=st.lists(st.sampled_from([-1.0, 1.0]), min_size=30, max_size=30),
    expected=st.lists(st.floats(0, 1), min_size=2, max_size=2),
)
@settings(max_examples=30, deadline=None)
def test_odds_change_their_sign_with_the_leaf(flip, expected):
    evidence = np.random.default_rng(0).normal(0.5, 1, (30, 4))
    known = np.array([*expected, 0, 0])
    sign = np.array(flip)

    odds = learn_direction(evidence, known, 10, 5)
    assert learn_direction(evidence * sign[:, None], known, 10, 5) == pytest.approx(odds * sign, abs=1e-9)


def test_what_is_learnt_beats_what_is_expected():
    rng = np.random.default_rng(1)
    stalk = rng.normal(0.7, 1, (400, 1))  # a weak sign that is known
    taper = rng.normal(-2, 1, (400, 1))  # a strong one whose direction is not
    evidence = np.concatenate([stalk, taper, rng.normal(size=(400, 3))], axis=1)
    expected = np.array([1.0, 0, 0, 0, 0])

    before, after = (np.mean(learn_direction(evidence, expected, 10, turns) > 0) for turns in (0, 20))
    assert before < 0.8
    assert after > 0.96


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"stalk": -1.0}, "stalk must be 0 or more"),
        ({"prior_leaves": 0.0}, "prior_leaves must be above 0"),
        ({"turns": -1}, "turns must be 0 or more"),
    ],
)
def test_wrong_settings_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        DirectionSettings(**wrong)
    with pytest.raises(ValueError, match="width must be above 0, not 0"):
        StalkSettings(width=0)
