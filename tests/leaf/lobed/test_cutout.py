"""Leaves cut out of drawn scans: how many, what was found about them, and how near their masks are to the truth."""

import cv2
import numpy as np
import pytest
from usdfoliage.errors import FitError
from usdfoliage.leaf.lobed.cutout import CutOut, Finding, cut_out_leaves, cut_out_mask

WHITE, GREEN, BLUE = (240, 238, 232), (70, 110, 50), (40, 60, 150)


def paper(color=WHITE, size=(400, 500), *, ruled: bool = False) -> np.ndarray:
    """A sheet with some noise, and with red lines if it is ruled."""
    sheet = np.full((*size, 3), color, np.float64)
    if ruled:
        sheet[::10], sheet[:, ::10] = (245, 200, 190), (245, 200, 190)
        sheet[::50], sheet[:, ::50] = (235, 140, 120), (235, 140, 120)
    rng = np.random.default_rng(0)
    return np.clip(sheet + rng.normal(0, 3, sheet.shape), 0, 255).astype(np.uint8)


def lay(sheet: np.ndarray, center, axes, color=GREEN) -> np.ndarray:
    """An elliptical leaf on a sheet, and its mask."""
    mask = np.zeros(sheet.shape[:2], np.uint8)
    cv2.ellipse(mask, center, axes, 20, 0, 360, 1, cv2.FILLED)
    sheet[mask > 0] = color
    return mask > 0


def whole(found: CutOut, number: int) -> np.ndarray:
    """A leaf's mask in the size of the reduced picture."""
    leaf = found.leaves[number]
    mask = np.zeros(found.reduced.shape[:2], bool)
    row, column = leaf.corner
    mask[row : row + leaf.mask.shape[0], column : column + leaf.mask.shape[1]] = leaf.mask
    return mask


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return (one & other).sum() / (one | other).sum()


@pytest.mark.parametrize(("color", "ruled"), [(WHITE, False), (WHITE, True), (BLUE, False), ((25, 25, 28), False)])
def test_a_leaf_is_found_on_plain_ruled_coloured_and_dark_ground(color, ruled):
    sheet = paper(color, ruled=ruled)
    mask = lay(sheet, (250, 200), (120, 60))
    found = cut_out_leaves(sheet)
    assert len(found.leaves) == 1
    assert not found.leaves[0].findings - {Finding.HOLES_FILLED}
    assert overlap(whole(found, 0), mask) > 0.98


def test_several_leaves_come_the_largest_first_without_dust_and_dots():
    sheet = paper()
    large, small = lay(sheet, (150, 200), (110, 50)), lay(sheet, (380, 200), (80, 40))
    lay(sheet, (300, 30), (4, 4))
    lay(sheet, (30, 30), (16, 16), (30, 30, 30))  # a black dot for scale
    found = cut_out_leaves(sheet)
    assert len(found.leaves) == 2
    assert found.dust == 1
    assert found.others == 1
    assert overlap(whole(found, 0), large) > 0.97
    assert overlap(whole(found, 1), small) > 0.97


def test_a_leaf_over_the_border_is_named():
    sheet = paper()
    lay(sheet, (250, 390), (90, 50))
    assert Finding.OVER_BORDER in cut_out_leaves(sheet).leaves[0].findings


def test_leaves_that_touch_are_named():
    mask = np.zeros((300, 500), np.uint8)
    cv2.circle(mask, (150, 150), 90, 1, cv2.FILLED)
    assert Finding.TOUCHING not in cut_out_mask(mask > 0).leaves[0].findings
    cv2.circle(mask, (325, 150), 90, 1, cv2.FILLED)
    found = cut_out_mask(mask > 0)
    assert len(found.leaves) == 1
    assert Finding.TOUCHING in found.leaves[0].findings


def test_small_holes_are_filled_and_torn_ones_stay():
    sheet = paper()
    mask = lay(sheet, (250, 200), (150, 90))
    cv2.circle(sheet, (250, 200), 25, WHITE, cv2.FILLED)
    cv2.circle(sheet, (180, 180), 2, WHITE, cv2.FILLED)
    found = cut_out_leaves(sheet)
    leaf = found.leaves[0]
    assert leaf.holes == 1
    assert {Finding.HOLES_FILLED, Finding.HOLES_KEPT} <= leaf.findings
    assert (mask & ~whole(found, 0)).sum() == pytest.approx(np.pi * 25**2, rel=0.1)


def test_a_large_picture_is_reduced():
    sheet = np.full((6000, 3000, 3), WHITE, np.uint8)
    cv2.ellipse(sheet, (1500, 3000), (800, 1600), 0, 0, 360, GREEN, cv2.FILLED)
    found = cut_out_leaves(sheet)
    assert max(found.reduced.shape) == 2400
    assert found.scale == pytest.approx((2.5, 2.5))
    assert found.leaves[0].mask.sum() * 2.5**2 == pytest.approx(np.pi * 800 * 1600, rel=0.01)


def test_the_same_picture_gives_the_same_leaf():
    sheet = paper(ruled=True)
    lay(sheet, (250, 200), (120, 60))
    assert (cut_out_leaves(sheet).leaves[0].mask == cut_out_leaves(sheet).leaves[0].mask).all()


@pytest.mark.parametrize("sheet", [paper(), np.zeros((200, 200, 3), np.uint8)])
def test_a_sheet_without_a_leaf_is_refused(sheet):
    with pytest.raises(FitError, match="no leaf was found"):
        cut_out_leaves(sheet)


def test_tiny_pictures_and_empty_masks_are_refused():
    with pytest.raises(FitError, match="1 x 1 pixels"):
        cut_out_leaves(np.zeros((1, 1, 3), np.uint8))
    with pytest.raises(FitError, match="the mask is empty"):
        cut_out_mask(np.zeros((50, 50), bool))
    with pytest.raises(ValueError, match="must be"):
        cut_out_leaves(np.zeros((50, 50), np.uint8))
    with pytest.raises(ValueError, match="must be"):
        cut_out_mask(np.zeros((50, 50)))
