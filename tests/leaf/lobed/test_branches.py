"""The limbs of a lobed leaf as branches."""

import numpy as np
import pytest
from usdfoliage.leaf.lobed.branches import build_branches
from usdfoliage.leaf.lobed.model import model_lobed_leaf
from usdfoliage.leaf.lobed.ties import Ties

from tests.support.leaves.lobed import lobed_mask, lobed_shape


def test_the_skeleton_is_a_tree_of_branches():
    shape = lobed_shape()
    assert shape.branch_count == 5
    assert shape.parents[0] == -1
    assert (shape.parents[1:] < np.arange(1, len(shape.nodes))).all()
    starts = shape.branch_starts()
    assert (np.diff(shape.branches) >= 0).all()
    for branch, first in enumerate(starts.tolist()):
        own = np.flatnonzero(shape.branches == branch)
        assert (shape.parents[own[1:]] == own[:-1]).all()
        if branch:
            assert shape.branches[shape.parents[first]] < branch


def test_the_axis_goes_on_in_the_straightest_lobe():
    shape = lobed_shape()
    tip = shape.nodes[np.flatnonzero(shape.branches == 0)[-1]]
    assert abs(tip[0] - 120) < 12  # the lobe that stands upright over the petiole
    assert tip[1] > -60


def test_faces_are_those_of_the_ties():
    ties = model_lobed_leaf(lobed_mask()).ties
    shape = build_branches(ties)
    assert np.array_equal(shape.places[shape.faces], ties.places()[ties.quads()])
    assert (np.diff(shape.tie_nodes) >= 0).all()
    assert np.array_equal(np.unique(shape.tie_nodes), np.arange(len(shape.nodes)))


def test_spans_cover_each_branch():
    shape = lobed_shape()
    spans = shape.spans()
    for branch in range(shape.branch_count):
        own = spans[(shape.branches == branch) & (np.arange(len(spans)) > 0)]
        assert own[0, 0] == 0
        assert own[-1, 1] == pytest.approx(1)
        assert own[1:, 0] == pytest.approx(own[:-1, 1])
        assert (own[:, 1] > own[:, 0]).all()


def test_limbs_that_are_no_tree_are_refused():
    ring = Ties(
        nodes=np.array([[0.0, 0], [1, 0], [1, 1]]),
        limb_nodes=[np.array([0, 1]), np.array([1, 2]), np.array([2, 1])],
        node=np.array([0, 1, 2]),
        foot=np.ones((3, 2)),
        base=0,
    )
    with pytest.raises(ValueError, match="no tree"):
        build_branches(ring)
