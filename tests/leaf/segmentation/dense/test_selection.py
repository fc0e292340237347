"""Which proposals are kept: the better of copies, both of leaves that only touch, whatever their order."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.segmentation.dense.selection import PARALLEL, REACH, drop_twins, select_leaves

from tests.support.leaves.proposals import evidence_of, flat_leaves

TOLERANCE_M = 0.004  # between surfaces that are the same, of leaves 0.1 m long


def scattered(count: int, seed: int, spread_m: float = 0.08) -> Leaves:
    """Leaves so near each other that many cover others in part."""
    rng = np.random.default_rng(seed)
    bases = rng.uniform(-spread_m, spread_m, (count, 3)) * (1, 1, 0.1)
    turns = Rotation.from_rotvec(rng.normal(size=(count, 3)) * (0.1, 0.1, 1.0)).as_quat()
    lengths = 0.1 * rng.uniform(0.6, 1.4, count)
    return replace(flat_leaves(bases, lengths, rng.uniform(0.2, 0.5, count)), orientation=turns)


def covers(evidence, better, other):
    """(K,), probes of the other leaf that the better one covers, without any search tree."""
    ours, theirs = evidence.points_m[better], evidence.points_m[other]
    apart = np.linalg.norm(theirs[:, None] - ours[None], axis=2)
    nearest = apart.argmin(axis=1)
    normal = evidence.normals[better][nearest]
    across = np.abs(np.sum((theirs - ours[nearest]) * normal, axis=1))
    along = np.sqrt(np.maximum(apart.min(axis=1) ** 2 - across**2, 0))
    reach = REACH * np.sqrt(evidence.areas_m2[better].sum() / len(ours))
    parallel = np.abs(np.sum(evidence.normals[other] * normal, axis=1)) > PARALLEL
    return (across < TOLERANCE_M) & (along < reach) & parallel


def select_slowly(evidence, score, max_overlap):
    count = len(score)
    covered = np.zeros(evidence.seen.shape, bool)
    kept, left = [], [i for i in range(count) if score[i] > 0]
    while left:
        area = evidence.areas_m2 * evidence.seen
        overlap = (area * covered).sum(axis=1) / area.sum(axis=1)
        left = [i for i in left if overlap[i] <= max_overlap]
        if not left:
            break
        best = max(left, key=lambda i: score[i] * (1 - overlap[i]))
        kept.append(best)
        left.remove(best)
        for other in range(count):
            covered[other] |= covers(evidence, best, other)
    return kept


@pytest.mark.parametrize("better", [0, 1])
def test_of_two_copies_the_better_is_kept(better):
    leaves = flat_leaves([(0, 0, 0), (0.001, 0.001, 0.001)])
    score = np.array([0.5, 0.5])
    score[better] = 0.6
    assert select_leaves(evidence_of(leaves), score, TOLERANCE_M, 0.5).tolist() == [better]
    assert drop_twins(leaves, score, 0.1).tolist() == [better == 0, better == 1]


def test_leaves_apart_are_all_kept_the_best_first():
    leaves = flat_leaves([(0, 0, 0), (0.2, 0, 0), (0, 0.3, 0)])
    score = np.array([0.2, 0.9, 0.5])
    assert select_leaves(evidence_of(leaves), score, TOLERANCE_M, 0.1).tolist() == [1, 2, 0]
    assert drop_twins(leaves, score, 0.1).all()


def test_leaves_above_each_other_and_leaves_that_cross_are_all_kept():
    upright = Rotation.from_euler("y", 90, degrees=True).as_quat()
    above = flat_leaves([(0, 0, 0), (0, 0, 4 * TOLERANCE_M)])
    crossing = replace(flat_leaves([(0, 0, 0), (0, 0, 0)]), orientation=np.array([[0.0, 0, 0, 1], upright]))
    for leaves in (above, crossing):
        assert len(select_leaves(evidence_of(leaves), np.array([0.9, 0.8]), TOLERANCE_M, 0.3)) == 2


def test_a_leaf_and_its_half():
    leaves = flat_leaves([(0, 0, 0), (0, 0, 0)], [0.1, 0.05], [0.4, 0.8])
    whole_first = select_leaves(evidence_of(leaves), np.array([0.9, 0.8]), TOLERANCE_M, 0.5)
    half_first = select_leaves(evidence_of(leaves), np.array([0.8, 0.9]), TOLERANCE_M, 0.9)
    assert whole_first.tolist() == [0]  # which covers the half wholly
    assert half_first.tolist() == [1, 0]  # which covers about half of the whole


def test_what_nobody_sees_of_a_leaf_may_be_covered():
    leaves = flat_leaves([(0, 0, 0), (0, 0.05, 0)], 0.1)  # the apex of one lies on the base of the other
    evidence = evidence_of(leaves)
    near = evidence.points_m[1, :, 1] < 0.1
    assert 0.2 < near.mean() < 0.8
    score = np.array([0.9, 0.8])
    only_far = replace(evidence, seen=np.stack([evidence.seen[0], ~near]))
    only_near = replace(evidence, seen=np.stack([evidence.seen[0], near]))
    assert len(select_leaves(only_far, score, TOLERANCE_M, 0.5)) == 2
    assert select_leaves(only_near, score, TOLERANCE_M, 0.5).tolist() == [0]


def test_what_is_worth_nothing_is_not_kept():
    leaves = flat_leaves([(0, 0, 0), (0.5, 0, 0)])
    assert select_leaves(evidence_of(leaves), np.array([0.0, 0.3]), TOLERANCE_M, 0.5).tolist() == [1]
    assert len(select_leaves(evidence_of(leaves), np.zeros(2), TOLERANCE_M, 0.5)) == 0


def test_no_leaves_and_one():
    none, one = flat_leaves(np.zeros((0, 3))), flat_leaves([(0, 0, 0)])
    assert len(select_leaves(evidence_of(none), np.zeros(0), TOLERANCE_M, 0.5)) == 0
    assert drop_twins(none, np.zeros(0), 0.1).shape == (0,)
    assert select_leaves(evidence_of(one), np.ones(1), TOLERANCE_M, 0.5).tolist() == [0]
    assert drop_twins(one, np.zeros(1), 0.1).tolist() == [True]


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 12), max_overlap=st.sampled_from([0.2, 0.5, 0.9]))
def test_the_same_as_the_plain_method(seed, count, max_overlap):
    leaves = scattered(count, seed)
    evidence, score = evidence_of(leaves), np.random.default_rng(seed + 1).random(count)
    kept = select_leaves(evidence, score, TOLERANCE_M, max_overlap)
    assert kept.tolist() == select_slowly(evidence, score, max_overlap)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(2, 20), scale=st.sampled_from([0.125, 1.0, 8.0]))
def test_neither_order_nor_scale_matters(seed, count, scale):
    leaves = scattered(count, seed)
    rng = np.random.default_rng(seed + 1)
    score, order = rng.random(count), rng.permutation(count)
    other = replace(leaves, base_m=leaves.base_m * scale, length_m=leaves.length_m * scale).take(order)
    kept = select_leaves(evidence_of(leaves), score, TOLERANCE_M, 0.5)
    again = select_leaves(evidence_of(other), score[order], TOLERANCE_M * scale, 0.5)
    assert order[again].tolist() == kept.tolist()
    assert np.array_equal(drop_twins(leaves, score, 0.15)[order], drop_twins(other, score[order], 0.15))


def test_a_leaf_between_twins_goes_and_leaves_the_one_behind():
    leaves = flat_leaves([(0, 0, 0), (0, 0, 0.007), (0, 0, 0.014)])
    assert drop_twins(leaves, np.array([0.9, 0.8, 0.7]), 0.1).tolist() == [True, False, True]
    assert drop_twins(leaves, np.array([0.7, 0.9, 0.8]), 0.1).tolist() == [False, True, False]
