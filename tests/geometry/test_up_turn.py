"""Turns that make a direction Y."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from usdfoliage.geometry.up_turn import AXES, axis_vector, turn_to_y_up

NUMBER = st.floats(-1, 1)


@example(x=0.0, y=-1.0, z=1e-6)
@example(x=1e-9, y=-1.0, z=0.0)
@given(x=NUMBER, y=NUMBER, z=NUMBER)
def test_any_direction_becomes_y_by_the_smallest_turn(x, y, z):
    vector = np.array([x, y, z])
    if np.linalg.norm(vector) < 0.01:
        vector = np.array([0.0, 0.6, 0.8])
    up = vector / np.linalg.norm(vector)
    turn = turn_to_y_up(up)
    np.testing.assert_allclose(turn @ up, [0, 1, 0], atol=1e-7)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-7)
    assert np.linalg.det(turn) == pytest.approx(1)
    # A rotation's trace is 1 + 2 cos of its angle; the smallest angle is that between the direction and Y.
    assert np.trace(turn) == pytest.approx(1 + 2 * up[1], abs=1e-6)


@pytest.mark.parametrize("name", AXES)
def test_axes_are_turned_by_whole_numbers(name):
    turn = turn_to_y_up(axis_vector(name))
    assert set(np.unique(turn)) <= {-1.0, 0.0, 1.0}
    np.testing.assert_array_equal(turn @ axis_vector(name), [0, 1, 0])


def test_near_an_axis_the_turn_is_near_that_of_the_axis():
    up = np.array([1e-4, 0.0, 1.0]) / np.linalg.norm([1e-4, 0, 1])
    np.testing.assert_allclose(turn_to_y_up(up), turn_to_y_up(axis_vector("Z")), atol=2e-4)
