"""Leaves that are what is left of moved ones: rough, amid green without depth."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.capture.view import View
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.lost_surroundings import lower_confidence, measure_lost_surroundings

from tests.support.leaves.pictures import front_camera, photograph, place_leaves
from tests.support.leaves.shapes import flat_leaf

GREEN = np.array([0.05, 0.2, 0.03])
PLACES_M = [[-0.15, -0.05, 0], [0.0, -0.05, 0], [0.15, -0.05, 0]]


def three_leaves(residual: tuple[float, float, float] = (0.01, 0.01, 0.04)) -> Leaves:
    leaves = place_leaves(flat_leaf(), PLACES_M)
    return replace(leaves, residual_m=np.array(residual) * leaves.length_m)


def view_of(leaves: Leaves, x_m: float = 0.0, *, lost: bool) -> View:
    """Three leaves before a green wall, whose right third has no depth if it is lost."""
    camera = front_camera(x_m)
    view = photograph(leaves, camera, np.tile(GREEN, (3, 1)), wall_m=1.5)
    srgb = np.where((view.depth_m == 1.5)[..., None], np.array([60, 120, 50], np.uint8), view.srgb)
    depth_m = view.depth_m.copy()
    if lost:
        right = np.arange(camera.width_px)[None] > camera.project(np.array([[0.075, 0, 0]]))[0][0, 0]
        depth_m[right & (depth_m == 1.5)] = 0
    return replace(view, srgb=srgb, depth_m=depth_m)


def test_what_is_lost_is_a_share_of_the_ring_around_a_leaf():
    leaves = three_leaves()
    views = [view_of(leaves, x_m, lost=True) for x_m in (-0.1, 0.0, 0.1)]
    np.testing.assert_allclose(measure_lost_surroundings(leaves, views), [0, 0, 1], atol=0.02)
    views = [view_of(leaves, x_m, lost=False) for x_m in (-0.1, 0.0, 0.1)]
    np.testing.assert_array_equal(measure_lost_surroundings(leaves, views), [0, 0, 0])


def test_the_median_of_the_views_that_show_a_leaf_counts():
    leaves = three_leaves()
    views = [view_of(leaves, lost=lost) for lost in (True, False, False)]
    np.testing.assert_array_equal(measure_lost_surroundings(leaves, views), [0, 0, 0])
    elsewhere = replace(views[1], camera=front_camera(5.0))  # shows none of them
    assert measure_lost_surroundings(leaves, [views[0], elsewhere])[2] == pytest.approx(1, abs=0.02)


def test_what_is_not_green_is_not_lost():
    leaves = three_leaves()
    view = view_of(leaves, lost=True)
    grey = replace(view, srgb=np.full_like(view.srgb, 120))
    np.testing.assert_array_equal(measure_lost_surroundings(leaves, [grey]), [0, 0, 0])


def test_only_leaves_that_are_rough_amid_lost_depth_are_less_probable():
    confidence = np.array([0.9, 0.95, 0.9])
    rough = three_leaves()
    lowered = lower_confidence(rough, confidence, [view_of(rough, lost=True)])
    np.testing.assert_array_equal(lowered[:2], confidence[:2])
    assert lowered[2] < 0.1
    kept = lower_confidence(rough, confidence, [view_of(rough, lost=False)])
    np.testing.assert_array_equal(kept, confidence)
    even = three_leaves((0.01, 0.01, 0.01))
    np.testing.assert_array_equal(lower_confidence(even, confidence, [view_of(even, lost=True)]), confidence)


def test_without_leaves_views_or_residuals_nothing_changes():
    leaves, confidence = three_leaves(), np.array([0.9, 0.95, 0.9])
    np.testing.assert_array_equal(lower_confidence(leaves, confidence, []), confidence)
    unknown = replace(leaves, residual_m=None)
    np.testing.assert_array_equal(lower_confidence(unknown, confidence, [view_of(leaves, lost=True)]), confidence)
    none = leaves.take(np.zeros(0, np.intp))
    assert len(lower_confidence(none, np.zeros(0), [])) == 0


def test_the_result_does_not_depend_on_the_number_of_threads():
    leaves = three_leaves()
    views = [view_of(leaves, x_m, lost=True) for x_m in (-0.1, 0.0, 0.1)]
    one, two = (measure_lost_surroundings(leaves, views, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one, two)
