"""Pieces of a plant, and what lies on the floor beside it."""

import numpy as np
import pytest
from usdfoliage.isolation.pieces import LyingSettings, find_lying

LAYER_M = 0.02


def trunk(height_m: float = 2.0) -> np.ndarray:
    height = np.linspace(0.03, height_m, 300)
    turn = 7.0 * np.arange(300)
    return np.stack([0.06 * np.cos(turn), height, 0.06 * np.sin(turn)], axis=1)


def test_a_shadow_beside_a_trunk_lies_on_the_floor():
    rng = np.random.default_rng(1)
    shadow_m = rng.uniform((0.05, 0.025, -0.2), (1.5, 0.045, 0.2), (2000, 3))
    cells_m = np.concatenate([trunk(), shadow_m])
    lying = find_lying(cells_m, cells_m[:, 1], LAYER_M)
    assert not lying[:300].any()
    far = shadow_m[:, 0] > 0.2
    assert lying[300:][far].all()


def test_a_leaf_that_droops_to_the_floor_stays():
    share = np.linspace(0, 1, 60)
    leaf_m = np.stack([0.06 + 0.15 * share, 0.2 - 0.17 * share**0.5, 0 * share], axis=1)
    cells_m = np.concatenate([trunk(), leaf_m])
    assert not find_lying(cells_m, cells_m[:, 1], LAYER_M).any()


@pytest.mark.parametrize("height_m", [0.03, 0.2])
def test_a_plant_that_is_low_or_high_all_over_stays(height_m):
    rng = np.random.default_rng(2)
    cells_m = rng.uniform((-1, 0.5 * height_m, -1), (1, height_m, 1), (500, 3))
    assert not find_lying(cells_m, cells_m[:, 1], LAYER_M).any()


def test_settings_are_checked():
    with pytest.raises(ValueError, match="low"):
        LyingSettings(low=9.0)
