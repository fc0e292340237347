"""Places of leaves are seen where depth agrees, and without depth, where no other leaf stands before them."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.leaf.photographs.visibility import (
    ABSENT,
    HIDDEN,
    PRESUMED,
    SEEN,
    VisibilitySettings,
    estimate_spread,
    find_sights,
)
from usdfoliage.leaf.shape.surface import grid_places
from usdfoliage.leaf.shape.variation import default_leaf

from tests.support.leaves.pictures import front_camera, photograph, place_leaves
from tests.support.leaves.shapes import flat_leaf

CAMERA = front_camera()
UV = grid_places(np.linspace(-0.8, 0.8, 9), np.linspace(0.1, 0.9, 17))
GREEN = np.array([[0.1, 0.3, 0.05]] * 3)
SPREAD = 0.01


@pytest.fixture
def leaves():
    """Two flat leaves, the second before the upper half of the first."""
    return place_leaves(flat_leaf(), [(0.0, -0.1, 0.0), (0.0, 0.0, 0.1)], length_m=0.2)


def test_what_stands_before_a_leaf_hides_it(leaves):
    view = photograph(leaves, CAMERA, GREEN)
    sights = find_sights(leaves, view, UV, SPREAD)

    assert (sights.state[1] == SEEN).all()
    below, above = UV[:, 1] < 0.4, (UV[:, 1] > 0.65) & (np.abs(UV[:, 0]) < 0.4)
    assert (sights.state[0, below] == SEEN).all()
    assert (sights.state[0, above] == HIDDEN).all()
    assert sights.facing == pytest.approx(1, abs=0.03)


def test_inner_places_keep_a_pixel_from_every_edge(leaves):
    view = photograph(leaves, CAMERA, GREEN)
    border = grid_places((-1.0, 1.0), np.linspace(0.2, 0.8, 7))

    assert not find_sights(leaves, view, border, SPREAD).inner.any()
    assert find_sights(leaves, view, UV[np.abs(UV[:, 0]) < 0.7], SPREAD).inner[1].mean() > 0.9


def test_where_the_depth_lies_behind_a_leaf_is_absent(leaves):
    view = photograph(leaves.take([0]), CAMERA, GREEN)
    wider = replace(leaves, parameters=np.concatenate([flat_leaf(width=0.8)] * 2)).take([0])
    sights = find_sights(wider, view, UV, SPREAD)

    half, full = np.abs(UV[:, 0]) < 0.4, np.abs(UV[:, 0]) > 0.6
    assert (sights.state[0, half] == SEEN).all()
    assert (sights.state[0, full] == ABSENT).mean() > 0.95


def test_without_depth_leaves_hide_each_other(leaves):
    view = photograph(leaves, CAMERA, GREEN, depth=False)
    sights = find_sights(leaves, view, UV, SPREAD)

    assert (sights.state[1] == PRESUMED).all()
    assert (sights.state[0, UV[:, 1] < 0.4] == PRESUMED).all()
    assert (sights.state[0, (UV[:, 1] > 0.65) & (np.abs(UV[:, 0]) < 0.4)] == HIDDEN).all()
    assert sights.inner[0, UV[:, 1] < 0.4].mean() > 0.7


def test_small_holes_are_filled_by_guessing_and_the_open_sky_is_not(leaves):
    view = photograph(leaves.take([0]), CAMERA, GREEN, wall_m=0.0)
    view.depth_m[100:104, 110:130] = 0  # some pixels of the leaf
    wider = replace(leaves, parameters=np.concatenate([flat_leaf(width=0.8)] * 2)).take([0])
    sights = find_sights(wider, view, UV, SPREAD)

    half, full = np.abs(UV[:, 0]) < 0.4, np.abs(UV[:, 0]) > 0.6
    assert set(np.unique(sights.state[0, half])) == {SEEN, PRESUMED}
    assert (sights.state[0, full] == HIDDEN).mean() > 0.95


def test_outside_a_mask_there_is_no_leaf(leaves):
    view = photograph(leaves, CAMERA, GREEN, depth=False)
    left = np.zeros(view.depth_m.shape, bool)
    left[:, : CAMERA.width_px // 2] = True
    sights = find_sights(leaves, replace(view, mask=left), UV, SPREAD)

    assert (sights.state[1, UV[:, 0] < -0.1] == PRESUMED).all()
    assert (sights.state[1, UV[:, 0] > 0.1] == ABSENT).all()


def test_places_outside_the_picture_and_behind_the_camera_are_hidden():
    far = place_leaves(default_leaf(), [(2.0, 0.0, 0.0), (0.0, 0.0, 2.0)])
    sights = find_sights(far, photograph(far, CAMERA, GREEN), UV, SPREAD)

    assert (sights.state == HIDDEN).all()
    assert not sights.inner.any()


def test_steep_leaves_are_seen_too():
    steep = place_leaves(flat_leaf(), [(0.0, -0.02, 0.0)], length_m=0.2, tilt_deg=78.0)
    view = photograph(steep, CAMERA, GREEN)

    assert (find_sights(steep, view, UV, 0.002).state == SEEN).mean() > 0.95


@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_the_spread_is_that_of_the_noise(noise):
    base = np.column_stack([*np.random.default_rng(3).uniform(-0.2, 0.2, (2, 40)), np.linspace(-0.4, 0.1, 40)])
    leaves = place_leaves(default_leaf(), base, turn_deg=np.linspace(0, 300, 40))
    view = photograph(leaves, CAMERA, np.tile(GREEN[:1], (40, 1)))
    moved = view.depth_m + np.random.default_rng(0).normal(0, noise * 0.1, view.depth_m.shape).astype(np.float32)

    assert estimate_spread(leaves, [replace(view, depth_m=moved)]) == pytest.approx(noise, rel=0.25)


def test_without_depth_the_spread_is_the_smallest_one(leaves):
    view = photograph(leaves, CAMERA, GREEN, depth=False)

    assert estimate_spread(leaves, [view]) == VisibilitySettings().min_spread
    assert estimate_spread(leaves, []) == VisibilitySettings().min_spread


@pytest.mark.parametrize("name", ["widths", "min_spread"])
def test_settings_must_be_above_0(name):
    with pytest.raises(ValueError, match=f"{name} must be above 0, not 0"):
        VisibilitySettings(**{name: 0})
