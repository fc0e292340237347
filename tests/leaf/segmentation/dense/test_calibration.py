"""The weights by which proposals are rated make probability the share that is right, on beds whose truth is known.

The weights were learned of other captures (tools/calibrate_confidence.py). Of this bed's proposals depth looks through
few and continues beside few, and all are of one size: the weights of these facts hardly count here.
"""

from dataclasses import fields

import numpy as np
import pytest
from usdfoliage.leaf.segmentation.dense.choice import measure_pool
from usdfoliage.leaf.segmentation.dense.pool import OFFSET, WEIGHTS, ProposalFacts, rate_proposals
from usdfoliage.leaf.segmentation.dense.segment import propose_in_passes
from usdfoliage.leaf.segmentation.dense.settings import DenseSegmentationSettings

from tests.support.leaves.captures import known_foliage
from tools.bench.leaf_truth import nearest_distances
from tools.calibrate_confidence import RIGHT_PROPOSAL, calibration_error, ranking

LARGEST_ERROR = 0.06  # measured: 0.047


@pytest.fixture(scope="module")
def rated() -> tuple[ProposalFacts, np.ndarray]:
    """The facts of all proposals of a bed, with exact and with noisy depth, and which of them are right."""
    bed, settings = known_foliage(), DenseSegmentationSettings()
    facts, right = [], []
    for views in (bed.views, bed.noisy_views):
        pool = propose_in_passes(views, range(len(views)), settings, lambda: None, 0).pool
        assert pool is not None
        facts.append(measure_pool(pool, settings, 0)[0])
        right.append(nearest_distances(bed.truth, pool.proposals.leaves) <= RIGHT_PROPOSAL)
    joined = {each.name: np.concatenate([getattr(one, each.name) for one in facts]) for each in fields(ProposalFacts)}
    return ProposalFacts(**joined), np.concatenate(right)


def error_of(rated: tuple[ProposalFacts, np.ndarray], offset: float = OFFSET, **changed: float) -> float:
    facts, right = rated
    return calibration_error(rate_proposals(facts, offset, {**WEIGHTS, **changed}), right)


def test_of_leaves_as_probable_as_that_so_many_are_right(rated):
    facts, right = rated
    assert len(right) > 300
    assert 0.2 < right.mean() < 0.95
    assert error_of(rated) < LARGEST_ERROR
    assert ranking(rate_proposals(facts), right) > 0.98


@pytest.mark.parametrize("name", ["on", "free", "explained", "color", "area", "agreeing"])
def test_with_half_a_weight_it_does_not_hold(rated, name):
    assert error_of(rated, **{name: 0.5 * WEIGHTS[name]}) > LARGEST_ERROR


@pytest.mark.parametrize(("offset", "edges"), [(-1.0, 1.0), (0.0, 0.0)])
def test_nor_with_another_offset_or_without_the_edges_of_photographs(rated, offset, edges):
    assert error_of(rated, OFFSET + offset, edges=edges * WEIGHTS["edges"]) > LARGEST_ERROR
