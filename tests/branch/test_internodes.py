"""Internodes are measured from one side branch to the next."""

import numpy as np
import pytest
from usdfoliage.branch.internodes import measure_internode_m
from usdfoliage.branch.model import Skeleton


def ladder(heights_m: list[float], radius_m: float = 0.001) -> Skeleton:
    """A stem of 1 m with a side branch at each of these heights."""
    stem_m = np.column_stack([np.zeros(101), np.linspace(0, 1, 101), np.zeros(101)])
    at = [round(100 * height_m) for height_m in heights_m]
    sides_m = [stem_m[vertex] + [[0, 0, 0], [0.1, 0.05, 0]] for vertex in at]
    branches = 1 + len(at)
    return Skeleton(
        points_m=np.concatenate([stem_m, *sides_m]),
        radius_m=np.full(101 + 2 * len(at), radius_m),
        counts=np.array([101, *[2] * len(at)], np.int32),
        parent_curve=np.array([-1, *[0] * len(at)], np.int32),
        parent_vertex=np.array([-1, *at], np.int32),
        order=np.array([0, *[1] * (branches - 1)], np.int32),
    )


def test_the_length_is_that_between_side_branches_in_any_order():
    assert measure_internode_m(ladder([0.7, 0.3, 0.5, 0.9])) == pytest.approx(0.2)


def test_opposite_leaves_leave_from_one_node():
    assert measure_internode_m(ladder([0.3, 0.31, 0.5, 0.5, 0.7, 0.71, 0.9], 0.004)) == pytest.approx(0.19)


def test_two_internodes_show_no_length():
    assert measure_internode_m(ladder([0.3, 0.5, 0.7])) is None
    assert measure_internode_m(ladder([])) is None
