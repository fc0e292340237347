"""Rims without depth, filled up to the edges that a photograph shows."""

import numpy as np
import pytest
from usdfoliage.capture.view import View
from usdfoliage.leaf.segmentation.dense.patches import find_patches, fit_planes_of_view
from usdfoliage.leaf.segmentation.dense.rims import RimSettings, fill_rims

from tests.support.leaves.views import camera

EDGE, HOLE = 60, 5  # column where the leaf ends; pixels without depth on either side
SETTINGS = RimSettings(reach=0.06)


def half_leaf(wall=1.5, green=(40, 160, 60), grey=(90, 90, 90)):
    """A tilted leaf left of an edge before a wall, with a hole along the edge; and its true depth."""
    cam = camera(120, 80)
    columns = np.arange(120)
    true = np.broadcast_to(np.where(columns < EDGE, 1 / (1 + 2e-4 * columns), wall), (80, 120)).astype(np.float32)
    srgb = np.where((columns < EDGE)[None, :, None], green, grey).astype(np.uint8) * np.ones((80, 1, 1), np.uint8)
    depth = true.copy()
    depth[:, EDGE - HOLE : EDGE + HOLE] = 0
    return View(name="drawn.png", camera=cam, srgb=srgb, depth_m=depth), true


def fill(view, settings=SETTINGS):
    planes = fit_planes_of_view(view, view.depth_m, 0.0)
    return fill_rims(view.srgb, view.depth_m, planes, find_patches(view, view.depth_m, 0.0, planes=planes), settings)


def test_a_leaf_goes_on_to_its_edge_and_the_wall_up_to_it():
    view, true = half_leaf()
    filled = fill(view)
    known = view.depth_m > 0
    assert np.array_equal(filled[known], view.depth_m[known])
    inside = np.s_[3:-3, EDGE - HOLE : EDGE - 2]
    outside = np.s_[3:-3, EDGE + 2 : EDGE + HOLE]
    assert filled[inside] == pytest.approx(true[inside], abs=2e-4)
    assert filled[outside] == pytest.approx(true[outside], abs=2e-4)
    # Right at the edge a pixel is of either side, or stays unknown.
    nearest = np.minimum(np.abs(filled - true), np.abs(filled - 1.5))
    assert (nearest[3:-3, EDGE - 2 : EDGE + 2][filled[3:-3, EDGE - 2 : EDGE + 2] > 0] < 2e-2).all()


def test_where_colours_are_similar_nothing_is_guessed():
    view, _ = half_leaf(grey=(40, 160, 60))
    assert not fill(view)[:, EDGE - HOLE : EDGE + HOLE].any()


def test_leaves_close_together_are_left_alone():
    view, _ = half_leaf(wall=1.05)
    assert not fill(view)[:, EDGE - HOLE : EDGE + HOLE].any()


def test_only_near_pixels_are_filled():
    view, _ = half_leaf()
    filled = fill(view, RimSettings(reach=2 / 120))
    assert (filled[5:-5, EDGE - HOLE : EDGE - HOLE + 2] > 0).all()
    assert not filled[:, EDGE - HOLE + 2 : EDGE + HOLE - 2].any()
    assert fill(view, RimSettings(reach=0)) is view.depth_m


def test_settings_are_checked():
    with pytest.raises(ValueError, match="reach"):
        RimSettings(reach=1.0)
    with pytest.raises(ValueError, match="contrast"):
        RimSettings(contrast=-0.1)
