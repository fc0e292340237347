"""Branches of a drawn tree, traced from one stroke."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.sketch.foliage import find_foliage
from usdfoliage.sketch.tracing import branch_odds, trace_tree

from tests.support.photographs.drawn_trees import BARK, LEAF, draw_bare, draw_leafy


def resampled(line, step=2.0):
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.arange(0, arc[-1], step)
    return np.stack([np.interp(at, arc, line[:, k]) for k in range(2)], axis=-1)


def nearest(points, others):
    return np.linalg.norm(points[:, None] - others, axis=2).min(axis=1)


@pytest.fixture(scope="module")
def bare():
    tree = draw_bare()
    foliage = find_foliage(tree.srgb, tree.strokes.crown_px, 0, branches_px=tree.strokes.branches_px)
    odds = branch_odds(tree.srgb, tree.strokes, foliage, 0)
    return tree, trace_tree(odds, tree.strokes)


def test_all_branches_are_traced_and_no_other(bare):
    tree, traced = bare
    true = np.concatenate([resampled(line) for line in tree.branches])
    found = np.concatenate([resampled(branch.points_px) for branch in traced.branches])
    assert (nearest(true, found) < 6).mean() > 0.97
    assert (nearest(found, true) < 6).mean() > 0.97
    assert len(traced.branches) == 4


def test_the_stroke_goes_on_where_somebody_stopped_drawing(bare):
    _, traced = bare
    trunk = traced.branches[0]
    assert trunk.drawn
    assert trunk.parent == -1
    assert trunk.points_px[-1, 1] < 0.2 * 500  # the stroke ends at .6


def test_branches_leave_from_points_of_their_parents(bare):
    _, traced = bare
    for number, branch in enumerate(traced.branches):
        if branch.parent >= 0:
            assert branch.parent < number
            parent = traced.branches[branch.parent]
            np.testing.assert_array_equal(branch.points_px[0], parent.points_px[branch.parent_point])
            assert np.nanmax(branch.half_px) <= np.nanmax(parent.half_px) + 0.5


def test_half_of_the_thickness_is_that_of_the_picture(bare):
    _, traced = bare
    assert np.nanmax(traced.branches[0].half_px) == pytest.approx(7, abs=1.0)


def test_leaves_hide_what_a_stroke_goes_over():
    tree = draw_leafy()
    foliage = find_foliage(tree.srgb, tree.strokes.crown_px, 0, branches_px=tree.strokes.branches_px)
    traced = trace_tree(branch_odds(tree.srgb, tree.strokes, foliage, 0), tree.strokes)
    assert len(traced.branches) == 1
    np.testing.assert_allclose(traced.branches[0].points_px[[0, -1]], [[150, 380], [150, 200]], atol=3)


def test_a_stem_that_has_the_colours_of_leaves_is_measured_below_the_crown():
    """In the crown nothing of it is seen; below, it is apart from grass and sky, and as thick as it was drawn."""
    tree = draw_leafy()
    below = ~tree.leaves & (np.abs(tree.srgb.astype(int) - BARK).max(axis=2) < 40)
    srgb = tree.srgb.copy()
    srgb[below] = np.clip(srgb[below].astype(int) + np.subtract(LEAF, BARK), 0, 255)
    foliage = find_foliage(srgb, tree.strokes.crown_px, 0, branches_px=tree.strokes.branches_px)
    traced = trace_tree(branch_odds(srgb, tree.strokes, foliage, 0), tree.strokes)
    trunk = traced.branches[0]
    open_px = trunk.points_px[:, 1] > np.nonzero(foliage.inside)[0].max() + 10
    assert open_px.any()
    np.testing.assert_allclose(trunk.half_px[open_px], below[300].sum() / 2, atol=1.5)


def test_what_looks_like_bark_below_the_crown_is_no_branch():
    """Shade under a crown lies along its lower border, and joins the stem."""
    tree = draw_bare()
    bottom = int(tree.strokes.crown_px[:, 1].max())
    odds = np.full(tree.srgb.shape[:2], -5, np.float32)
    odds[200:480, 194:207] = 5  # the stem
    odds[250:256, 200:330] = 5  # a limb in the crown
    odds[bottom + 1 : bottom + 6, 60:340] = 5
    stroke = np.array([[200.0, 475.0], [200.0, 205.0]])
    traced = trace_tree(odds, replace(tree.strokes, branches_px=(stroke,)))
    assert [round(float(branch.points_px[-1, 1]), -1) for branch in traced.branches[1:]] == [250]
