"""Ends of thick branches: those that turn aside where a stem was cut off go straight on, others stay."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.cut_ends import straighten_cut_ends

from tests.support.branch_shapes import plant_of

UP_M = np.array([[0.0, height, 0] for height in (0, 1, 2, 2.5, 3)])
ASIDE_M = np.array([[0.1, 3.1, 0], [0.3, 3.15, 0], [0.5, 3.2, 0]])


def stem(tail_m: np.ndarray, radius_m: float = 0.25, tip_m: float = 0.1) -> Skeleton:
    points_m = np.concatenate([UP_M, tail_m])
    radii_m = np.r_[np.full(len(UP_M), radius_m), np.linspace(radius_m, tip_m, len(tail_m) + 1)[1:]]
    return plant_of((points_m, radii_m, None, None))


def with_twig(skeleton: Skeleton, vertex: int, reach_m: float) -> Skeleton:
    """And a twig sideways from a vertex of it."""
    leaves_m = skeleton.points_m[vertex]
    twig_m = leaves_m + np.array([[0, 0, 0], [0, 0, reach_m]])
    return Skeleton(
        points_m=np.concatenate([skeleton.points_m, twig_m]),
        radius_m=np.r_[skeleton.radius_m, 0.02, 0.01],
        counts=np.array([len(skeleton.points_m), 2], np.int32),
        parent_curve=np.array([-1, 0], np.int32),
        parent_vertex=np.array([-1, vertex], np.int32),
        order=np.array([0, 1], np.int32),
    )


def test_an_end_that_turns_aside_goes_straight_on_and_as_thick():
    straight = straighten_cut_ends(stem(ASIDE_M), 0.02)
    np.testing.assert_allclose(straight.points_m[:, [0, 2]], 0, atol=1e-12)
    assert straight.points_m[-1, 1] == pytest.approx(3.2)
    assert (np.diff(straight.points_m[:, 1]) > 0).all()
    np.testing.assert_array_equal(straight.radius_m, 0.25)


def test_where_the_rim_is_level_the_end_goes_on_a_little():
    straight = straighten_cut_ends(stem(np.array([[0.3, 3.0, 0], [0.5, 2.9, 0]])), 0.02)
    assert 3 < straight.points_m[-1, 1] < 3.1


def test_what_springs_from_the_end_moves_with_it():
    skeleton = with_twig(stem(ASIDE_M), 6, 0.1)
    straight = straighten_cut_ends(skeleton, 0.02)
    twig_m = straight.points_m[straight.branch(1)]
    np.testing.assert_allclose(np.diff(twig_m, axis=0), np.diff(skeleton.points_m[skeleton.branch(1)], axis=0))
    np.testing.assert_allclose(straight.points_m[straight.first[1], [0, 2]], 0, atol=1e-12)
    np.testing.assert_array_equal(straight.points_m[straight.first[1]], straight.points_m[6])


@pytest.mark.parametrize(
    "skeleton",
    [
        stem(np.array([[0.0, 3.1, 0], [0.02, 3.2, 0]])),  # straight
        stem(np.array([[0.5, 3.2, 0], [1.5, 3.4, 0], [2.5, 3.6, 0]]), tip_m=0.01),  # goes on as a limb
        stem(ASIDE_M, radius_m=0.015, tip_m=0.01),  # thin
        with_twig(stem(ASIDE_M), 7, 2.0),  # carries a branch
    ],
)
def test_other_ends_stay(skeleton):
    same = straighten_cut_ends(skeleton, 0.02)
    np.testing.assert_array_equal(same.points_m, skeleton.points_m)
    np.testing.assert_array_equal(same.radius_m, skeleton.radius_m)


def test_it_is_the_same_wherever_the_stem_stands():
    skeleton = stem(ASIDE_M)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    moved = straighten_cut_ends(replace(skeleton, points_m=skeleton.points_m @ turn + 7), 0.02)
    np.testing.assert_allclose(moved.points_m, straighten_cut_ends(skeleton, 0.02).points_m @ turn + 7, atol=1e-9)
