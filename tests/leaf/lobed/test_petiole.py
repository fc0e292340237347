"""The petiole set apart from the blade, and sinuses opened, in drawn leaves."""

import cv2
import numpy as np
import pytest
from usdfoliage.leaf.lobed.petiole import split_petiole
from usdfoliage.leaf.lobed.sinuses import open_sinuses

WHITE, GREEN, BROWN = (240, 238, 232), (70, 110, 50), (150, 90, 80)


def drawn(petiole: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A picture of a round leaf with a petiole, its blade and the petiole."""
    blade, line = np.zeros((400, 400), np.uint8), np.zeros((400, 400), np.uint8)
    cv2.circle(blade, (200, 200), 120, 1, cv2.FILLED)
    cv2.polylines(line, [np.array(petiole)], False, 1, 5)
    picture = np.full((400, 400, 3), WHITE, np.float64)
    picture[blade > 0], picture[line > 0] = GREEN, BROWN
    noise = np.random.default_rng(0).normal(0, 3, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8), blade > 0, line > 0


@pytest.mark.parametrize("petiole", [[(200, 320), (205, 390)], [(200, 315), (190, 190)], [(200, 250), (240, 395)]])
def test_the_blade_is_whole_where_a_petiole_lies_beside_or_over_it(petiole):
    picture, blade, line = drawn(petiole)
    split = split_petiole(picture, blade | line)
    assert (split.blade & blade).sum() / (split.blade | blade).sum() > 0.98
    assert (split.petiole & line).sum() > 0.6 * line.sum()
    gaps = np.linalg.norm(split.ends[:, None] - np.array([petiole[0], petiole[-1]]), axis=2).min(axis=0)
    assert (gaps < 25).all()


def test_a_petiole_that_is_missing_in_the_mask_is_a_slit_and_filled():
    picture, blade, line = drawn([(80, 200), (200, 205)])
    split = split_petiole(picture, blade & ~line)
    assert (split.blade & blade).sum() / (split.blade | blade).sum() > 0.98


def test_a_leaf_without_a_petiole_stays_as_it_is():
    picture, blade, _ = drawn([(0, 0), (0, 0)])
    split = split_petiole(picture, blade)
    assert not split.petiole.any()
    assert len(split.ends) == 0
    assert (split.blade == blade).all()


def test_a_picture_of_another_size_is_refused():
    with pytest.raises(ValueError, match="must be"):
        split_petiole(np.zeros((10, 10, 3), np.uint8), np.ones((9, 10), bool))


def test_a_sinus_that_lobes_close_is_opened_and_a_torn_hole_stays():
    mask = np.zeros((300, 300), np.uint8)
    cv2.circle(mask, (150, 150), 120, 1, cv2.FILLED)
    cv2.ellipse(mask, (150, 80), (10, 30), 0, 0, 360, 0, cv2.FILLED)  # points up, closed by 20 pixels
    cv2.circle(mask, (150, 190), 20, 0, cv2.FILLED)
    opened = open_sinuses(mask > 0)
    assert opened.opened == 1
    assert opened.holes == 1
    assert cv2.connectedComponents(opened.mask.astype(np.uint8), connectivity=4)[0] == 2
    assert cv2.connectedComponents((~opened.mask).astype(np.uint8), connectivity=4)[0] == 3
    assert ((mask > 0) & ~opened.mask).sum() < 200


def test_a_mask_without_holes_stays_as_it_is():
    mask = np.zeros((50, 50), bool)
    mask[10:40, 5:45] = True
    assert (open_sinuses(mask).mask == mask).all()
    assert open_sinuses(np.ones((20, 20), bool)).mask.all()
