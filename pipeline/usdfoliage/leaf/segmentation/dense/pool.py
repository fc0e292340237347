"""All leaves that were proposed, and how probable each of them is: what the last choice is made from.

A pass fits the leaves that it keeps again, and a leaf that was right before may be wrong after it, or give way to a
neighbour. So every proposal stays in a pool, and the leaves of the scene are chosen from the pool. A proposal is rated
by what depth and photographs show of it, by how like the other leaves of the scene it is, and by how many other
proposals agree with it: a real leaf is proposed again and again, from several views, patches and passes. The weights
were learned where the truth is known. Our own.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import expit

from usdfoliage.leaf.fit.prior import LeafPrior
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.segmentation.dense.evidence import Evidence
from usdfoliage.leaf.segmentation.dense.leafness import MedianLeaf, prior_distance
from usdfoliage.leaf.segmentation.dense.proposals import Proposals, join_proposals
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

# Of each fact in the logarithm of the odds. Learned of the proposals of generated beds and plants, with exact, noisy
# and estimated depth, by tools/calibrate_confidence.py --fit.
OFFSET = -15.483
WEIGHTS: Mapping[str, float] = {
    "on": 3.763,
    "violated": -4.397,
    "free": 2.443,
    "continued": -2.644,
    "edges": 0.594,
    "edges_unseen": -0.883,
    "explained": 6.153,
    "color": 4.895,
    "unlike": -0.744,
    "length_off": 1.228,
    "width": 1.063,
    "width_off": -0.522,
    "area": 1.65,
    "agreeing": 1.327,
}

# Width over length, in that of the scene's leaves: what is below the first is a stem, or a strip between two edges,
# however well all views confirm it; from the second on it may be a leaf.
NARROW = (0.5, 0.7)
AROUND = 0.15  # median leaf lengths between the middles of proposals that may agree
AGREE = 0.08  # median leaf lengths of mean distance, at which two proposals agree to 1/sqrt(e)
SAME = 0.012  # the same below which one proposal is but a copy of the other
_COLUMNS, _ROWS = 5, 7  # places of a leaf at which proposals are compared
_LARGE = 1.5  # median areas, from which on a leaf counts as large as that


@dataclass(frozen=True, kw_only=True, eq=False)
class ProposalFacts:
    """What N proposals are rated by."""

    on: NDArray[np.float64]  # (N,), share of the area that depth confirms
    violated: NDArray[np.float64]  # (N,), share that depth looks through
    free: NDArray[np.float64]  # (N,), share of the silhouette where depth ends with the leaf
    continued: NDArray[np.float64]  # (N,), share where it goes on
    edges: NDArray[np.float64]  # (N,), by how much edges of photographs under the outline exceed the typical change
    edges_unseen: NDArray[np.float64]  # (N,), the same times the share of the area that no depth shows
    explained: NDArray[np.float64]  # (N,), share of the points that each was fitted to that lie on it
    color: NDArray[np.float64]  # (N,), 0 to 1, whether it has the colours of leaves
    unlike: NDArray[np.float64]  # (N,), logarithm of its distance from the leaves that the prior was learned of
    length_off: NDArray[np.float64]  # (N,), square of the logarithm of its length, in median lengths
    width: NDArray[np.float64]  # (N,), logarithm of its width, in median widths
    width_off: NDArray[np.float64]  # (N,), square of that
    area: NDArray[np.float64]  # (N,), in median areas, 1.5 at most
    agreeing: NDArray[np.float64]  # (N,), logarithm of one more than the number of proposals that agree with it
    slenderness: NDArray[np.float64]  # (N,), width over length, in that of the median leaf


def join_pool(parts: list[Proposals]) -> Proposals:
    """The proposals of all passes, one after the other; at least one pass."""
    pool = parts[0]
    for part in parts[1:]:
        pool = join_proposals(pool, part)
    return pool


def find_proposal_facts(
    pool: Proposals,
    evidence: Evidence,
    edges: NDArray[np.float64],
    color: NDArray[np.float64],
    median_leaf: MedianLeaf,
    prior: LeafPrior,
) -> ProposalFacts:
    """What is known of each of N proposals.

    Args:
        pool: All of them, since they are compared with each other.
        evidence: Of the depth of all views.
        edges: (N,), as measure_outlines gives it.
        color: (N,), as judge_colors gives it.
        median_leaf: Of the scene.
        prior: Learned of the scene.
    """
    length = np.log(pool.leaves.length_m / median_leaf.length_m)
    width = np.log(leaf_width(pool.leaves.parameters) * pool.leaves.length_m / median_leaf.width_m)
    return ProposalFacts(
        on=evidence.on,
        violated=evidence.violated,
        free=evidence.free,
        continued=evidence.continued,
        edges=edges,
        edges_unseen=edges * evidence.unseen,
        explained=pool.explained,
        color=color,
        unlike=np.log1p(prior_distance(pool.numbers(), prior) / 14),
        length_off=np.square(length),
        width=width,
        width_off=np.square(width),
        area=np.minimum(evidence.area_m2 / median_leaf.area_m2, _LARGE),
        agreeing=np.log1p(count_agreeing(pool.leaves, median_leaf.length_m)),
        slenderness=np.exp(width - length),
    )


def rate_proposals(
    facts: ProposalFacts, offset: float = OFFSET, weights: Mapping[str, float] = WEIGHTS
) -> NDArray[np.float64]:
    """(N,), 0 to 1: the probability that each proposal is a leaf as it is; 0 where it is as narrow as a stem."""
    odds = np.full(len(facts.on), offset)
    for name, weight in weights.items():
        odds += weight * getattr(facts, name)
    probability = np.asarray(expit(odds))
    return probability * _wide_enough(facts, probability)


def _wide_enough(facts: ProposalFacts, probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,), 0 to 1: 0 for what is too narrow for a leaf of the scene.

    The median leaf is never narrower than the settings give. Where leaves are, as those of a willow, half of the area
    that is likely to be leaves lies in proposals that are narrower than it: these are the measure then.
    """
    weights = probability * facts.area
    order = np.argsort(facts.slenderness, kind="stable")
    rising = np.cumsum(weights[order])
    typical = 1.0
    if len(order) and rising[-1] > 0:
        typical = min(1.0, float(facts.slenderness[order][np.searchsorted(rising, rising[-1] / 2)]))
    narrowest, narrow = NARROW[0] * typical, NARROW[1] * typical
    return np.asarray(np.clip((facts.slenderness - narrowest) / (narrow - narrowest), 0, 1))


