"""Importance: many neighbours run parallel to a point of a line, few to one of a blob."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.branch.growth.importance import ImportanceSettings, weigh_points

from tests.support.branch_clouds import line


def weigh_by_hand(points_m: np.ndarray, reach_m: float, min_cosine: float) -> list[int]:
    principal = []
    for point_m in points_m:
        near_m = points_m[np.linalg.norm(points_m - point_m, axis=1) <= reach_m]
        principal.append(np.linalg.svd(near_m - near_m.mean(axis=0))[2][0])
    away_m = np.linalg.norm(points_m[:, None] - points_m, axis=2)
    parallel = np.abs(np.array(principal) @ np.transpose(principal)) > min_cosine
    return ((away_m <= reach_m) & parallel & ~np.eye(len(points_m), dtype=bool)).sum(axis=1).tolist()


@examples(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), reach_m=st.floats(0.2, 1.5))
def test_weights_are_those_of_equation_8(seed, reach_m):
    points_m = np.random.default_rng(seed).normal(size=(40, 3)) * [0.2, 1, 0.3]
    weight = weigh_points(points_m, reach_m / 0.6, ImportanceSettings(neighbors=39))
    close = np.isclose(np.linalg.norm(points_m[:, None] - points_m, axis=2), reach_m, rtol=1e-9).any()
    assert close or weight.tolist() == weigh_by_hand(points_m, reach_m, 0.9)


def test_every_neighbor_along_a_line_counts():
    weight = weigh_points(line([0, 0, 0], [0, 1, 0], 101), 0.1, ImportanceSettings(reach_internodes=0.55))
    assert weight[10:-10].tolist() == [10] * 81  # five to each side
    assert weight[[0, -1]].tolist() == [5, 5]


def test_a_line_weighs_more_than_a_blob_as_dense():
    rng = np.random.default_rng(0)
    stem_m = line([0, 0, 0], [0, 2, 0], 400) + 0.002 * rng.normal(size=(400, 3))
    blob_m = np.add([1, 1, 0], rng.uniform(-0.05, 0.05, (400, 3)))
    weight = weigh_points(np.concatenate([stem_m, blob_m]), 0.05)
    assert weight[:400].mean() > 1.5 * weight[400:].mean()


@given(far_m=st.floats(-1000, 1000), scale=st.floats(0.01, 100), seed=st.integers(0, 2**32 - 1))
@examples(max_examples=20)
def test_weights_turn_and_grow_with_the_plant(far_m, scale, seed):
    rng = np.random.default_rng(seed)
    points_m = rng.normal(size=(100, 3)) * [0.1, 1, 0.1]
    turn, order = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.permutation(100)
    moved = weigh_points((scale * points_m @ turn + far_m)[order], scale * 0.7)
    assert (moved == weigh_points(points_m, 0.7)[order]).mean() > 0.9


@pytest.mark.parametrize(("count", "weight"), [(1, [0]), (2, [1, 1]), (3, [2, 2, 2])])
def test_few_points_weigh_what_there_is(count, weight):
    assert weigh_points(line([0, 0, 0], [0, 0.01, 0], 3)[:count], 0.1).tolist() == weight


def test_points_out_of_reach_weigh_nothing():
    assert weigh_points(line([0, 0, 0], [0, 50, 0], 50), 0.1).tolist() == [0] * 50


@pytest.mark.parametrize("change", [{"reach_internodes": 0}, {"min_cosine": 1.1}, {"neighbors": 2}])
def test_settings_outside_their_ranges_are_refused(change):
    with pytest.raises(ValueError, match="reach above 0, cosine in"):
        ImportanceSettings(**change)
