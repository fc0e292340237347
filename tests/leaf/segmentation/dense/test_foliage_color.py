"""Leaves of the colour of the soil get a low factor, where leaves and soil differ at all."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.capture.view import View
from usdfoliage.leaf.segmentation.dense.foliage_color import BINS, index_colors, judge_colors

from tests.support.leaves.proposals import evidence_of, flat_leaves
from tests.support.leaves.views import camera

GREEN, BROWN = (60, 140, 50), (120, 85, 50)
LEAVES = flat_leaves([(-0.09 + 0.03 * (k % 7), -0.07 + 0.05 * (k // 7), 1.0) for k in range(14)], 0.04, 0.25)
QUALITY = np.linspace(0.5, 0.9, 14)


def painted(leaf_colors, ground=BROWN, x: float = 0.0) -> View:
    """The leaves lie on the ground, a plane 1 m away, each painted in its colour."""
    cam = camera(width=260, height=180, x=x)
    rays = cam.rays()
    places = rays[..., :2] + (x, 0)
    srgb = np.empty((*rays.shape[:2], 3), float)
    srgb[:] = ground
    for base, color in zip(LEAVES.base_m, leaf_colors, strict=True):
        middle = base[:2] + np.array([0, 0.02])
        srgb[(np.square((places - middle) / (0.011, 0.022)).sum(axis=-1) < 1)] = color
    srgb += np.random.default_rng(0).normal(0, 3, srgb.shape)
    depth_m = np.ones(rays.shape[:2], np.float32)
    return View(name="painted.png", camera=cam, srgb=np.clip(srgb, 0, 255).astype(np.uint8), depth_m=depth_m)


def judge(views, leaves=LEAVES, quality=QUALITY, depths_m=None):
    depths_m = [view.depth_m for view in views] if depths_m is None else depths_m
    return judge_colors(index_colors(views), views, depths_m, evidence_of(leaves), 0.002, quality)


@pytest.mark.parametrize("brown", [(0, 5, 9), (13,), (1, 12, 13)])  # among the best, too
def test_leaves_of_the_colour_of_soil_get_a_low_factor(brown):
    colors = [BROWN if leaf in brown else GREEN for leaf in range(14)]
    factor = judge([painted(colors), painted(colors, x=0.01)])
    is_brown = np.isin(np.arange(14), brown)
    assert (factor[~is_brown] == 1).all()
    assert (factor[is_brown] < 0.3).all()


def test_leaves_of_any_colour_but_that_of_the_soil_are_trusted():
    colors = [(170, 60, 60)] * 14
    assert (judge([painted(colors, ground=(90, 140, 70))]) == 1).all()


def test_where_all_has_one_colour_every_factor_is_1():
    assert (judge([painted([GREEN] * 14, ground=GREEN)]) == 1).all()


def test_a_colour_that_is_rare_everywhere_is_not_that_of_a_leaf():
    leaves = flat_leaves([(-0.11 + 0.02 * (k % 12), -0.08 + 0.04 * (k // 12), 1.0) for k in range(48)], 0.03, 0.3)
    cam = camera(width=260, height=180, x=0.0)
    rays = cam.rays()
    srgb = np.empty((*rays.shape[:2], 3), float)
    srgb[:] = (20, 20, 20)  # a dark room
    red, soil = {3, 17, 29, 40}, {8}
    for leaf, base in enumerate(leaves.base_m):
        inside = (np.square((rays[..., :2] - base[:2] - (0, 0.015)) / (0.006, 0.017)).sum(axis=-1)) < 1
        srgb[inside] = (190, 50, 50) if leaf in red else GREEN
        if leaf in soil:  # a bit of this, a bit of that, each of which is rare
            srgb[inside] = np.random.default_rng(1).uniform((70, 20, 0), (200, 110, 150), (int(inside.sum()), 3))
    view = View(name="room.png", camera=cam, srgb=srgb.astype(np.uint8), depth_m=np.ones(rays.shape[:2], np.float32))
    # The bit of soil is no worse by its shape, but one of 48, while four leaves are red.
    quality = np.where(np.arange(48) == 8, 0.6, np.where(np.isin(np.arange(48), [3, 17]), 0.9, 0.7))
    factor = judge([view], leaves, quality)
    assert factor[8] < 0.05
    assert (np.delete(factor, 8) > 0.95).all()


def test_light_and_shadow_do_not_matter():
    dark = tuple(round(0.6 * channel) for channel in GREEN)
    colors = [dark if leaf % 3 == 0 else GREEN for leaf in range(14)]
    assert (judge([painted(colors)]) > 0.9).all()


def test_leaves_that_no_view_shows_keep_the_factor_1():
    colors = [BROWN if leaf < 3 else GREEN for leaf in range(14)]
    view = painted(colors)
    away = LEAVES.base_m + np.where(np.arange(14)[:, None] < 2, (0, 0, 0.05), (0, 0, 0))  # below the ground
    factor = judge([view], replace(LEAVES, base_m=away))
    assert factor[:2] == pytest.approx([1, 1])
    assert factor[2] < 0.3
    hidden = np.zeros_like(view.depth_m)
    assert (judge([view], depths_m=[hidden]) == 1).all()


def test_no_leaves():
    none = flat_leaves(np.zeros((0, 3)))
    assert judge([painted([GREEN] * 14)], none, np.zeros(0)).shape == (0,)


def test_quality_of_zero_alone_still_gives_numbers():
    assert np.isfinite(judge([painted([GREEN] * 14)], quality=np.zeros(14))).all()


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.integers(0, 255)] * 3), st.integers(0, 255))
def test_every_colour_has_a_bin_and_greys_share_theirs(color, grey):
    row = np.array([[color, (grey,) * 3, (128,) * 3]], np.uint8)
    cam = camera(width=3, height=1)
    view = View(name="row.png", camera=cam, srgb=row, depth_m=np.ones((1, 3), np.float32))
    (index,) = index_colors([view])
    assert index.shape == (1, 3)
    assert 0 <= index.min() <= index.max() < BINS * BINS
    assert index[0, 1] == index[0, 2]
