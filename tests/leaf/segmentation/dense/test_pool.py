"""The pool of proposals: how each is rated, how many agree with it, and which leaves are chosen of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.fit.prior import exchange_ends, generic_prior, learn_prior
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.segmentation.dense.choice import ProposalPool, choose_leaves, measure_pool
from usdfoliage.leaf.segmentation.dense.leafness import measure_median_leaf, prior_distance
from usdfoliage.leaf.segmentation.dense.pool import (
    AGREE,
    OFFSET,
    WEIGHTS,
    ProposalFacts,
    count_agreeing,
    join_pool,
    rate_proposals,
)
from usdfoliage.leaf.segmentation.dense.scene import expect_length, measure_scene
from usdfoliage.leaf.segmentation.dense.settings import DenseSegmentationSettings
from usdfoliage.leaf.shape.measures import leaf_width

from tests.support.leaves.captures import known_foliage
from tests.support.leaves.proposals import evidence_of, flat_leaves, proposed
from tools.calibrate_confidence import PROPOSAL_FACTS, calibration_error, learn_weights, ranking

LENGTH_M = 0.1
CHOSEN = DenseSegmentationSettings()


def facts_of(**changed: float) -> ProposalFacts:
    values = {**dict.fromkeys(WEIGHTS, 0.0), "slenderness": 1.0, **changed}
    return ProposalFacts(**{name: np.array([value]) for name, value in values.items()})


def facts_of_widths(slenderness: list[float]) -> ProposalFacts:
    """Leaves as sure as can be, of these widths over length in the median leaf's."""
    count = len(slenderness)
    facts = {**dict.fromkeys(WEIGHTS, np.zeros(count)), "on": np.full(count, 20.0), "area": np.ones(count)}
    return ProposalFacts(**facts, slenderness=np.array(slenderness))


def moved(leaves: Leaves, turn: Rotation, scale: float, shift) -> Leaves:
    return replace(
        leaves,
        base_m=scale * turn.apply(leaves.base_m) + shift,
        orientation=(turn * Rotation.from_quat(leaves.orientation)).as_quat(),
        length_m=scale * leaves.length_m,
    )


def test_the_odds_are_the_weighed_sum_of_the_facts():
    rated = rate_proposals(facts_of(on=0.5, edges=2.0))[0]
    assert np.log(rated / (1 - rated)) == pytest.approx(OFFSET + 0.5 * WEIGHTS["on"] + 2 * WEIGHTS["edges"])
    assert {*WEIGHTS, "slenderness"} == set(ProposalFacts.__dataclass_fields__)


@pytest.mark.parametrize("name", ["on", "edges", "color", "agreeing", "explained"])
def test_what_speaks_for_a_leaf_raises_its_probability(name):
    assert rate_proposals(facts_of(**{name: 0.8})) > rate_proposals(facts_of(**{name: 0.2}))


@pytest.mark.parametrize("name", ["violated", "unlike", "continued"])
def test_what_speaks_against_a_leaf_lowers_it(name):
    assert rate_proposals(facts_of(**{name: 0.8})) < rate_proposals(facts_of(**{name: 0.2}))


def test_what_is_as_narrow_as_a_stem_is_no_leaf_however_sure_it_is():
    rated = rate_proposals(facts_of_widths([1.0, 1.2, 1.1, 1.0, 1.0, 1.0, 0.7, 0.6, 0.5, 0.2]))
    assert rated == pytest.approx([1, 1, 1, 1, 1, 1, 1, 0.5, 0, 0], abs=1e-6)


def test_narrow_leaves_are_leaves_among_narrow_ones():
    # the leaves of a willow, and its twigs
    rated = rate_proposals(facts_of_widths([0.3, 0.33, 0.3, 0.3, 0.05, 0.1]))
    assert rated == pytest.approx([1, 1, 1, 1, 0, 0], abs=1e-6)


def test_the_slenderness_of_a_proposal_is_in_that_of_the_median_leaf(pool):
    made, _, _ = pool
    facts, _ = measure_pool(made, CHOSEN, 0)
    leaves, median = made.proposals.leaves, made.median_leaf
    expected = leaf_width(leaves.parameters) / (median.width_m / median.length_m)
    assert facts.slenderness == pytest.approx(expected)


def test_leaves_agree_as_far_as_they_are_near():
    aside_m = AGREE * LENGTH_M
    leaves = flat_leaves([(0, 0, 0), (0, 0, aside_m), (1, 0, 0)], LENGTH_M)
    once = np.exp(-0.5)
    assert count_agreeing(leaves, LENGTH_M) == pytest.approx([once, once, 0])


def test_copies_do_not_agree():
    leaves = flat_leaves([(0, 0, 0), (0, 0, 0), (0, 0, 0.001)], LENGTH_M)
    assert count_agreeing(leaves, LENGTH_M).tolist() == [0, 0, 0]


