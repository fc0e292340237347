"""Lines in photographs: their middles, their widths, and what is none."""

import cv2
import numpy as np
import pytest
from usdfoliage.branch.photographs.lines import LineSettings, find_lines

FINER = 8


def draw_bar(width_px: float, turn_rad: float, color=(60, 90, 50), ground=(200, 200, 205), size=96):
    """A bar through the middle of a picture, drawn eight times as finely."""
    large = np.full((size * FINER, size * FINER, 3), ground, np.uint8)
    reach = 0.4 * size * FINER * np.array([np.cos(turn_rad), np.sin(turn_rad)])
    middle = size * FINER / 2
    ends = [np.rint(middle + sign * reach - 0.5).astype(int).tolist() for sign in (-1, 1)]
    cv2.line(large, ends[0], ends[1], color, round(width_px * FINER))
    return cv2.resize(large, (size, size), interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize("width_px", [2.0, 3.5, 6.0, 10.0])
@pytest.mark.parametrize("turn_rad", [0.0, 0.3, 1.1, 2.4])
def test_middle_and_width_of_a_bar(width_px, turn_rad):
    found = find_lines(draw_bar(width_px, turn_rad))
    aside = (found.places_px - 48) @ (-np.sin(turn_rad), np.cos(turn_rad))
    on_bar = np.abs((found.places_px - 48) @ (np.cos(turn_rad), np.sin(turn_rad))) < 30  # not the rounded ends
    assert on_bar.sum() > 40
    assert np.abs(aside[on_bar]).max() < 0.5
    assert np.abs(aside[on_bar]).mean() < 0.15
    assert np.median(found.width_px[on_bar]) == pytest.approx(width_px, abs=0.5)
    along = np.abs(np.cos(found.normal_rad[on_bar] - turn_rad))
    assert np.median(along) < 0.05


def test_a_bar_that_differs_in_colour_alone_is_a_line():
    found = find_lines(draw_bar(4.0, 0.5, color=(150, 110, 110), ground=(107, 128, 110)))
    assert len(found) > 30


def test_the_border_of_a_broad_leaf_is_no_line():
    leaf = np.full((96, 96, 3), (205, 208, 214), np.uint8)
    cv2.circle(leaf, (48, 48), 34, (95, 150, 70), cv2.FILLED, cv2.LINE_AA)
    assert len(find_lines(leaf)) == 0


def test_nothing_is_found_in_an_even_picture_or_outside_the_mask():
    even = np.full((40, 60, 3), 128, np.uint8)
    assert len(find_lines(even)) == 0
    bar = draw_bar(4.0, 0.0)
    assert len(find_lines(bar, np.zeros(bar.shape[:2], bool))) == 0


def test_middles_of_a_line_are_in_order_from_end_to_end():
    found = find_lines(draw_bar(4.0, 0.8))
    longest = found.take(found.line == np.bincount(found.line).argmax())
    along = longest.places_px @ (np.cos(0.8), np.sin(0.8))
    assert len(longest) > 40
    steps = np.diff(along)
    assert (steps > 0).all() or (steps < 0).all()


def test_settings_and_shapes_are_checked():
    with pytest.raises(ValueError, match="ridge"):
        LineSettings(ridge=0)
    with pytest.raises(ValueError, match="scales_px"):
        LineSettings(scales_px=())
    with pytest.raises(ValueError, match="photograph"):
        find_lines(np.zeros((4, 5), np.uint8))
