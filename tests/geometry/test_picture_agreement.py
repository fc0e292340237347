"""A drawing against its own picture agrees; moved by known pixels it agrees as far as is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.geometry.picture_agreement import (
    NOTHING,
    find_outlines,
    find_vegetation,
    mean_agreement,
    measure_agreement,
)

SIDE = 40  # of the square leaf, in a picture of 120 by 90
GREEN, WALL = (40, 160, 50), (150, 145, 140)


def square(move=(0, 0)):
    """(90, 120), a square leaf of number 1."""
    ids = np.full((90, 120), NOTHING, np.int32)
    ids[25 + move[0] : 25 + move[0] + SIDE, 40 + move[1] : 40 + move[1] + SIDE] = 1
    return ids


def picture(ids):
    return np.where((ids != NOTHING)[..., None], GREEN, WALL).astype(np.uint8)


def test_a_square_leaf_agrees_with_its_own_picture():
    ids = square()
    found = measure_agreement(ids, picture(ids), ids != NOTHING)
    assert (found.iou, found.precision, found.recall) == (1, 1, 1)
    assert found.edge_recall == 1
    # All of its outline is on an edge. Moved by 12 pixels, what crosses the square's sides still is: of a side's 40
    # pixels each move lays two ends within 2 pixels of an edge, 3 to 5 pixels each, and two sides along an edge.
    assert found.edge_precision > 0.4
    assert found.mask_share == SIDE**2 / (90 * 120)


@given(down=st.integers(-20, 20), right=st.integers(-20, 20))
def test_a_moved_square_has_the_known_overlap(down, right):
    photograph = square()
    found = measure_agreement(square((down, right)), picture(photograph), photograph != NOTHING)
    both = (SIDE - abs(down)) * (SIDE - abs(right))
    assert found.iou == pytest.approx(both / (2 * SIDE**2 - both), abs=1e-12)
    assert found.precision == found.recall == pytest.approx(both / SIDE**2, abs=1e-12)


def test_outlines_that_are_on_no_edge_count_for_nothing():
    photograph = square()
    found = measure_agreement(square((9, 9)), picture(photograph), photograph != NOTHING)
    exact = measure_agreement(photograph, picture(photograph), photograph != NOTHING)
    assert found.edge_recall < 0.3 < exact.edge_recall
    assert found.edge_precision < exact.edge_precision - 0.4


def test_an_empty_drawing_finds_nothing():
    photograph = square()
    nothing = np.full(photograph.shape, NOTHING)
    found = measure_agreement(nothing, picture(photograph), photograph != NOTHING)
    assert (found.iou, found.precision, found.recall, found.edge_precision, found.edge_recall) == (0, 0, 0, 0, 0)


def test_a_photograph_without_a_plant_agrees_with_nothing():
    ids = square()
    wall = np.full((90, 120, 3), 128, np.uint8)
    found = measure_agreement(ids, wall, np.zeros(ids.shape, np.bool_))
    assert (found.iou, found.precision, found.recall, found.edge_recall, found.mask_share) == (0, 0, 0, 0, 0)


def test_pictures_of_another_size_are_refused():
    with pytest.raises(ValueError, match="one size"):
        measure_agreement(square(), np.zeros((90, 121, 3), np.uint8), square() != NOTHING)


def test_vegetation_is_what_is_green_but_no_single_pixel():
    photograph = picture(square())
    photograph[5, 5] = GREEN
    np.testing.assert_array_equal(find_vegetation(photograph), square() != NOTHING)


def test_outlines_part_things_from_each_other_and_from_nothing():
    ids = np.array([[0, 0, 1], [0, 0, 1], [NOTHING, NOTHING, NOTHING]])
    np.testing.assert_array_equal(find_outlines(ids), [[0, 0, 1], [0, 0, 1], [1, 1, 1]])


def test_the_mean_is_that_of_every_figure():
    ids = square()
    good = measure_agreement(ids, picture(ids), ids != NOTHING)
    bad = measure_agreement(np.full(ids.shape, NOTHING), picture(ids), ids != NOTHING)
    mean = mean_agreement([good, bad])
    assert mean.iou == mean.recall == 0.5
    assert mean.mask_share == good.mask_share
    with pytest.raises(ValueError, match="no pictures"):
        mean_agreement([])
