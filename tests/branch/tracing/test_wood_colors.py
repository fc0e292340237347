"""What colours show of wood: much where bark and leaves differ, nothing where they do not."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.reconstruct import reconstruct_branches
from usdfoliage.branch.tracing.wood import WoodSettings, caution_with_colors
from usdfoliage.branch.tracing.wood_colors import blur_colors, color_odds

from tests.support.branch_clouds import cloud_of, leaves_on, twiggy_tree

FOOT_M = np.zeros((1, 3))
BARK, GREEN, AUTUMN = (120, 95, 80), (70, 140, 40), (200, 120, 30)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def paint(rng: np.random.Generator, is_wood: np.ndarray, leaf: tuple[int, int, int]) -> np.ndarray:
    """Bark and leaves in light and shade."""
    light = rng.uniform(0.3, 1.2, (len(is_wood), 1))
    return np.clip(np.where(is_wood[:, None], BARK, leaf) * light + rng.normal(0, 4, (len(is_wood), 3)), 0, 255)


@pytest.mark.parametrize("leaf", [GREEN, AUTUMN])
def test_colours_that_differ_separate_wood_that_was_taken_for_leaves(rng, leaf):
    is_wood = np.arange(8000) < 3000
    taken = np.where(rng.random(8000) < 0.3, ~is_wood, is_wood)
    odds = color_odds(paint(rng, is_wood, leaf), taken)
    assert (odds[is_wood] > 0).mean() > 0.97
    assert (odds[~is_wood] < 0).mean() > 0.97
    assert np.abs(odds).max() < 2.5  # no surer than what it was learnt from


def test_similar_colours_separate_nothing(rng):
    is_wood = np.arange(20_000) < 8000
    assert np.abs(color_odds(paint(rng, is_wood, BARK), is_wood)).mean() < 0.15


@pytest.mark.parametrize("wood", [0, 5, 995, 1000])
def test_of_too_few_points_nothing_is_learnt(rng, wood):
    assert not color_odds(rng.uniform(0, 255, (1000, 3)), np.arange(1000) < wood).any()


@pytest.mark.parametrize("color", [(0, 0, 0), (255, 255, 255), (9, 200, 9)])
def test_a_single_colour_separates_nothing(color):
    odds = color_odds(np.tile(color, (1000, 1)), np.arange(1000) < 400)
    np.testing.assert_allclose(odds, 0, atol=0.3)


def test_with_colours_fewer_leaves_are_taken_for_wood(rng):
    wood_m, leaves_m = cloud_of(twiggy_tree(), 10_000, 0, 0.002), leaves_on(twiggy_tree(), 6)
    points_m = np.concatenate([wood_m, leaves_m + rng.normal(0, 0.002, leaves_m.shape)])
    is_wood = np.arange(len(points_m)) < len(wood_m)
    plain = reconstruct_branches(points_m, FOOT_M)
    colored = reconstruct_branches(points_m, FOOT_M, colors=paint(rng, is_wood, GREEN))
    assert colored.wood[~is_wood].mean() < plain.wood[~is_wood].mean()
    assert colored.wood[is_wood].mean() > 0.95


def test_brightness_separates_what_has_one_hue(rng):
    is_wood = np.arange(8000) < 3000
    taken = np.where(rng.random(8000) < 0.3, ~is_wood, is_wood)
    colors = np.where(is_wood[:, None], (60, 55, 50), (168, 154, 140)) + rng.normal(0, 4, (8000, 3))
    odds = color_odds(colors, taken)
    assert (odds[is_wood] > 0).mean() > 0.97
    assert (odds[~is_wood] < 0).mean() > 0.97


def test_surroundings_correct_single_points_of_a_twig(rng):
    """Two lines of points, one of wood and one of leaves, of which 4 in 10 points have the colour of the other."""
    is_wood = np.arange(2000) < 1000
    points_m = np.column_stack([np.tile(np.arange(1000) * 1e-3, 2), np.where(is_wood, 0.0, 0.5), np.zeros(2000)])
    swapped = rng.random(2000) < 0.4
    colors = np.where((is_wood ^ swapped)[:, None], BARK, GREEN) + rng.normal(0, 4, (2000, 3))
    alone, together = (color_odds(each, is_wood) > 0 for each in (colors, blur_colors(points_m, colors, 0.003)))
    assert (alone == is_wood).mean() < 0.65
    assert (together == is_wood).mean() > 0.8


def test_black_points_are_no_colours_and_stay_black():
    colors = np.array([[0, 0, 0], [30, 60, 90], [50, 60, 70], [200, 0, 0]])
    points_m = np.array([[0, 0, 0], [0.001, 0, 0], [0.002, 0, 0], [1, 0, 0]], np.float64)
    np.testing.assert_allclose(
        blur_colors(points_m, colors, 0.01), [[0, 0, 0], [40, 60, 80], [40, 60, 80], [200, 0, 0]]
    )
    assert not blur_colors(points_m, np.zeros((4, 3)), 0.01).any()


def test_the_caution_is_larger_the_more_colours_distinguish():
    settings = WoodSettings(caution=0.5, color_caution=1.2)
    assert caution_with_colors(np.zeros(9), settings) == caution_with_colors(np.zeros(0), settings) == 0.5
    some, much = (caution_with_colors(np.array([-odds, odds]), settings) for odds in (1, 20))
    assert 0.5 < some < much <= 1.2
