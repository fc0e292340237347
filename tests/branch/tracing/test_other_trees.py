"""Trees beside the one that is meant, by clouds whose trees are known."""

import numpy as np
from usdfoliage.branch.tracing.other_trees import find_other_trees

from tests.support.branch_clouds import cloud_of, small_tree

ASIDE_M = np.array([6.0, 0.3, 0])


def two_trees():
    one = cloud_of(small_tree(), per_m2=3000)
    return np.concatenate([one, one + ASIDE_M]), len(one)


def test_of_two_trees_that_do_not_touch_the_other_is_found():
    points_m, count = two_trees()
    roots_m = np.array([[0.0, 0, 0], ASIDE_M])
    for meant in (0, 1):
        other = find_other_trees(points_m, roots_m[[meant]], roots_m, 0.02)
        assert (other == (np.arange(len(points_m)) < count)).mean() == float(meant == 1)


def test_a_piece_without_a_root_goes_with_the_nearer_tree():
    points_m, _ = two_trees()
    piece_m = np.random.default_rng(0).uniform([1.9, 2.9, -0.1], [2.1, 3.1, 0.1], (50, 3))
    all_m = np.concatenate([points_m, piece_m])
    roots_m = np.array([[0.0, 0, 0], ASIDE_M])
    assert not find_other_trees(all_m, roots_m[:1], roots_m, 0.02)[-50:].any()
    assert find_other_trees(all_m, roots_m[1:], roots_m, 0.02)[-50:].all()


def test_stems_of_one_plant_and_a_plant_alone_stay():
    points_m, count = two_trees()
    both = np.array([[0.0, 0, 0], ASIDE_M])
    assert not find_other_trees(points_m, both, both, 0.02).any()
    assert not find_other_trees(points_m[:count], both[:1], both[:1], 0.02).any()
    assert not find_other_trees(points_m[:count], both[:1], np.array([[0.0, 0, 0], [0.05, 0, 0]]), 0.02).any()
    assert find_other_trees(np.zeros((0, 3)), both, both, 0.02).shape == (0,)
