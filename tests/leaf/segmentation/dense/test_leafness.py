"""What counts as a whole leaf: not stems, not leaves together, not what views look through."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.fit.prior import exchange_ends, generic_prior, learn_prior
from usdfoliage.leaf.segmentation.dense.leafness import MedianLeaf, judge_leaves, judge_likeness, measure_median_leaf
from usdfoliage.leaf.shape.measures import leaf_area, leaf_width
from usdfoliage.leaf.shape.variation import VariationSettings, vary_leaves

from tests.support.leaves.proposals import evidence_of, flat_leaves, proposed

TYPICAL = flat_leaves([(0, 0, 0)])
share = st.floats(0, 1)


def median_of(leaves) -> MedianLeaf:
    return MedianLeaf(
        length_m=float(leaves.length_m[0]),
        width_m=float(leaf_width(leaves.parameters)[0] * leaves.length_m[0]),
        area_m2=float(leaf_area(leaves.parameters)[0] * leaves.length_m[0] ** 2),
    )


def judge(leaves, median=None, weight=1.0, explained=1.0, **shares):
    return judge_leaves(
        proposed(leaves, explained), evidence_of(leaves, **shares), median or median_of(TYPICAL), weight
    )


def sized(length_m, width):
    return flat_leaves(np.zeros((len(length_m), 3)), length_m, width)


def test_a_whole_free_leaf_of_the_median_size_is_surely_one():
    assert judge(TYPICAL) == pytest.approx([1])
    leaves = sized(0.1 * np.array([0.8, 0.9, 1.1, 1.25]), 0.4)
    assert (judge(leaves) > 0.75).all()


def test_a_young_leaf_is_one_beside_grown_ones():
    slender, of_the_same_form = judge(sized([0.05, 0.04], [0.35, 0.4]))
    assert slender > 0.65
    assert of_the_same_form > 0.5


def test_stems_crumbs_and_several_leaves_together_are_none():
    stem, crumb, patch, ribbon = judge(sized([0.1, 0.02, 0.4, 0.5], [0.08, 0.4, 0.4, 0.1]))
    assert stem < 0.1
    assert crumb < 0.05
    assert patch < 0.05
    assert ribbon < 0.05


@pytest.mark.parametrize(
    "shares",
    [{"free": 0.0}, {"free": 0.0, "continued": 1.0}, {"on": 0.0}, {"violated": 1.0}, {"on": 0.0, "unseen": 1.0}],
)
def test_what_does_not_end_or_is_not_seen_is_none(shares):
    assert judge(TYPICAL, **shares) == pytest.approx([0])


def test_what_does_not_explain_its_points_is_none():
    good, poor = judge(flat_leaves([(0, 0, 0)] * 2), explained=[0.95, 0.4])
    assert good > 0.9
    assert poor == 0


@settings(max_examples=30, deadline=None)
@given(
    low=share, high=share, on=share, weight=st.floats(0, 2), name=st.sampled_from(["violated", "unseen", "continued"])
)
def test_more_against_a_leaf_never_makes_it_better(low, high, on, weight, name):
    low, high = sorted((low, high))
    leaves = flat_leaves([(0, 0, 0)] * 2)
    better, worse = judge(leaves, weight=weight, on=on, **{name: [low, high]})
    assert 0 <= worse <= better <= 1


@settings(max_examples=30, deadline=None)
@given(low=share, high=share, free=share, name=st.sampled_from(["on", "free", "explained"]))
def test_more_for_a_leaf_never_makes_it_worse(low, high, free, name):
    low, high = sorted((low, high))
    leaves = flat_leaves([(0, 0, 0)] * 2)
    worse, better = judge(leaves, **{"free": free, name: [low, high]})
    assert 0 <= worse <= better <= 1


@settings(max_examples=30, deadline=None)
@given(weights=st.tuples(st.floats(0, 2), st.floats(0, 2)), violated=share)
def test_a_larger_weight_of_violations_never_gives_a_higher_score(weights, violated):
    light, heavy = (judge(TYPICAL, weight=weight, violated=violated)[0] for weight in sorted(weights))
    assert heavy <= light


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_scale_does_not_matter(scale):
    lengths, widths = np.array([0.05, 0.1, 0.2]), [0.2, 0.4, 0.6]
    leaves, scaled = sized(lengths, widths), sized(lengths * scale, widths)
    assert judge(scaled, median_of(sized([0.1 * scale], 0.4))) == pytest.approx(judge(leaves))


def test_the_median_of_equal_leaves_is_that_leaf():
    leaves = flat_leaves(np.zeros((5, 3)))
    median = measure_median_leaf(proposed(leaves), evidence_of(leaves), np.ones(5))
    expected = median_of(TYPICAL)
    assert median.length_m == pytest.approx(expected.length_m)
    assert median.width_m == pytest.approx(expected.width_m)
    assert median.area_m2 == pytest.approx(expected.area_m2, rel=0.02)


def test_crumbs_do_not_make_the_median_leaf_small():
    leaves = sized([0.1] * 10 + [0.01] * 100, 0.4)
    median = measure_median_leaf(proposed(leaves), evidence_of(leaves), np.ones(110))
    assert median.length_m == pytest.approx(0.1)


@pytest.mark.parametrize("wrong", [{"free": 0.1}, {"on": 0.3}, {"violated": 0.6}, {"explained": 0.3}, {"trust": 0.2}])
def test_ground_does_not_make_the_median_leaf_large(wrong):
    leaves = sized([0.1] * 6 + [2.0] * 3, 0.4)
    ground = np.arange(9) >= 6
    usually = {"free": 1.0, "on": 1.0, "violated": 0.0, "explained": 1.0, "trust": 1.0}
    numbers = {name: np.where(ground, wrong.get(name, value), value) for name, value in usually.items()}
    trust, explained = numbers.pop("trust"), numbers.pop("explained")
    median = measure_median_leaf(proposed(leaves, explained), evidence_of(leaves, **numbers), trust)
    assert median.length_m == pytest.approx(0.1)


def test_where_no_leaf_is_sure_all_count():
    leaves = sized([0.1, 0.1, 0.1], 0.4)
    median = measure_median_leaf(proposed(leaves, 0.0), evidence_of(leaves, free=0.0), np.zeros(3))
    assert median.length_m == pytest.approx(0.1)


@settings(max_examples=30, deadline=None)
@given(st.permutations(range(6)))
def test_the_order_of_leaves_does_not_matter(order):
    leaves = sized([0.05, 0.08, 0.1, 0.11, 0.15, 0.3], [0.3, 0.4, 0.5, 0.3, 0.4, 0.5])
    quality, median = judge(leaves), measure_median_leaf(proposed(leaves), evidence_of(leaves), np.ones(6))
    other = leaves.take(np.array(order))
    assert judge(other) == pytest.approx(quality[order])
    assert measure_median_leaf(proposed(other), evidence_of(other), np.ones(6)) == median


def test_leaves_are_like_those_of_a_prior_with_exchanged_ends_too():
    parameters = vary_leaves(60, np.random.default_rng(0), VariationSettings())
    leaves = replace(flat_leaves(np.zeros((60, 3))), parameters=parameters)
    prior = learn_prior(proposed(leaves).numbers(), generic_prior(0.1, 0.5))
    like = judge_likeness(proposed(leaves), prior)
    turned = judge_likeness(proposed(replace(leaves, parameters=exchange_ends(parameters))), prior)
    assert turned == pytest.approx(like, abs=1e-6)
    assert np.median(like) > 0.9

    long = judge_likeness(proposed(replace(leaves, length_m=leaves.length_m * 20)), prior)
    crumpled = parameters + np.random.default_rng(1).normal(size=parameters.shape)
    assert long.max() < 0.01
    assert np.median(judge_likeness(proposed(replace(leaves, parameters=crumpled)), prior)) < 0.01
    assert len(judge_likeness(proposed(flat_leaves(np.zeros((0, 3)))), prior)) == 0
