"""Fair axes: what is straight stays, what is noise goes, and forks stay joined."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.branch.tracing.axes import Axes, find_axes
from usdfoliage.branch.tracing.fairing import fair_axes

from tests.support.branch_clouds import line


def one_axis(count: int) -> Axes:
    return Axes(nodes=np.arange(count), first=np.array([0, count]), parent=np.array([-1]))


def fork(noise_m: float = 0.0, seed: int = 0) -> tuple[np.ndarray, Axes]:
    """Nodes of a trunk of 40 and of a branch of 15 from its middle."""
    nodes_m = np.concatenate([line([0, 0, 0], [0, 3.9, 0], 40), line([0.1, 2, 0], [1.5, 2, 0], 15)])
    parent = np.array([*range(-1, 39), 20, *range(40, 54)], np.int32)
    return nodes_m + noise_m * np.random.default_rng(seed).normal(size=nodes_m.shape), find_axes(nodes_m, parent, 0.0)


@pytest.mark.parametrize("stiffness", [0.5, 4.0, 1000.0])
def test_straight_branches_stay(stiffness):
    nodes_m, axes = fork()
    np.testing.assert_allclose(fair_axes(nodes_m, axes, np.ones(55), stiffness), nodes_m, atol=1e-6)


@given(height_m=st.floats(-1, 1), stiffness=st.floats(0.01, 100))
def test_three_nodes_move_by_the_formula(height_m, stiffness):
    nodes_m = np.array([[-1, 0, 0], [0, height_m, 0], [1, 0, 0]], float)
    fair_m = fair_axes(nodes_m, one_axis(3), np.ones(3), stiffness)
    share = 2 * stiffness / (1 + 6 * stiffness)  # by Woodbury: one second difference, of norm 6
    np.testing.assert_allclose(fair_m[:, 1], height_m * np.array([share, 1 - 2 * share, share]), atol=1e-9)
    np.testing.assert_allclose(fair_m[:, 0], [-1, 0, 1], atol=1e-9)


def test_without_stiffness_nothing_moves():
    nodes_m, axes = fork(0.1)
    np.testing.assert_array_equal(fair_axes(nodes_m, axes, np.ones(55), 0.0), nodes_m)


def test_noise_becomes_less_the_stiffer_the_axis():
    true_m, axes = fork()
    nodes_m, _ = fork(0.02)
    rms_m = []
    for stiffness in (0.0, 1.0, 10.0, 100.0):
        away_m = fair_axes(nodes_m, axes, np.ones(55), stiffness) - true_m
        away_m[:40, 1] = away_m[40:, 0] = 0  # across the branches
        rms_m.append(np.sqrt(np.mean(away_m**2)))
    assert (np.diff(rms_m) < 0).all()
    assert rms_m[-1] < 0.5 * rms_m[0]


def test_a_branch_begins_where_its_parent_was_moved_to():
    nodes_m, axes = fork(0.05, seed=3)
    fair_m = fair_axes(nodes_m, axes, np.ones(55), 10.0)
    alone_m = fair_axes(nodes_m[:40], one_axis(40), np.ones(40), 10.0)
    np.testing.assert_allclose(fair_m[:40], alone_m, atol=1e-9)  # the parent knows nothing of its branch
    # What bends at the fork counts as bend of the branch: it leaves towards where the node was moved to.
    steps_m = np.diff(fair_m[[20, *range(40, 55)]], axis=0)
    bend_m = np.linalg.norm(np.diff(steps_m, axis=0), axis=1)
    assert bend_m[0] < 3 * np.median(bend_m)


def test_a_node_with_many_points_moves_less():
    nodes_m = np.array([[k, 0.1 * (k == 3), 0] for k in range(7)], float)
    moved_m = []
    for points in (1, 10, 1000):
        weight = np.ones(7)
        weight[3] = points
        moved_m.append(0.1 - fair_axes(nodes_m, one_axis(7), weight, 4.0)[3, 1])
    assert moved_m[0] > moved_m[1] > moved_m[2] > 0
    assert moved_m[2] < 0.005


@examples(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), far_m=st.floats(-1000, 1000), scale=st.floats(0.01, 100))
def test_where_it_stands_and_how_large_it_is_does_not_matter(seed, far_m, scale):
    nodes_m, axes = fork(0.05, seed)
    weight = np.random.default_rng(seed).integers(1, 50, 55)
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    expected_m = scale * fair_axes(nodes_m, axes, weight, 4.0) @ turn + far_m
    np.testing.assert_allclose(fair_axes(scale * nodes_m @ turn + far_m, axes, weight, 4.0), expected_m, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2])
def test_axes_too_short_to_bend_stay(count):
    nodes_m = np.random.default_rng(0).normal(size=(count, 3))
    np.testing.assert_allclose(fair_axes(nodes_m, one_axis(count), np.ones(count), 4.0), nodes_m)


def test_nodes_stay_about_as_near_as_they_must():
    rng = np.random.default_rng(1)
    nodes_m = np.column_stack([np.arange(60.0), rng.normal(size=60), rng.normal(size=60)])
    free_m, kept_m, tight_m = (
        np.linalg.norm(fair_axes(nodes_m, one_axis(60), np.ones(60), 10.0, max_m) - nodes_m, axis=1)
        for max_m in (np.inf, 0.3, np.where(np.arange(60) < 30, 0.05, np.inf))
    )
    assert free_m.max() > 1.0
    assert np.quantile(kept_m, 0.9) < 0.4
    assert kept_m.max() < 0.7
    assert tight_m[:30].max() < 0.1
    np.testing.assert_allclose(tight_m[40:], free_m[40:], atol=0.2)


def test_a_small_movement_is_not_limited():
    nodes_m, axes = fork(0.001)
    free_m = fair_axes(nodes_m, axes, np.ones(55), 4.0)
    np.testing.assert_array_equal(fair_axes(nodes_m, axes, np.ones(55), 4.0, 0.1), free_m)
