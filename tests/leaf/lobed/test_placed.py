"""A lobed leaf in metres, and its texture."""

import numpy as np
import pytest
from usdfoliage.leaf.lobed.model import model_lobed_leaf
from usdfoliage.leaf.lobed.placed import PictureCrop, place_leaf
from usdfoliage.leaf.lobed.spline import evaluate_closed
from usdfoliage.leaf.lobed.texture import build_texture

from tests.support.leaves.lobed import lobed_mask


@pytest.mark.parametrize("crop", [PictureCrop(), PictureCrop(left_px=30, top_px=50, pixel=2.0)])
def test_the_matrix_lays_the_picture_over_the_leaf(crop):
    flat = model_lobed_leaf(lobed_mask())
    leaf = place_leaf(flat, (600, 700), 0.001, crop)
    pixels = leaf.st * [600, -700] + [0, 700]
    placed = np.column_stack([pixels, np.zeros(len(pixels)), np.ones(len(pixels))]) @ leaf.asset_from_picture.T
    assert placed[:, :3] == pytest.approx(leaf.points_m(), abs=1e-7)
    assert leaf.points_m()[0] == pytest.approx(0, abs=1e-12)
    own = (flat.ties.places() * [1, -1]) * crop.pixel + [crop.left_px, crop.top_px]
    assert pixels.min(axis=0) == pytest.approx(own.min(axis=0))
    assert pixels.max(axis=0) == pytest.approx(own.max(axis=0))


def test_the_silhouette_begins_at_the_base_and_surrounds_the_leaf():
    leaf = place_leaf(model_lobed_leaf(lobed_mask()), (240, 240), 0.001)
    assert np.linalg.norm(leaf.silhouette_m, axis=1).argmin() == 0
    curve = evaluate_closed(leaf.silhouette_m, 8)
    assert np.ptp(curve, axis=0) == pytest.approx(np.ptp(leaf.shape.places, axis=0), rel=0.02)
    x, y = curve.T
    assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0


@pytest.mark.parametrize(("size", "metres_per_px"), [((240, 240), 0.0), ((240, 240), np.nan), ((0, 240), 1.0)])
def test_sizes_that_cannot_be_are_refused(size, metres_per_px):
    with pytest.raises(ValueError, match="cannot be"):
        place_leaf(model_lobed_leaf(lobed_mask((90,))), size, metres_per_px)


def test_colors_of_the_texture_go_on_beside_the_leaf():
    mask = lobed_mask()
    linear = np.where(mask[..., None], [0.1, 0.4, 0.05], [0.9, 0.9, 0.9]).astype(np.float32)
    texture = build_texture(linear, mask)
    assert np.array_equal(texture[..., 3] > 0.5, mask)
    assert np.abs(texture[..., :3] - [0.1, 0.4, 0.05]).max() < 1e-4


def test_a_large_picture_is_shrunk_without_its_background():
    mask = np.repeat(np.repeat(lobed_mask(), 4, axis=0), 4, axis=1)
    linear = np.where(mask[..., None], [0.1, 0.4, 0.05], [0.9, 0.9, 0.9]).astype(np.float32)
    texture = build_texture(linear, mask, longest_px=300)
    assert texture.shape == (300, 300, 4)
    assert np.abs(texture[..., :3] - [0.1, 0.4, 0.05]).max() < 1e-4
    assert texture[..., 3].mean() == pytest.approx(mask.mean(), rel=0.01)


def test_an_empty_mask_has_no_texture():
    with pytest.raises(ValueError, match="empty"):
        build_texture(np.ones((20, 20, 3), np.float32), np.zeros((20, 20), bool))
