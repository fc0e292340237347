"""A leaf of the form of a picture of one: drawn again it is the picture."""

import cv2
import numpy as np
import pytest
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.from_picture import leaf_from_picture
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.picture import draw_leaf_picture
from usdfoliage.leaf.shape.variation import leaf_of_width

HEIGHT_PX = 240


def painted(opaque: np.ndarray) -> np.ndarray:
    """A picture of this form whose red grows to the right and whose green grows upwards."""
    rows, columns = opaque.shape
    red, green = np.meshgrid(np.linspace(0, 1, columns), np.linspace(1, 0, rows))
    return np.dstack([red, green, np.full_like(red, 0.3), opaque]).astype(np.float32)


def of_width(width: float) -> np.ndarray:
    drawn = draw_leaf_picture(leaf_of_width(width), np.ones((2, 2, 4), np.float32), HEIGHT_PX)
    return painted(np.pad(drawn[..., 3], 2))


def lobed() -> np.ndarray:
    """A leaf of five lobes around a point above its base, with a stalk."""
    x, y = np.meshgrid(np.linspace(-0.55, 0.55, HEIGHT_PX), np.linspace(1, 0, HEIGHT_PX))
    angle, away = np.arctan2(x, y - 0.35), np.hypot(x, y - 0.35)
    blade = away < 0.62 * (0.66 + 0.3 * np.cos(5 * angle)) * (1 - 0.25 * np.abs(angle) / np.pi)
    return painted((blade | ((np.abs(x) < 0.012) & (y < 0.4))).astype(float))


def overlap(leaf, rgba: np.ndarray) -> float:
    """The intersection over union of the picture and of the leaf with its texture, drawn again, by their lengths."""
    drawn = draw_leaf_picture(leaf.parameters, leaf.texture, HEIGHT_PX)[..., 3] > 0.5
    given = rgba[..., 3] > 0.5
    cut = [each[np.ix_(each.any(axis=1), each.any(axis=0))] for each in (drawn, given)]
    first, second = (cv2.resize(each.astype(np.uint8), (200, 200), interpolation=cv2.INTER_AREA) > 0 for each in cut)
    return float((first & second).sum() / (first | second).sum())


@pytest.mark.parametrize("width", [0.1, 0.3, 0.6, 1.0])
def test_a_plain_leaf_has_its_width_and_its_texture(width):
    rgba = of_width(width)
    leaf = leaf_from_picture(rgba)
    assert leaf_width(leaf.parameters[None])[0] == pytest.approx(width, rel=0.15)
    assert overlap(leaf, rgba) > 0.9
    assert leaf.cover > 0.8
    assert not find_folds(leaf.parameters[None])[0]
    rows, columns = leaf.texture.shape[:2]
    inside = leaf.texture[..., 3] > 0.5
    row, column = np.nonzero(inside)
    assert np.corrcoef(column / columns, leaf.texture[inside][:, 0])[0, 1] > 0.7
    assert np.corrcoef(row / rows, leaf.texture[inside][:, 1])[0, 1] < -0.95


def test_a_lobed_leaf_is_cut_out_by_its_texture():
    rgba = lobed()
    leaf = leaf_from_picture(rgba)
    assert overlap(leaf, rgba) > 0.85
    assert not find_folds(leaf.parameters[None])[0]
    assert (leaf.texture[..., 3] < 0.5).mean() > 0.2  # between its lobes
    drawn = draw_leaf_picture(leaf.parameters, np.ones((2, 2, 4), np.float32), HEIGHT_PX)[..., 3]
    assert leaf.cover == pytest.approx((rgba[..., 3] > 0.5).sum() / (drawn > 0.5).sum(), abs=0.1)


def test_a_leaf_that_leans_in_its_picture_stands_upright():
    rgba = of_width(0.3)
    size = rgba.shape[0]
    turn = cv2.getRotationMatrix2D((rgba.shape[1] / 2, size / 2), 12, 1)
    turn[:, 2] += (size - rgba.shape[1]) / 2, 0
    leaning = cv2.warpAffine(rgba, turn, (size, size))
    leaf = leaf_from_picture(leaning)
    assert leaf_width(leaf.parameters[None])[0] == pytest.approx(0.3, rel=0.2)
    drawn = draw_leaf_picture(leaf.parameters, leaf.texture, HEIGHT_PX)[..., 3]
    assert np.abs(drawn - drawn[:, ::-1]).mean() < 0.1


def test_what_is_no_picture_of_a_leaf_is_refused():
    with pytest.raises(ValueError, match="must be"):
        leaf_from_picture(np.zeros((4, 4, 3)))
    with pytest.raises(ValueError, match="opaque"):
        leaf_from_picture(np.zeros((40, 40, 4)))
