"""A leaf drawn from above: its silhouette, and its texture where the surface has it."""

import numpy as np
import pytest
from usdfoliage.leaf.shape.measures import leaf_area, leaf_width
from usdfoliage.leaf.shape.picture import draw_leaf_picture
from usdfoliage.leaf.shape.variation import leaf_of_width

HEIGHT_PX = 200


def checked(rows: int = 64, columns: int = 32) -> np.ndarray:
    """A texture whose red is u from 0 to 1 and whose green is v."""
    s, t = np.meshgrid((np.arange(columns) + 0.5) / columns, 1 - (np.arange(rows) + 0.5) / rows)
    return np.dstack([s, t, np.zeros_like(s), np.ones_like(s)]).astype(np.float32)


@pytest.mark.parametrize("width", [0.15, 0.5, 0.9])
def test_the_silhouette_has_the_width_and_the_area_of_the_leaf(width):
    leaf = leaf_of_width(width)
    drawn = draw_leaf_picture(leaf, checked(), HEIGHT_PX)
    assert len(drawn) == HEIGHT_PX
    assert drawn.shape[1] == pytest.approx(leaf_width(leaf[None])[0] * HEIGHT_PX, abs=2)
    assert drawn[..., 3].sum() / HEIGHT_PX**2 == pytest.approx(leaf_area(leaf[None])[0], rel=0.03)


def test_the_base_is_below_and_the_left_half_on_the_left():
    drawn = draw_leaf_picture(leaf_of_width(0.6), checked(), HEIGHT_PX)
    inside = drawn[..., 3] > 0.9
    y, x = np.nonzero(inside)
    red, green = drawn[inside][:, 0], drawn[inside][:, 1]
    assert np.corrcoef(x, red)[0, 1] > 0.8
    assert np.corrcoef(y, green)[0, 1] < -0.95
    middle = (np.abs(x - np.median(x)) < 2) & (np.abs(y - HEIGHT_PX / 2) < HEIGHT_PX / 4)
    assert red[middle] == pytest.approx(0.5, abs=0.1)


def test_opacity_of_the_texture_counts():
    texture = checked()
    texture[:32, :, 3] = 0  # the half towards the apex
    drawn = draw_leaf_picture(leaf_of_width(0.6), texture, HEIGHT_PX)
    rows = np.flatnonzero((drawn[..., 3] > 0.5).any(axis=1))
    assert rows.max() >= HEIGHT_PX - 3
    assert 0.3 * HEIGHT_PX < rows.min() < 0.7 * HEIGHT_PX


def test_a_leaf_without_area_and_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match="no area"):
        draw_leaf_picture(np.zeros((7, 3)), checked())
    with pytest.raises(ValueError, match="leaf is"):
        draw_leaf_picture(leaf_of_width(0.5)[None], checked())
    with pytest.raises(ValueError, match="leaf is"):
        draw_leaf_picture(leaf_of_width(0.5), checked()[..., :3])
