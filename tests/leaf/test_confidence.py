"""Confidence is the share of leaves that are right: it rises with what speaks for a leaf, and is calibrated."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.confidence import OFFSET, WEIGHTS, ConfidenceFacts, find_facts, rate_leaves

from tests.support.leaves.captures import known_foliage
from tools.calibrate_confidence import calibration_error, learn_weights, ranking


def facts_of(**changed: float) -> ConfidenceFacts:
    return ConfidenceFacts(**{name: np.array([changed.get(name, 0.0)]) for name in WEIGHTS})


def test_the_odds_are_the_weighed_sum_of_the_facts():
    odds = rate_leaves(facts_of(score=1.0, free=0.5)) / (1 - rate_leaves(facts_of(score=1.0, free=0.5)))
    assert np.log(odds) == pytest.approx(OFFSET + WEIGHTS["score"] + 0.5 * WEIGHTS["free"])


@settings(deadline=None)
@given(name=st.sampled_from(sorted(WEIGHTS)), value=st.floats(0, 1), more=st.floats(0.01, 1))
def test_what_speaks_for_a_leaf_raises_its_confidence(name, value, more):
    less, higher = (rate_leaves(facts_of(**{name: each}))[0] for each in (value, value + more))
    assert (higher > less) == (name not in ("violated", "residual"))


@pytest.fixture(scope="module")
def bed():
    return known_foliage()


def test_true_leaves_are_sure_and_those_moved_aside_are_not(bed):
    leaves = replace(bed.leaves, residual_m=0.01 * bed.leaves.length_m)
    aside = replace(leaves, base_m=leaves.base_m + 0.7 * leaves.length_m[:, None] * np.array([1.0, 0.0, 0.0]))
    score = np.full(len(leaves), 0.5)
    right, wrong = (rate_leaves(find_facts(each, score, bed.views)) for each in (leaves, aside))

    visible = bed.visible > 0.6
    assert np.median(right[visible]) > 0.9
    assert np.median(wrong[visible]) < 0.5
    assert ranking(np.concatenate([right[visible], wrong[visible]]), np.repeat([True, False], visible.sum())) > 0.9


def test_leaves_without_residuals_are_refused(bed):
    with pytest.raises(ValueError, match="residuals"):
        find_facts(replace(bed.leaves, residual_m=None), np.ones(len(bed.leaves)), bed.views)


def test_learned_weights_make_confidence_the_share_that_is_right():
    rng = np.random.default_rng(4)
    facts = ConfidenceFacts(**{name: rng.normal(size=4000) for name in WEIGHTS})
    probability = rate_leaves(facts, 0.3, dict.fromkeys(WEIGHTS, 0.8))
    right = rng.random(4000) < probability
    offset, weights = learn_weights([facts], right, tuple(WEIGHTS))
    learned = rate_leaves(facts, offset, weights)

    assert calibration_error(learned, right) < 0.04
    assert np.abs(learned - probability).mean() < 0.03


def test_the_calibration_error_is_known_for_constant_confidence():
    right = np.arange(100) < 70
    assert calibration_error(np.full(100, 0.9), right) == pytest.approx(0.2)
    assert ranking(np.linspace(1, 0, 100), right) == 1
    assert np.isnan(ranking(np.ones(3), np.ones(3, bool)))
