"""The average leaf is what photographs show of leaves, at its place in (u, v)."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from usdfoliage.geometry.color import encode_srgb, luminance
from usdfoliage.leaf.photographs.average_texture import AverageTextureSettings, average_leaf_texture
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

from tests.support.leaves.pictures import WALL, front_camera, photograph, place_leaves
from tests.support.leaves.shapes import flat_leaf

GREEN, RIB = np.array([0.1, 0.3, 0.05]), np.array([0.25, 0.5, 0.15])
SIZE = AverageTextureSettings(width_px=32, height_px=64)
CAMERA = front_camera(width_px=480, height_px=360, focal_px=800.0)


def paint(leaves, camera, exposure=1.0, color=None):
    """A photograph of leaves with a light rib along the axis and a red apex, a fifth of the length."""
    view = photograph(leaves, camera, np.tile(GREEN, (len(leaves), 1)), exposure=exposure)
    uv = grid_places(np.linspace(-1, 1, 141), np.linspace(0, 1, 251))
    color_at = np.where(np.abs(uv[:, :1]) < 0.12, RIB, GREEN)
    color_at[uv[:, 1] > 0.8] = (0.4, 0.05, 0.05)
    points = evaluate_points(leaves.parameters, uv, placements=leaves.asset_from_leaf())
    for leaf in range(len(leaves)):
        places, _ = camera.project(points[leaf])
        columns, rows = places.astype(int).T
        kept = (columns >= 0) & (columns < camera.width_px) & (rows >= 0) & (rows < camera.height_px)
        linear = color_at[kept] * exposure * (1 if color is None else color[leaf])
        view.srgb[rows[kept], columns[kept]] = np.rint(encode_srgb(linear) * 255)
    return view


@pytest.fixture
def leaves():
    base = [(x, y, 0.0) for x in (-0.16, 0.0, 0.16) for y in (-0.18, 0.0)]
    return place_leaves(flat_leaf(), base, length_m=0.15)


def test_rib_and_apex_are_where_they_were_painted(leaves):
    views = [paint(leaves, CAMERA, 1.04), paint(leaves, replace(CAMERA), 0.97)]
    texture = average_leaf_texture(leaves, views, SIZE)

    color, opacity = texture.rgba[..., :3], texture.rgba[..., 3]
    assert texture.rgba.shape == (64, 32, 4)
    assert texture.leaves == 6
    assert (opacity[1:-1] > 0.9).all()
    red = color[..., 0] > color[..., 1]
    assert red[:10, 8:24].all()
    assert not red[18:].any()
    light = luminance(color[20:56])
    rib, blade = light[:, 15:17].mean(), light[:, 4:12].mean()
    assert rib / blade == pytest.approx(luminance(RIB) / luminance(GREEN), rel=0.25)
    assert np.median(color[20:56, 4:12], axis=(0, 1)) == pytest.approx(GREEN, rel=0.15)


def test_leaves_of_other_colors_and_exposures_average(leaves):
    bright = np.array([0.7, 0.8, 0.9, 1.1, 1.2, 1.3])
    texture = average_leaf_texture(leaves, [paint(leaves, CAMERA, color=bright)], SIZE)

    assert np.median(texture.rgba[20:56, 4:12, :3], axis=(0, 1)) == pytest.approx(GREEN, rel=0.15)


def test_opacity_ends_where_real_leaves_end(leaves):
    views = [paint(leaves, CAMERA)]
    wider = replace(leaves, parameters=np.repeat(flat_leaf(width=0.6), 6, axis=0))
    opacity = average_leaf_texture(wider, views, SIZE).rgba[20:44, :, 3]

    share = 0.4 / 0.6 * 16
    assert (opacity[:, 16 - int(share) + 2 : 16 + int(share) - 2] > 0.9).all()
    assert (opacity[:, :3] < 0.1).all()
    assert (opacity[:, -3:] < 0.1).all()


def test_what_is_hidden_comes_from_other_leaves_or_from_around(leaves):
    view = paint(leaves, CAMERA)
    left = np.zeros(view.depth_m.shape, bool)
    left[:, :200] = True  # a board before the leaves of the left column
    srgb, depth_m = view.srgb.copy(), view.depth_m.copy()
    srgb[left], depth_m[left] = (255, 0, 255), 0.3
    whole = average_leaf_texture(leaves, [view], SIZE).rgba
    hidden = average_leaf_texture(leaves, [replace(view, srgb=srgb, depth_m=depth_m)], SIZE)

    assert 0 < hidden.leaves < 6
    assert hidden.rgba[20:56, 4:28] == pytest.approx(whole[20:56, 4:28], abs=0.05)


def test_the_wall_does_not_bleed_in(leaves):
    color = average_leaf_texture(leaves, [paint(leaves, CAMERA)], SIZE).rgba[20:, :, :3]

    assert (color[..., 2] / color[..., 1]).max() < 0.6 * WALL[2] / WALL[1]


def test_shadows_on_some_leaves_are_left_out(leaves):
    view = paint(leaves, CAMERA)
    whole = average_leaf_texture(leaves, [view], SIZE).rgba
    places, _ = CAMERA.project(leaves.base_m + leaves.asset_from_leaf()[:, :, 1] / 2)
    for leaf in (0, 3):  # a bar of shadow across a third of them
        x, y = places[leaf].astype(int)
        bar = view.srgb[y - 6 : y + 6, x - 40 : x + 40].astype(int)
        view.srgb[y - 6 : y + 6, x - 40 : x + 40] = bar // 2
    shaded = average_leaf_texture(leaves, [view], SIZE).rgba

    octaves = np.abs(np.log2(luminance(shaded[4:60, 4:28, :3]) / luminance(whole[4:60, 4:28, :3])))
    assert octaves.max() < 0.02


def test_the_background_does_not_color_the_silhouette(leaves):
    """Lenses mix what lies side by side: here white into leaves, up to two pixels far."""
    view = paint(leaves, CAMERA)
    view.srgb[view.depth_m > 1.4] = 255
    blurred = replace(view, srgb=cv2.GaussianBlur(view.srgb, (0, 0), 1.6))
    rim = average_leaf_texture(leaves, [blurred], replace(SIZE, vein_pictures=0)).rgba[22:44, [0, 1, -2, -1], :3]

    assert luminance(rim).max() < 1.01 * luminance(GREEN)


def test_threads_change_nothing(leaves):
    views = [paint(leaves, CAMERA, 1.04), paint(leaves, replace(CAMERA), 0.97)]
    one, many = (average_leaf_texture(leaves, views, SIZE, threads=threads).rgba for threads in (1, 5))

    assert np.array_equal(one, many)


def test_a_leaf_that_reaches_out_of_the_picture_is_unwrapped(leaves):
    aside = front_camera(0.14, width_px=480, height_px=360, focal_px=800.0)
    texture = average_leaf_texture(leaves, [paint(leaves, aside)], SIZE)

    assert texture.leaves > 0
    assert np.isfinite(texture.rgba).all()
    assert np.median(texture.rgba[24:48, 10:14, :3], axis=(0, 1)) == pytest.approx(GREEN, rel=0.2)


def test_without_veins_the_picture_is_smooth(leaves):
    plain = average_leaf_texture(leaves, [paint(leaves, CAMERA)], replace(SIZE, vein_pictures=0)).rgba
    veined = average_leaf_texture(leaves, [paint(leaves, CAMERA)], SIZE).rgba

    def contrast(rgba):
        return np.ptp(luminance(rgba[24:54, 4:28, :3]), axis=1).mean()

    assert contrast(plain) < 0.7 * contrast(veined)


@pytest.mark.parametrize("depth", [True, False])
def test_the_same_again_is_the_same(leaves, depth):
    view = paint(leaves, CAMERA)
    if not depth:
        view = replace(view, depth_m=np.zeros_like(view.depth_m))
    first, second = (average_leaf_texture(leaves, [view], SIZE).rgba for _ in range(2))

    assert np.array_equal(first, second)
    assert np.isfinite(first).all()


def test_nothing_seen_is_grey(leaves):
    aside = photograph(leaves, front_camera(9.0), np.tile(GREEN, (6, 1)))
    for chosen, views in ((leaves, []), (leaves, [aside]), (leaves.take([False] * 6), [paint(leaves, CAMERA)])):
        texture = average_leaf_texture(chosen, views, SIZE)
        assert texture.leaves == 0
        assert np.unique(texture.rgba[..., :3]).tolist() == pytest.approx([0.18])
        assert (texture.rgba[..., 3] == 1).all()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"width_px": 8}, "16 pixels wide"),
        ({"height_px": 8193}, "at most 8192 pixels wide"),
        ({"max_pictures": 0}, "max_pictures must be 1"),
        ({"edge": (0.5, 0.5)}, "edge must rise"),
    ],
)
def test_wrong_settings_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        AverageTextureSettings(**wrong)
