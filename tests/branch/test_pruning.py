from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.branch.pruning import prune_branches

from tests.support.branch_shapes import fork, random_tree


def test_what_a_branch_carried_goes_on_from_its_parent():
    pruned = prune_branches(fork(), np.array([True, False, True]))
    skeleton = pruned.skeleton
    assert pruned.number.tolist() == [0, -1, 1]
    assert skeleton.parent_curve.tolist() == [-1, 0]
    assert skeleton.parent_vertex.tolist() == [-1, 1]
    assert skeleton.order.tolist() == [0, 1]
    # From the middle of the trunk along the branch that is gone, and on along the twig.
    assert skeleton.points_m[skeleton.branch(1)] == pytest.approx(np.array([[0, 1, 0], [1, 1, 0], [1.5, 1, 0.5]]))
    assert skeleton.radius_m[skeleton.branch(1)] == pytest.approx(0.015)
    assert pruned.prefix_m == pytest.approx([0, 1])


def test_branches_stay_as_inferred_as_they_were():
    plant = replace(fork(), inferred=np.array([False, False, True]))
    assert prune_branches(plant, np.array([True, False, True])).skeleton.inferred.tolist() == [False, True]
    assert plant.up_to_order(1).inferred.tolist() == [False, False]
    assert not fork().inferred.any()
    with pytest.raises(ValueError, match="inferred must be"):
        replace(fork(), inferred=np.zeros(2, bool))


def test_what_a_root_carried_is_a_root():
    pruned = prune_branches(fork(), np.array([False, True, True]))
    assert pruned.skeleton.parent_curve.tolist() == [-1, 0]
    assert pruned.skeleton.points_m[0] == pytest.approx([0, 0, 0])
    assert pruned.prefix_m == pytest.approx([1, 0])


def test_nothing_cannot_stay():
    with pytest.raises(ValueError, match="at least"):
        prune_branches(fork(), np.zeros(3, bool))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), wild=st.booleans())
def test_every_branch_that_stays_has_its_points_and_its_length(seed, wild):
    tree = random_tree(seed, 15, wild)
    rng = np.random.default_rng(seed)
    stays = rng.random(len(tree)) < 0.6
    stays[0] = True
    pruned = prune_branches(tree, stays)
    for old, new in enumerate(pruned.number.tolist()):
        assert (new >= 0) == stays[old]
        if new >= 0:
            own = tree.points_m[tree.branch(old)]
            assert np.array_equal(pruned.skeleton.points_m[pruned.skeleton.branch(new)][-len(own) :], own)
            longer = pruned.skeleton.lengths_m[new] - tree.lengths_m[old]
            assert longer == pytest.approx(pruned.prefix_m[new], abs=1e-9)
