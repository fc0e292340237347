"""Control nets of jittered leaves: exact without jitter, nearest with it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.jittered_net import jittered_nets
from usdfoliage.leaf.shape.nurbs import net_weights
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places, leaf_nets

from tests.support.leaves.assets import FLAT, random_leaves

RIGHT = grid_places([1.0], np.linspace(0, 1, 65))


def distance(nets, leaves, jitter):
    """Root mean square distance of the nets' right silhouettes from the jittered ones."""
    drawn = evaluate_points(leaves.parameters, RIGHT, jitter, leaves.phase)
    return np.sqrt(np.mean(np.sum((net_weights(RIGHT) @ nets.reshape(len(nets), 35, 3) - drawn) ** 2, axis=-1)))


def test_without_jitter_nets_are_exact():
    parameters = random_leaves(9).parameters
    np.testing.assert_array_equal(jittered_nets(parameters), leaf_nets(parameters))
    assert jittered_nets(np.zeros((0, 7, 3)), Jitter(amplitude=0.1)).shape == (0, 5, 7, 3)


@pytest.mark.parametrize(("frequency", "left_over"), [(0.25, 0.2), (0.5, 0.4), (16.0, 1.0)])
def test_slow_waves_are_carried_and_fast_ones_leave_the_leaf_as_it_is(frequency, left_over):
    leaves = random_leaves(50)
    jitter = Jitter(amplitude=0.05, frequency=frequency)
    without = distance(leaf_nets(leaves.parameters), leaves, jitter)
    assert distance(jittered_nets(leaves.parameters, jitter, leaves.phase), leaves, jitter) <= left_over * without


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), frequency=st.floats(0.1, 20))
def test_no_other_net_is_nearer(seed, frequency):
    leaves = random_leaves(2, seed)
    jitter = Jitter(amplitude=0.05, frequency=frequency)
    nets = jittered_nets(leaves.parameters, jitter, leaves.phase)
    rng = np.random.default_rng(seed)
    for _ in range(3):
        other = nets.copy()
        other[:, 1:4, 6] += rng.normal(0, 0.02, (2, 3, 3))
        assert distance(nets, leaves, jitter) < distance(other, leaves, jitter)
    moved = nets - leaf_nets(leaves.parameters)
    np.testing.assert_allclose(moved[:, :, 0], -moved[:, :, 6], rtol=0, atol=1e-12)  # both halves are equal
    assert not moved[:, [0, 4]].any()  # base and apex
    assert not moved[:, :, 1:6].any()


def test_phase_is_0_by_default():
    jitter = Jitter(amplitude=0.05, frequency=0.5)
    np.testing.assert_array_equal(jittered_nets(FLAT[None], jitter), jittered_nets(FLAT[None], jitter, np.zeros(1)))
