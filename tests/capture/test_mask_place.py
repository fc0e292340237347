"""Masks that lie beside the plant are seen by what is green."""

import numpy as np
import pytest
from usdfoliage.capture.mask_place import describe_moves, measure_move

GREEN, GREY = (60, 140, 40), (120, 118, 121)


def plant(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A picture of 160 x 120 of a plant of ten discs before a wall, and its mask."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:120, :160]
    mask = np.zeros((120, 160), bool)
    for x, y in rng.uniform((55, 40), (105, 80), (10, 2)):
        mask |= np.hypot(column - x, row - y) < 9
    return np.where(mask[..., None], GREEN, GREY).astype(np.uint8), mask


def moved(by: tuple[int, int], views: int = 6) -> list:
    pictures = [plant(seed) for seed in range(views)]
    return [measure_move(srgb, np.roll(mask, by[::-1], axis=(0, 1))) for srgb, mask in pictures]


def test_a_move_is_measured_back():
    move = measure_move(plant(0)[0], np.roll(plant(0)[1], 16, axis=1))
    np.testing.assert_allclose(move.move, (-0.1, 0), atol=1e-9)
    assert move.after == pytest.approx(1.0, abs=0.01)
    assert move.helps


@pytest.mark.parametrize("by", [(16, 0), (0, -16)])
def test_masks_beside_the_plant_are_a_warning(by):
    (found,) = describe_moves(moved(by))
    assert found.code == "masks-beside-plant"
    assert found.severity == "warning"
    assert found.text.startswith("6 of 6 masks lie beside the plant, by 10%")


@pytest.mark.parametrize("by", [(0, 0), (1, 1)])
def test_good_masks_are_none(by):
    assert describe_moves(moved(by)) == ()


def test_masks_that_were_moved_each_otherwise_are_none():
    moves = [moved(by, 1)[0] for by in ((20, 0), (-20, 0), (0, 20), (0, -20), (16, 16), (-16, 16))]
    assert describe_moves(moves) == ()


def test_the_lawn_below_a_tree_draws_no_mask_to_it():
    moves = []
    for seed in range(6):
        srgb, mask = plant(seed)
        srgb[70:] = GREEN
        moves.append(measure_move(srgb, mask))
    assert describe_moves(moves) == ()


def test_nothing_is_known_of_plants_that_are_not_green():
    srgb, mask = plant(0)
    grey = np.full_like(srgb, 120)
    assert measure_move(grey, mask) is None
    assert measure_move(srgb, np.zeros_like(mask)) is None
    assert describe_moves([None] * 5) == ()
