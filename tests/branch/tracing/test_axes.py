"""Axes: at a fork the arm that carries more goes on, and what is short is no branch."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.axes import find_axes


def y_nodes(right_m: float = 2.0, left_m: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A stem of 3 nodes to 2 m, and two arms of 2 nodes each that spring from its last one."""
    arms_m = np.array([[1, 0, 0], [2, 0, 0]]) * right_m / 2, np.array([[-1, 0, 0], [-2, 0, 0]]) * left_m / 2
    centers_m = np.concatenate([[[0, 0, 0], [0, 1, 0], [0, 2, 0]], *(np.add(arm, [0, 2, 0]) for arm in arms_m)])
    return centers_m, np.array([-1, 0, 1, 2, 3, 2, 5], np.int32)


def random_nodes(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 60))
    parent = np.array([rng.integers(max(-1, node - 5), node) for node in range(count)], np.int32)
    return rng.normal(size=(count, 3)), parent


def test_the_trunk_of_a_y_goes_on_in_the_longer_arm():
    axes = find_axes(*y_nodes(), min_m=0.0)
    assert [axes.axis(number).tolist() for number in range(len(axes))] == [[0, 1, 2, 3, 4], [2, 5, 6]]
    assert axes.parent.tolist() == [-1, 0]
    assert axes.order.tolist() == [0, 1]
    assert axes.own.tolist() == [True] * 5 + [False, True, True]
    other = find_axes(*y_nodes(1.0, 2.0), min_m=0.0)
    assert other.axis(0).tolist() == [0, 1, 2, 5, 6]


def test_an_arm_that_carries_more_goes_on_before_one_that_is_longer():
    centers_m, parent = y_nodes(2.0, 1.6)
    twigs_m = centers_m[5] + [[0, 0, 0.4], [0, 0, -0.4]]
    axes = find_axes(np.concatenate([centers_m, twigs_m]), np.append(parent, [5, 5]).astype(np.int32), 0.0)
    assert axes.axis(0).tolist() == [0, 1, 2, 5, 6]
    assert axes.axis(1).tolist() == [2, 3, 4]


def test_short_spurs_are_left_out():
    centers_m, parent = y_nodes(2.0, 1.0)
    assert len(find_axes(centers_m, parent, 1.0)) == 2  # as long as is asked for
    axes = find_axes(centers_m, parent, 1.001)
    assert len(axes) == 1
    assert axes.parent_node(7).tolist() == [-1, 0, 1, 2, 3, -1, -1]
    min_m = np.array([9, 9, 0.5, 9, 9, 9, 9])  # that of the node from which the arm springs counts
    assert len(find_axes(centers_m, parent, min_m)) == 2


def test_lengths_run_along_each_axis():
    centers_m, parent = y_nodes()
    axes = find_axes(centers_m, parent, 0.0)
    assert axes.lengths_along(centers_m).tolist() == [0, 1, 2, 3, 4, 0, 0.5, 1]


@given(seed=st.integers(0, 2**32 - 1))
def test_every_node_is_one_axis_own(seed):
    centers_m, parent = random_nodes(seed)
    axes = find_axes(centers_m, parent, 0.0)
    assert np.sort(axes.nodes[axes.own]).tolist() == list(range(len(parent)))
    assert axes.parent_node(len(parent)).tolist() == parent.tolist()
    assert (axes.parent < np.arange(len(axes))).all()  # parents first
    total_m = axes.lengths_along(centers_m)[axes.first[1:] - 1].sum()
    assert total_m == pytest.approx(step_lengths(centers_m, parent).sum())
    for number in np.flatnonzero(axes.parent >= 0):
        assert axes.axis(number)[0] in axes.axis(axes.parent[number])
        assert axes.order[number] == axes.order[axes.parent[number]] + 1


@given(seed=st.integers(0, 2**32 - 1), min_m=st.floats(0, 8))
def test_no_axis_is_left_out_that_is_long_enough(seed, min_m):
    centers_m, parent = random_nodes(seed)
    step_m = step_lengths(centers_m, parent)
    reach_m = RootedTree(parent).farthest_above(step_m) + step_m
    axes = find_axes(centers_m, parent, min_m)
    begins = axes.nodes[axes.first[:-1][axes.parent >= 0] + 1]
    assert (reach_m[begins] >= min_m).all()
    on_axis = np.isin(np.arange(len(parent)), axes.nodes)
    springs = ~on_axis & (parent >= 0) & on_axis[parent]
    assert (reach_m[springs] < min_m).all()
    assert on_axis[parent < 0].all()


def test_a_lone_root_is_an_axis_of_one_node():
    axes = find_axes(np.zeros((2, 3)), np.array([-1, -1], np.int32), 0.0)
    assert axes.first.tolist() == [0, 1, 2]
    assert axes.parent.tolist() == [-1, -1]
