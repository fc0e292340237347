"""A few shapes that stand for many leaves."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.leaf.shape.groups import group_leaves
from usdfoliage.leaf.shape.surface import evaluate_grid

from tests.support.leaves.assets import FLAT, random_leaves


def test_as_many_shapes_as_leaves_keep_each_its_own():
    groups = group_leaves(random_leaves(5), 5)
    np.testing.assert_array_equal(groups.chosen[groups.group], np.arange(5))
    assert groups.away.max() == 0


def test_two_kinds_of_leaves_become_two_shapes():
    leaves = random_leaves(40)
    wide = FLAT.copy()
    wide[2:5, 1] *= 2
    noise = np.random.default_rng(1).normal(0, 1e-3, (40, 7, 3))
    of_kind = np.arange(40) % 2
    leaves = replace(leaves, parameters=np.where(of_kind[:, None, None], wide, FLAT) + noise)
    groups = group_leaves(leaves, 2)
    assert len(groups) == 2
    for kind in (0, 1):
        assert len(np.unique(groups.group[of_kind == kind])) == 1
    assert groups.away.max() < 0.01


def test_distance_is_that_of_the_surface_in_leaf_lengths():
    leaves = random_leaves(2)
    raised = FLAT.copy()
    raised[0:2, 2] += 0.1  # the axis, and with it all that hangs on it, but not the ends
    leaves = replace(leaves, parameters=np.stack([FLAT, raised]))
    away = group_leaves(leaves, 1).away.max()
    flat, high = evaluate_grid(leaves.parameters, np.linspace(-1, 1, 5), np.linspace(0, 1, 5)).points
    assert away == pytest.approx(np.sqrt(np.mean(np.sum((high - flat) ** 2, axis=-1))), rel=1e-9)
    assert 0.03 < away < 0.1


def test_more_shapes_come_nearer_and_equal_leaves_need_one():
    leaves = random_leaves(60)
    away = [np.square(group_leaves(leaves, count).away).mean() for count in (1, 4, 16, 60)]
    assert away == sorted(away, reverse=True)
    assert away[-1] == 0
    same = replace(leaves, parameters=np.repeat(FLAT[None], 60, axis=0))
    assert len(group_leaves(same, 8)) == 1


def test_no_shape_is_refused_and_no_leaf_is_not():
    with pytest.raises(ValueError, match="1 or more"):
        group_leaves(random_leaves(3), 0)
    assert len(group_leaves(random_leaves(3).take(np.zeros(0, int)), 4)) == 0
