"""The picture of a leaf for a crown: cut to the leaf, clean, of bounded size, and without a colour of its own."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.crown.leaf_picture import (
    LONGEST_PX,
    MARGIN_PX,
    PLAIN_COVER,
    PLAIN_WIDTH,
    clean_leaf_picture,
    plain_leaf,
)
from usdfoliage.errors import FitError

from tests.support.leaves.drawn import drawn_leaf


def mean_of(picture) -> np.ndarray:
    return picture.rgba[picture.rgba[..., 3] >= 0.5][:, :3].mean(axis=0)


@given(st.integers(20, 300), st.integers(80, 400), st.integers(1, 30))
def test_an_ellipse_keeps_its_form_and_loses_its_mean(width_px, height_px, around_px):
    picture = clean_leaf_picture(drawn_leaf(width_px, height_px, around_px))
    np.testing.assert_allclose(mean_of(picture), 1, atol=1e-3)
    assert max(picture.rgba.shape) <= LONGEST_PX
    inner = np.array(picture.rgba.shape[:2]) - 2 * MARGIN_PX
    assert picture.cover * picture.rgba[..., 0].size / inner.prod() == pytest.approx(np.pi / 4, abs=0.05)
    assert inner[1] / inner[0] == pytest.approx(width_px / height_px, abs=2.5 / inner.min())
    rows = np.flatnonzero(picture.rgba[..., 3] >= 0.5) // picture.rgba.shape[1]
    assert rows.min() <= MARGIN_PX + 1
    assert rows.max() >= picture.rgba.shape[0] - MARGIN_PX - 2


def test_hues_differ_on_the_leaf_as_they_did_and_go_on_beside_it():
    picture = clean_leaf_picture(drawn_leaf())
    rows, columns = picture.rgba.shape[:2]
    apex, base = picture.rgba[rows // 8, columns // 2], picture.rgba[-rows // 8, columns // 2]
    # In the drawing red rises and green falls from apex to base.
    source = drawn_leaf(around_px=0)
    given_apex, given_base = source[100 // 8, 30], source[-100 // 8, 30]
    np.testing.assert_allclose(base[:3] / apex[:3], given_base[:3] / given_apex[:3], rtol=0.12)
    for row in (0, 1):
        np.testing.assert_allclose(picture.rgba[row, columns // 2, :3], picture.rgba[4, columns // 2, :3], rtol=0.1)
    assert picture.rgba[..., :3].max() < 3.1  # nothing of the bright background


def test_dust_and_gaps_are_cleaned_and_leaflets_stay():
    clean = clean_leaf_picture(drawn_leaf())
    dirty = drawn_leaf()
    dirty[3:6, 3:6, 3] = 1  # dust
    dirty[70:73, 50:53, 3] = 0  # a gap of the mask
    dirty[70:73, 50:53, :3] = 5.0
    again = clean_leaf_picture(dirty)
    assert again.rgba.shape == clean.rgba.shape
    np.testing.assert_array_equal(again.rgba[..., 3], clean.rgba[..., 3])
    np.testing.assert_allclose(again.rgba[..., :3], clean.rgba[..., :3], rtol=0.1)
    pair = np.concatenate([drawn_leaf(), drawn_leaf()], axis=1)
    assert clean_leaf_picture(pair).width == pytest.approx((60 + 100) / 100, abs=0.05)


def test_a_large_picture_and_a_small_one_of_a_leaf_become_one():
    large, small = (clean_leaf_picture(drawn_leaf(60 * n, 100 * n, 20 * n), 100) for n in (20, 1))
    assert large.rgba.shape == small.rgba.shape
    assert large.cover == pytest.approx(small.cover, abs=0.02)
    both = (large.rgba[..., 3] > 0.9) & (small.rgba[..., 3] > 0.9)
    np.testing.assert_allclose(large.rgba[both][:, :3], small.rgba[both][:, :3], atol=0.1)


def test_a_channel_without_light_stays_one():
    rgba = drawn_leaf()
    rgba[..., 2] = 0
    picture = clean_leaf_picture(rgba)
    np.testing.assert_array_equal(picture.rgba[..., 2], 1)
    np.testing.assert_allclose(mean_of(picture), 1, atol=1e-3)


def test_the_plain_leaf_has_a_mean_of_one_and_the_form_that_settings_assume():
    plain = plain_leaf()
    np.testing.assert_allclose(mean_of(plain), 1, atol=1e-5)
    assert (plain.width, plain.cover) == (PLAIN_WIDTH, PLAIN_COVER)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rgba: rgba * [1, 1, 1, 0], "transparent everywhere"),
        (lambda rgba: rgba * [1, 1, 1, 0] + [0, 0, 0, 1], "opaque everywhere"),
        (lambda rgba: rgba * [1, 1, 1, np.nan], "transparent everywhere"),
        (lambda rgba: rgba * [0, 0, 0, 1], "black"),
        (lambda rgba: rgba * [np.nan, np.nan, np.nan, 1], "black"),
        (lambda rgba: drawn_leaf(5, 5), "5 x 5 pixels"),
        (lambda rgba: drawn_leaf(1000, 30), "form of no leaf"),
    ],
)
def test_what_is_no_leaf_is_refused(change, words):
    with pytest.raises(FitError, match=words):
        clean_leaf_picture(change(drawn_leaf()))


def test_a_picture_without_alpha_is_a_wrong_argument():
    with pytest.raises(ValueError, match=r"\(H, W, 4\)"):
        clean_leaf_picture(drawn_leaf()[..., :3])
