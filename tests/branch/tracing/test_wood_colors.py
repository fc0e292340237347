"""What colours show of wood: much where bark and leaves differ, nothing where they do not."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.reconstruct import reconstruct_branches
from usdfoliage.branch.tracing.wood_colors import color_odds

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
