"""Leaves get the colours that photographs show of them, whatever the exposures."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from usdfoliage.leaf.photographs import colors
from usdfoliage.leaf.photographs.colors import PhotoColorSettings, sample_leaf_colors, weighted_median
from usdfoliage.leaf.shape.variation import default_leaf

from tests.support.leaves.pictures import front_camera, photograph, place_leaves

COLORS = np.array([[0.10, 0.30, 0.05], [0.40, 0.35, 0.10], [0.05, 0.12, 0.03], [0.2, 0.2, 0.2]])
BASE = [(-0.15, -0.1, 0.0), (0.0, -0.1, 0.05), (0.14, -0.1, 0.0)]
ONE_STEP = 0.012  # of 8 bits, in these colours: relative
EXPOSURES = (0.96, 1.0, 1.04)


@pytest.fixture
def leaves():
    return place_leaves(default_leaf(), BASE, length_m=0.15)


def take_photographs(leaves, exposures=EXPOSURES, **options):
    cameras = [front_camera(x) for x in np.linspace(-0.1, 0.1, len(exposures))]
    return [
        photograph(leaves, camera, COLORS, exposure=exposure, **options)
        for camera, exposure in zip(cameras, exposures, strict=True)
    ]


@pytest.mark.parametrize("depth", [True, False])
def test_colors_and_exposures_are_found(leaves, depth):
    found = sample_leaf_colors(leaves, take_photographs(leaves, depth=depth))

    assert found.seen.all()
    assert found.gain == pytest.approx(EXPOSURES, rel=ONE_STEP)
    assert found.color == pytest.approx(COLORS[:3], rel=3 * ONE_STEP)


def test_exposures_are_left_alone_where_the_setting_is_off(leaves):
    found = sample_leaf_colors(leaves, take_photographs(leaves), PhotoColorSettings(equalize_exposure=False))

    assert found.gain.tolist() == [1, 1, 1]


def test_a_photograph_without_leaves_keeps_its_exposure(leaves):
    views = take_photographs(leaves)
    aside = photograph(leaves, front_camera(5.0), COLORS, name="aside.png")
    found = sample_leaf_colors(leaves, [*views, aside])

    assert found.gain[3] == 1
    assert found.color == pytest.approx(sample_leaf_colors(leaves, views).color)


def test_what_stands_before_a_leaf_gives_it_no_color(leaves):
    views = take_photographs(leaves)
    rows = slice(40, 90)
    for view in views:
        view.srgb[rows] = (255, 0, 0)
        view.depth_m[rows] = 0.4

    assert sample_leaf_colors(leaves, views).color == pytest.approx(COLORS[:3], rel=3 * ONE_STEP)


def test_spots_and_highlights_do_not_count(leaves):
    views = take_photographs(leaves)
    for view in views:
        view.srgb[::3, ::3] = 255

    assert sample_leaf_colors(leaves, views).color == pytest.approx(COLORS[:3], rel=3 * ONE_STEP)


def test_leaves_that_nobody_saw_get_the_median_color(leaves):
    more = place_leaves(default_leaf(), [*BASE, (9.0, 0.0, 0.0)], length_m=0.15)
    found = sample_leaf_colors(more, take_photographs(more))

    assert found.seen.tolist() == [True, True, True, False]
    assert found.color[3] == pytest.approx(np.median(found.color[:3], axis=0))


def test_without_photographs_leaves_are_grey(leaves):
    found = sample_leaf_colors(leaves, [])

    assert not found.seen.any()
    assert (found.color == 0.18).all()
    assert sample_leaf_colors(leaves.take([False] * 3), take_photographs(leaves)).color.shape == (0, 3)


def test_the_scale_of_the_scene_does_not_matter(leaves):
    def scaled(view):
        pose = view.camera.cam_from_world.copy()
        pose[:, 3] *= 10
        return replace(view, depth_m=view.depth_m * 10, camera=replace(view.camera, cam_from_world=pose))

    views = take_photographs(leaves)
    larger = replace(leaves, base_m=leaves.base_m * 10, length_m=leaves.length_m * 10)

    found = sample_leaf_colors(larger, [scaled(view) for view in views])
    assert found.color == pytest.approx(sample_leaf_colors(leaves, views).color, rel=1e-3)


@given(values=hnp.arrays(np.float64, (7, 2), elements=st.floats(-9, 9)), twice=st.integers(0, 6))
def test_a_weight_of_two_counts_as_two(values, twice):
    weights = np.ones(7)
    weights[twice] = 2

    expected = np.sort(np.concatenate([values, values[[twice]]]), axis=0)[3]
    assert weighted_median(values, weights).tolist() == expected.tolist()


@pytest.mark.parametrize("block", [1, 100, 300])
@pytest.mark.parametrize("depth", [True, False])
def test_blocks_do_not_change_the_result(monkeypatch, block, depth):
    more = place_leaves(default_leaf(), [*BASE, (9.0, 0.0, 0.0)], length_m=0.15)
    views = take_photographs(more, depth=depth)
    for view in views:
        view.depth_m[::7, ::5] = 0
    whole = sample_leaf_colors(more, views)
    monkeypatch.setattr(colors, "BLOCK", block)
    in_blocks = sample_leaf_colors(more, views)

    for name in ("color", "seen", "gain"):
        np.testing.assert_array_equal(getattr(in_blocks, name), getattr(whole, name))


def test_wrong_settings_are_refused():
    with pytest.raises(ValueError, match="across and along must be 1 or more, not 0 and 13"):
        PhotoColorSettings(across=0)
    with pytest.raises(ValueError, match="across and along must be at most 1000, not 7 and 1001"):
        PhotoColorSettings(along=1001)
    with pytest.raises(ValueError, match=r"border must be from 0 to below 0.5, not 0.5"):
        PhotoColorSettings(border=0.5)