def test_the_same_leaf_from_its_other_end_agrees():
    leaves = flat_leaves([(0, 0, 0), (0, LENGTH_M, 0.02 * LENGTH_M)], LENGTH_M)
    half_turn = Rotation.from_euler("z", 180, degrees=True).as_quat()
    turned = replace(
        leaves,
        parameters=np.concatenate([leaves.parameters[:1], exchange_ends(leaves.parameters[1:])]),
        orientation=np.array([[0.0, 0, 0, 1], half_turn]),
    )
    assert count_agreeing(turned, LENGTH_M) == pytest.approx(2 * [np.exp(-0.5 * (0.02 / AGREE) ** 2)], rel=1e-6)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 1000), scale=st.floats(0.1, 10), far=st.floats(-5, 5))
def test_agreement_does_not_depend_on_the_frame_or_the_order(seed, scale, far):
    rng = np.random.default_rng(seed)
    leaves = flat_leaves(rng.uniform(-0.02, 0.02, (12, 3)), LENGTH_M * rng.uniform(0.8, 1.2, 12))
    turn = Rotation.from_rotvec(rng.normal(size=3))
    order = rng.permutation(12)
    here = count_agreeing(leaves, LENGTH_M)
    there = count_agreeing(moved(leaves, turn, scale, far), scale * LENGTH_M)
    assert there == pytest.approx(here, abs=1e-6)
    assert count_agreeing(leaves.take(order), LENGTH_M) == pytest.approx(here[order])


@pytest.mark.parametrize("count", [0, 1])
def test_few_leaves_have_none_to_agree_with(count):
    assert count_agreeing(flat_leaves(np.zeros((count, 3))), LENGTH_M).tolist() == [0] * count


def test_a_pool_holds_the_proposals_of_all_passes_in_their_order():
    parts = [proposed(flat_leaves([(x, 0, 0)]), 0.1 * x) for x in (1.0, 2.0, 3.0)]
    pool = join_pool(parts)
    assert pool.leaves.base_m[:, 0].tolist() == [1, 2, 3]
    assert pool.explained == pytest.approx([0.1, 0.2, 0.3])


@pytest.fixture(scope="module")
def pool():
    """The true leaves of a bed, slightly moved in two ways, and each moved far aside."""
    bed = known_foliage()
    scene = measure_scene(bed.noisy_views, range(len(bed.noisy_views)), CHOSEN, lambda: None, 0)
    x, z = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    shifts = [0.02 * x, -0.02 * z, 0.35 * x, -0.4 * x]
    parts = [
        proposed(replace(bed.leaves, base_m=bed.leaves.base_m + bed.leaves.length_m[:, None] * shift), 0.9)
        for shift in shifts
    ]
    proposals = join_pool(parts)
    everything = np.ones(len(proposals))
    median = measure_median_leaf(proposals, evidence_of(proposals.leaves), everything)
    generic = generic_prior(median.length_m, median.width_m / median.length_m)
    prior = learn_prior(parts[0].numbers(), generic)
    made = ProposalPool(
        proposals=proposals, scene=expect_length(scene, median.length_m, CHOSEN), median_leaf=median, prior=prior
    )
    visible = np.tile(bed.visible > 0.6, len(shifts))
    return made, visible, np.repeat([True, True, False, False], len(bed.leaves))


def test_leaves_in_their_place_are_more_probable_than_those_aside(pool):
    made, visible, right = pool
    facts, _ = measure_pool(made, CHOSEN, 0)
    assert ranking(rate_proposals(facts)[visible], right[visible]) > 0.9


def test_of_every_leaf_one_proposal_is_chosen(pool):
    made, visible, right = pool
    points, dropped = choose_leaves(made, CHOSEN, 0)
    count = len(right) // 4
    well_seen = int(visible[:count].sum())

    assert 0.8 * well_seen <= len(points) <= count
    assert sum(dropped.values()) + len(points) == len(right)
    assert ((points.confidence > CHOSEN.min_confidence) & (points.confidence <= 1)).all()


def test_the_distance_from_a_prior_is_none_at_its_mean_in_any_version():
    prior = generic_prior(LENGTH_M, 0.4)
    means, _ = prior.versions()
    assert prior_distance(means, prior) == pytest.approx(np.zeros(4), abs=1e-9)


def test_learned_weights_make_probability_the_share_that_is_right():
    rng = np.random.default_rng(4)
    drawn = {name: rng.normal(size=4000) for name in PROPOSAL_FACTS}
    facts = ProposalFacts(**drawn, slenderness=np.ones(4000))
    probability = rate_proposals(facts, 0.3, dict.fromkeys(PROPOSAL_FACTS, 0.5))
    right = rng.random(4000) < probability
    learned = rate_proposals(facts, *learn_weights([facts], right, PROPOSAL_FACTS))
    assert calibration_error(learned, right) < 0.04
    assert np.abs(learned - probability).mean() < 0.04


def test_the_calibration_error_is_known_for_constant_probability():
    right = np.arange(100) < 70
    assert calibration_error(np.full(100, 0.9), right) == pytest.approx(0.2)
    assert ranking(np.linspace(1, 0, 100), right) == 1
    assert np.isnan(ranking(np.ones(3), np.ones(3, bool)))
