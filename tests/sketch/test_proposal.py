"""Strokes that are proposed where nobody drew any."""

import cv2
import numpy as np
import pytest
from usdfoliage.sketch.proposal import find_stem, propose_strokes

from tests.support.photographs.drawn_trees import BARK, LEAF, draw_leafy

SKY, FIELD, ROAD = (190, 210, 240), (120, 150, 70), (150, 150, 155)
GROUND_ROW, FOOT_ROW = 300, 330


def tree_beside_a_road():
    """A crown (H, W), and its photograph: a stem down to row FOOT_ROW, a road that begins beside it and goes askew."""
    rng = np.random.default_rng(0)
    srgb = np.empty((450, 400, 3), np.uint8)
    srgb[:] = SKY
    srgb[GROUND_ROW:] = FIELD
    cv2.fillPoly(srgb, [np.array([[235, GROUND_ROW + 10], [330, 449], [399, 449], [260, GROUND_ROW + 10]])], ROAD)
    cv2.rectangle(srgb, (192, 200), (208, FOOT_ROW), BARK, -1)
    crown = np.zeros(srgb.shape[:2], np.uint8)
    cv2.circle(crown, (200, 150), 110, 1, -1)
    srgb[crown > 0] = LEAF
    noisy = np.clip(srgb + rng.normal(0, 5, srgb.shape), 0, 255).astype(np.uint8)
    return crown > 0, noisy


def test_a_stem_is_followed_to_the_ground_and_not_along_the_road():
    crown, srgb = tree_beside_a_road()
    stem = find_stem(crown, srgb)
    below = stem[stem[:, 1] > 262]
    np.testing.assert_allclose(below[:, 0], 200, atol=9)
    assert stem[0, 1] == pytest.approx(FOOT_ROW, abs=14)
    assert (np.diff(stem[:, 1]) < 0).all()
    assert stem[-1, 1] < 200


def test_a_stem_that_the_picture_cuts_goes_to_its_border():
    crown, srgb = tree_beside_a_road()
    stem = find_stem(crown[:320], srgb[:320])
    assert stem[0, 1] == pytest.approx(319, abs=6)


def test_without_a_stem_it_begins_at_the_lowest_place_of_the_crown():
    crown, _ = tree_beside_a_road()
    plain = np.where(crown[..., None], np.uint8(80), np.uint8(200)) * np.ones(3, np.uint8)
    stem = find_stem(crown, plain)
    np.testing.assert_allclose(stem[0], [200.5, 261], atol=2)


def test_strokes_are_around_the_crown_and_up_the_stem():
    tree = draw_leafy()
    strokes = propose_strokes(tree.leaves, tree.srgb)
    drawn = np.zeros(tree.leaves.shape, np.uint8)
    cv2.fillPoly(drawn, [np.round(strokes.crown_px).astype(np.int32)], 1)
    assert (drawn[tree.leaves] > 0).all()
    assert drawn.sum() < 1.25 * tree.leaves.sum()
    (stem,) = strokes.branches_px
    assert stem[0, 0] == pytest.approx(150, abs=6)
    assert stem[0, 1] == pytest.approx(380, abs=16)
