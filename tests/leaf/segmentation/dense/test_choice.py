"""The choice of leaves from the pool of proposals, on flat leaves that are rated as each case needs it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.points import LeafPoints, no_points
from usdfoliage.leaf.segmentation.dense import choice
from usdfoliage.leaf.segmentation.dense.choice import (
    WORTH_AREAS,
    ClaimedPoints,
    ProposalPool,
    choose_leaves,
    rate_worth,
    surface_apart,
)
from usdfoliage.leaf.segmentation.dense.leafness import MedianLeaf
from usdfoliage.leaf.segmentation.dense.proposals import Proposals
from usdfoliage.leaf.segmentation.dense.settings import DenseSegmentationSettings

from tests.support.leaves.proposals import evidence_of, flat_leaves, proposed

LENGTH_M = 0.1
VIEW = 7  # number of the only view with depth, among all views
SETTINGS = DenseSegmentationSettings()


def median_of(leaves: Leaves) -> MedianLeaf:
    """The first leaf as the median one."""
    area_m2 = float(evidence_of(leaves).area_m2[0])
    return MedianLeaf(length_m=LENGTH_M, width_m=0.4 * LENGTH_M, area_m2=area_m2)


@pytest.fixture
def choose(monkeypatch):
    """What is chosen of leaves (N,) of these probabilities, each shown by so many pixels; and what went, by reason."""

    def chosen_of(leaves: Leaves, probability, pixels=1000, **evidence):
        probability = np.asarray(probability, float)
        count_px = np.broadcast_to(pixels, len(leaves))
        order = []

        def claim(scene, proposals: Proposals, median_leaf, settings, threads) -> ClaimedPoints:
            numbers = [int(np.argmin(np.abs(leaves.base_m - base).sum(axis=1))) for base in proposals.leaves.base_m]
            kept = np.flatnonzero(count_px[numbers] > settings.patches.min_px) if numbers else np.zeros(0, np.intp)
            order.extend(np.array(numbers, int)[kept].tolist())
            count = len(kept)
            points = LeafPoints(
                points_m=np.zeros((count, 3)),
                normals=np.zeros((count, 3)),
                kind=np.zeros(count, np.uint8),
                point_view=np.zeros(count, np.int32),
                offsets=np.arange(count + 1),
                confidence=np.zeros(count),
                view=np.zeros(count, np.int32),
            )
            return ClaimedPoints(points=points if count else no_points(), labels=(), kept=kept)

        monkeypatch.setattr(choice, "measure_pool", lambda *arguments: (None, evidence_of(leaves, **evidence)))
        monkeypatch.setattr(choice, "rate_proposals", lambda facts: probability)
        monkeypatch.setattr(choice, "claim_points", claim)
        pool = ProposalPool(
            proposals=proposed(leaves),
            scene=SimpleNamespace(tolerance_m=0.002, numbers=np.array([VIEW])),
            median_leaf=median_of(flat_leaves([(0, 0, 0)], LENGTH_M)),
            prior=SimpleNamespace(),
        )
        points, dropped = choose_leaves(pool, SETTINGS, 1)
        return order, points, dropped

    return chosen_of


def test_what_is_not_probable_enough_is_rejected(choose):
    leaves = flat_leaves([(0, 0, 0), (0.3, 0, 0), (0.6, 0, 0)], LENGTH_M)
    order, points, dropped = choose(leaves, [0.9, SETTINGS.min_confidence, SETTINGS.min_confidence + 0.01])
    assert order == [0, 2]
    assert points.confidence.tolist() == pytest.approx([0.9, SETTINGS.min_confidence + 0.01])
    assert points.view.tolist() == points.point_view.tolist() == [VIEW, VIEW]
    assert dropped == {"rejected by the views in the end": 1}


@pytest.mark.parametrize("better", [0, 1])
def test_of_proposals_of_one_leaf_the_surest_is_chosen(choose, better):
    leaves = flat_leaves([(0, 0, 0), (0.001, 0.001, 0.001), (0.3, 0, 0)], LENGTH_M)
    probability = np.array([0.8, 0.8, 0.7])
    probability[better] = 0.9
    order, points, dropped = choose(leaves, probability)
    assert order == [better, 2]
    assert points.confidence.tolist() == pytest.approx([0.9, 0.7])
    assert dropped == {"of a leaf that another shows better": 1}


def test_a_whole_leaf_goes_before_its_half_though_that_is_somewhat_surer(choose):
    leaves = flat_leaves([(0, 0, 0), (0.0, 0.001, 0.0)], [LENGTH_M, LENGTH_M / 2], [0.4, 0.8])
    order, points, _ = choose(leaves, [0.8, 0.95])
    assert order == [0]
    assert points.confidence.tolist() == pytest.approx([0.8])


def test_leaves_that_cross_or_lie_above_each_other_are_all_chosen(choose):
    leaves = flat_leaves([(0, 0, 0), (0, 0, 0.02), (0, 0, 0.04)], LENGTH_M)
    order, _, dropped = choose(leaves, [0.7, 0.9, 0.8])
    assert order == [1, 2, 0]  # the most probable first
    assert dropped == {}


def test_what_too_few_pixels_show_goes_and_the_others_keep_their_probability(choose):
    leaves = flat_leaves([(0, 0, 0), (0.3, 0, 0), (0.6, 0, 0)], LENGTH_M)
    order, points, dropped = choose(leaves, [0.7, 0.9, 0.8], [1000, SETTINGS.patches.min_px, 1000])
    assert order == [2, 0]
    assert points.confidence.tolist() == pytest.approx([0.8, 0.7])
    assert dropped == {"shown by too few pixels": 1}


def test_of_no_proposals_and_of_wrong_ones_alone_none_is_chosen(choose):
    none = flat_leaves(np.zeros((0, 3)))
    assert choose(none, [])[2] == {}
    order, points, dropped = choose(flat_leaves([(0, 0, 0)], LENGTH_M), [0.1])
    assert (order, len(points)) == ([], 0)
    assert dropped == {"rejected by the views in the end": 1}


@settings(deadline=None, max_examples=20)
@given(scale=st.floats(0.1, 10), quality=st.floats(0.1, 1), power=st.floats(0, 1))
def test_worth_grows_with_a_power_of_the_area_that_is_seen_within_bounds(scale, quality, power):
    leaves = flat_leaves([(0, 0, 0)] * 4, scale * LENGTH_M * np.array([1, 0.5, 0.01, 10]))
    evidence = evidence_of(leaves, on=np.array([1.0, 1.0, 1.0, 1.0]))
    median = replace(median_of(leaves), area_m2=float(evidence.area_m2[0]))
    low, high = WORTH_AREAS
    expected = quality * np.power([1, 0.25, low, high], power)
    assert rate_worth(np.full(4, quality), evidence, median, power) == pytest.approx(expected, rel=1e-6)
    half = rate_worth(np.full(4, quality), replace(evidence, on=np.full(4, 0.5)), median, power)
    assert half[0] == pytest.approx(quality * 0.5**power, rel=1e-6)


@pytest.mark.parametrize(("tolerance_m", "apart_m"), [(0.01, 0.01), (0.001, 0.004)])
def test_surfaces_are_apart_beyond_the_noise_and_a_small_part_of_a_leaf(tolerance_m, apart_m):
    scene = SimpleNamespace(tolerance_m=tolerance_m)
    median = MedianLeaf(length_m=LENGTH_M, width_m=0.04, area_m2=0.003)
    assert surface_apart(scene, median) == pytest.approx(apart_m)
