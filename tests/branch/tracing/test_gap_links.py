"""Links across gaps: between points with none in the ball between them, wherever the nearest ones are."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from usdfoliage.branch.tracing.cloud_graph import link_points
from usdfoliage.branch.tracing.gap_links import link_across_gaps

from tests.support.branch_clouds import rings


def linked(points_m: np.ndarray, max_points: int = 20_000) -> set[tuple[int, int]]:
    return {tuple(sorted(pair)) for pair in link_across_gaps(points_m, cKDTree(points_m), max_points).tolist()}


@examples(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(5, 60))
def test_all_pairs_with_an_empty_ball_between_them_are_linked_and_no_others(seed, count):
    points_m = np.random.default_rng(seed).normal(size=(count, 3))
    middle_m = 0.5 * (points_m[:, None] + points_m)
    away_m = cdist(middle_m.reshape(-1, 3), points_m).reshape(count, count, count)
    for point in range(count):  # both ends of a link lie on the ball
        away_m[point, :, point] = away_m[:, point, point] = np.inf
    empty = away_m.min(axis=2) > 0.5 * cdist(points_m, points_m)
    one, other = np.nonzero(np.triu(empty, 1))
    assert linked(points_m) == set(zip(one.tolist(), other.tolist(), strict=True))


def test_cheapest_paths_by_squares_of_lengths_use_no_other_links():
    points_m = np.random.default_rng(2).normal(size=(40, 3))
    square = np.square(cdist(points_m, points_m))
    cheapest = square.copy()
    for through in range(40):
        cheapest = np.minimum(cheapest, cheapest[:, through, None] + cheapest[through])
    direct = np.argwhere(np.triu(cheapest >= square - 1e-12, 1))
    assert {tuple(pair) for pair in direct.tolist()} <= linked(points_m)


@pytest.mark.parametrize("max_points", [20_000, 300])
def test_a_stem_goes_on_across_a_gap_on_all_its_sides(max_points):
    stem_m = rings(0.1, np.r_[np.arange(0, 1, 0.02), np.arange(1.3, 2, 0.02)])
    points_m = stem_m + np.random.default_rng(0).normal(0, 0.001, stem_m.shape)
    upper = points_m[:, 1] > 1.15
    pairs = link_across_gaps(points_m, cKDTree(points_m), max_points)
    across = pairs[upper[pairs[:, 0]] != upper[pairs[:, 1]]]
    turn = np.arctan2(points_m[across[:, 0], 2], points_m[across[:, 0], 0])
    assert len(np.unique(np.floor(turn / (np.pi / 2)))) == 4
    bridged_m, lengths_m = (link_points(points_m).bridged_m, link_points(points_m).lengths_m)
    assert bridged_m.nnz > lengths_m.nnz
    assert (bridged_m - lengths_m).min() >= 0


@pytest.mark.parametrize("points_m", [np.eye(4, 3), np.tile([[0.0, 1, 2]], (9, 1)), np.eye(3)[[0, 1, 2] * 4]])
def test_of_few_points_and_of_points_in_a_plane_none_are_linked(points_m):
    assert not linked(points_m)


def test_links_of_many_points_are_those_across_gaps():
    lumps_m = np.random.default_rng(3).uniform(size=(2, 2500, 3)) + np.array([[[0, 0, 0]], [[1.8, 0, 0]]])
    pairs = link_across_gaps(lumps_m.reshape(-1, 3), cKDTree(lumps_m.reshape(-1, 3)), 200)
    assert len(pairs) > 4
    assert (pairs // 2500 == [0, 1]).all()


@pytest.mark.parametrize("max_points", [0, 4])
def test_links_can_be_left_out(max_points):
    assert not linked(np.random.default_rng(4).normal(size=(50, 3)), max_points)


@pytest.mark.parametrize("apart_m", [1e-3, 1e-7, 1e-9, 1e-12])
@pytest.mark.parametrize("far_m", [0.0, 10.0, 500_000.0])
def test_points_that_all_but_lie_on_each_other_end(apart_m, far_m):
    points_m = np.random.default_rng(5).uniform(0, 10, (100, 3)) + far_m
    twice_m = np.concatenate([points_m, points_m + apart_m])
    pairs = link_across_gaps(twice_m, cKDTree(twice_m), 20_000)
    assert len(pairs) > 100


def test_points_at_one_place_have_no_links():
    points_m = np.zeros((30, 3))
    assert not len(link_across_gaps(points_m, cKDTree(points_m), 10))
