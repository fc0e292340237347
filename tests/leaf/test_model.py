"""Leaves as arrays: shapes, placement, choosing some, the mean."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.model import Leaves, mean_leaf

FEW = settings(max_examples=25, deadline=None)


def leaves(count=3, **changed):
    rng = np.random.default_rng(count)
    fields = {
        "parameters": rng.normal(size=(count, 7, 3)),
        "base_m": rng.normal(size=(count, 3)),
        "orientation": Rotation.random(count, rng=rng).as_quat() if count else np.empty((0, 4)),
        "length_m": rng.uniform(0.02, 0.2, count),
        "phase": rng.uniform(0, 64, count),
    }
    return Leaves(**(fields | changed))


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("parameters", (3, 3, 7)),
        ("base_m", (2, 3)),
        ("orientation", (3, 3)),
        ("length_m", (3, 1)),
        ("phase", (4,)),
        ("confidence", (2,)),
        ("residual_m", (3, 1)),
        ("view", (0,)),
    ],
)
def test_arrays_of_other_shapes_are_refused_by_name(name, shape):
    with pytest.raises(ValueError, match=f"^{name} must be .* not {re.escape(str(shape))}"):
        leaves(**{name: np.zeros(shape)})


def test_a_leaf_is_turned_scaled_and_moved():
    quarter = Rotation.from_euler("z", 90, degrees=True).as_quat()[None]  # x to y, y to -x
    one = leaves(1, base_m=np.array([[1.0, 2.0, 3.0]]), orientation=quarter, length_m=np.array([0.5]))
    matrix = one.asset_from_leaf()[0]
    np.testing.assert_allclose(matrix @ (0, 0, 0, 1), (1, 2, 3), atol=1e-15)  # base
    np.testing.assert_allclose(matrix @ (0, 1, 0, 1), (0.5, 2, 3), atol=1e-15)  # apex
    np.testing.assert_allclose(matrix @ (0, 0, 1, 1), (1, 2, 3.5), atol=1e-15)


@FEW
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.01, 100))
def test_placement_agrees_with_scipy_also_for_quaternions_of_another_length(seed, scale):
    turns = Rotation.random(4, rng=np.random.default_rng(seed))
    four = leaves(4, orientation=scale * turns.as_quat())
    expected = turns.as_matrix() * four.length_m[:, None, None]
    np.testing.assert_allclose(four.asset_from_leaf()[:, :, :3], expected, atol=1e-14)
    np.testing.assert_array_equal(four.asset_from_leaf()[:, :, 3], four.base_m)


def test_no_leaves_have_no_places():
    none = leaves(0)
    assert len(none) == 0
    assert none.asset_from_leaf().shape == (0, 3, 4)


@pytest.mark.parametrize("chosen", [[2, 0], np.array([2, 0]), slice(None)])
def test_leaves_are_taken_by_number_in_their_order(chosen):
    if isinstance(chosen, slice):
        chosen = np.arange(3)
    three = leaves(3, confidence=np.array([0.1, 0.2, 0.3]))
    some = three.take(chosen)
    np.testing.assert_array_equal(some.parameters, three.parameters[chosen])
    np.testing.assert_array_equal(some.phase, three.phase[chosen])
    np.testing.assert_array_equal(some.confidence, three.confidence[chosen])
    assert some.view is None


def test_leaves_are_taken_by_mask():
    three = leaves(3)
    some = three.take(three.length_m > np.median(three.length_m))
    assert len(some) == 1
    assert some.length_m[0] == three.length_m.max()
    assert len(three.take(np.zeros(3, bool))) == 0


def test_the_mean_leaf_weighs_leaves():
    parameters = np.stack([np.zeros((7, 3)), np.ones((7, 3))])
    np.testing.assert_array_equal(mean_leaf(parameters), np.full((7, 3), 0.5))
    np.testing.assert_array_equal(mean_leaf(parameters, np.array([1.0, 3.0])), np.full((7, 3), 0.75))
    np.testing.assert_array_equal(mean_leaf(parameters.astype(np.float32)[1:]), np.ones((7, 3)))


@pytest.mark.parametrize(
    ("parameters", "weights", "message"),
    [
        (np.empty((0, 7, 3)), None, "no leaves to average"),
        (np.ones((2, 7, 3)), np.zeros(2), "sum to more than 0, not 0.0"),
        (np.ones((2, 7, 3)), np.array([np.nan, 1]), "sum to more than 0, not nan"),
    ],
)
def test_nothing_has_no_mean(parameters, weights, message):
    with pytest.raises(ValueError, match=message):
        mean_leaf(parameters, weights)
