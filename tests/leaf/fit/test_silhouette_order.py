"""The points of silhouettes are put in order along the axis, where that moves them little."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from usdfoliage.leaf.fit.silhouette_order import MIN_STEP, order_silhouettes
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.reconstruct import choose_sound

from tests.support.leaves.captures import known_foliage


def test_feet_a_little_out_of_order_are_put_in_order():
    leaves = known_foliage().leaves.take(np.arange(4))
    parameters = leaves.parameters.copy()
    parameters[0, 2:5, 0] = -0.03, 0.6, 0.8  # a round base
    parameters[1, 2:5, 0] = 0.4, 0.7, 1.02
    parameters[2, 2:5, 0] = 0.6, 0.2, 0.8  # another shape, were it in order
    parameters[3, 2, 0] = np.nan
    moved = order_silhouettes(replace(leaves, parameters=parameters))
    assert moved.parameters[:2, 2:5, 0] == pytest.approx(np.array([[0.001, 0.6, 0.8], [0.4, 0.7, 0.999]]))
    assert np.array_equal(moved.parameters[2:], parameters[2:], equal_nan=True)
    others = np.ones((7, 3), bool)
    others[2:5, 0] = False
    assert np.array_equal(moved.parameters[:2, others], parameters[:2, others])
    assert choose_sound(moved, 0.0)[0].tolist() == [True, True, False, False]


@given(feet=arrays(float, 3, elements=st.floats(-0.5, 1.5)))
def test_feet_in_order_stay_and_others_end_in_order(feet):
    ordered = order_silhouettes(some_leaf(feet)).parameters[0, 2:5, 0]
    steps = np.diff(np.concatenate([[0], feet, [1]]))
    if (steps >= MIN_STEP).all():
        assert ordered == pytest.approx(feet, abs=1e-15)
    assert (np.diff(np.concatenate([[0], ordered, [1]])) > 0).all() or np.array_equal(ordered, feet)


def some_leaf(feet):
    parameters = np.zeros((1, 7, 3))
    parameters[0, 2:5, 0] = feet
    one = np.ones(1)
    return Leaves(
        parameters=parameters, base_m=np.zeros((1, 3)), orientation=np.eye(4)[3:], length_m=one, phase=np.zeros(1)
    )
