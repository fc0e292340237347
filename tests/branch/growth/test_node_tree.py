"""Skeletons as nodes, and back."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from usdfoliage.branch.growth.node_tree import as_skeleton, node_tree

from tests.support.branch_shapes import fork, random_tree

ARRAYS = ("points_m", "radius_m", "counts", "parent_curve", "parent_vertex", "order")


@given(seed=st.integers(0, 2**32 - 1))
def test_a_skeleton_comes_back(seed):
    skeleton = random_tree(seed)
    back = as_skeleton(node_tree(skeleton, 1e9))
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(back, name), getattr(skeleton, name), err_msg=name)


@given(seed=st.integers(0, 2**32 - 1), longest_m=st.floats(0.02, 0.5))
def test_nodes_between_vertices_lie_on_the_branches(seed, longest_m):
    skeleton = random_tree(seed)
    tree = node_tree(skeleton, longest_m)
    fine = as_skeleton(tree)
    above = np.flatnonzero(tree.parent >= 0)
    steps_m = np.linalg.norm(tree.position_m[above] - tree.position_m[tree.parent[above]], axis=1)
    assert steps_m.max() <= longest_m * (1 + 1e-6)
    np.testing.assert_allclose(fine.lengths_m, skeleton.lengths_m)
    np.testing.assert_array_equal(fine.parent_curve, skeleton.parent_curve)
    np.testing.assert_array_equal(fine.order, skeleton.order)
    ends = fine.first + fine.counts - 1
    np.testing.assert_array_equal(fine.points_m[ends], skeleton.points_m[skeleton.first + skeleton.counts - 1])


def test_what_springs_from_a_branch_goes_with_it():
    skeleton = random_tree(4)
    tree = node_tree(skeleton, 1e9)
    cut = np.zeros(len(skeleton), bool)
    cut[1] = True
    gone = tree.carried_by(cut)
    carried = [1]
    for number in range(2, len(skeleton)):
        if skeleton.parent_curve[number] in carried:
            carried.append(number)
    assert np.flatnonzero(gone).tolist() == carried
    left = as_skeleton(tree.without(cut))
    assert len(left) == len(skeleton) - len(carried)
    np.testing.assert_allclose(left.lengths_m, np.delete(skeleton.lengths_m, carried))


def test_a_radius_that_is_not_known_is_refused():
    tree = node_tree(fork(), 1e9)
    tree.radius_m[1] = np.nan
    with pytest.raises(ValueError, match="radii"):
        as_skeleton(tree)