def count_agreeing(leaves: Leaves, median_m: float) -> NDArray[np.float64]:
    """(N,), how many of the other leaves agree with each; one that is nearly the same counts as nearly one.

    Copies of a leaf do not agree with it: they are no second opinion.

    Args:
        leaves: N, in one frame.
        median_m: Length of the median leaf.
    """
    count = np.zeros(len(leaves))
    if len(leaves) < 2:
        return count
    places = grid_places(np.linspace(-1, 1, _COLUMNS), np.linspace(0, 1, _ROWS))
    surfaces = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf())
    surfaces = surfaces.reshape(len(leaves), _ROWS, _COLUMNS, 3)
    pairs = cKDTree(surfaces.mean(axis=(1, 2))).query_pairs(AROUND * median_m, output_type="ndarray")
    first, second = surfaces[pairs[:, 0]], surfaces[pairs[:, 1]]
    # Base and apex, left and right may be exchanged between fits of the same leaf.
    distances = [
        np.linalg.norm(first - second[:, ::along, ::across], axis=-1).mean(axis=(1, 2))
        for along in (1, -1)
        for across in (1, -1)
    ]
    apart = np.min(distances, axis=0) / median_m if len(pairs) else np.zeros(0)
    agree = np.exp(-0.5 * np.square(apart / AGREE)) * (apart > SAME)
    for side in (0, 1):
        count += np.bincount(pairs[:, side], agree, minlength=len(leaves))
    return count
