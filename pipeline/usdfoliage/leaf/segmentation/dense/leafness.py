"""How much a proposal is like a whole leaf: by its size and by what the views show of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.fit.prior import LeafPrior
from usdfoliage.leaf.segmentation.dense.evidence import Evidence
from usdfoliage.leaf.segmentation.dense.proposals import Proposals
from usdfoliage.leaf.shape.measures import leaf_width

TRUSTED_UNSEEN = 0.8  # of what no depth shows, the share that a right outline makes up for
TRUSTED_THROUGH = 0.5  # of what depth looks through, the share that a right outline makes up for
ENOUGH = 100  # leaves that show how different leaves of a set are
# Deviations of the logarithm of a length from the median leaf's: young leaves stand beside grown ones everywhere, but
# what is much longer than the median leaf, which half of the leaf area lies above, is several leaves.
SHORTER = 0.9
LONGER = 0.5
WHOLE_AREA = 0.12  # median areas, from which on the area does not count against a leaf


@dataclass(frozen=True, kw_only=True)
class MedianLeaf:
    """Sizes that half of the leaf area of a scene lies below."""

    length_m: float
    width_m: float
    area_m2: float


def measure_median_leaf(proposals: Proposals, evidence: Evidence, trust: NDArray[np.float64]) -> MedianLeaf:
    """The median leaf of those that stand free, are seen whole and explain their points; of all, where none does.

    Args:
        trust: (N,), 0 to 1, what else is known; leaves below a half do not count.
    """
    area = evidence.area_m2
    sure = (evidence.free > 0.55) & (evidence.on > 0.8) & (evidence.violated < 0.1)
    sure &= (proposals.explained > 0.85) & (trust > 0.5)
    if not sure.any():
        sure = np.ones(len(proposals), bool)
    lengths = proposals.leaves.length_m
    widths = leaf_width(proposals.leaves.parameters) * lengths

    def weighted_median(values: NDArray[np.float64]) -> float:
        order = np.argsort(values[sure], kind="stable")
        rising = np.cumsum(area[sure][order])
        return float(values[sure][order][np.searchsorted(rising, rising[-1] / 2)])

    return MedianLeaf(length_m=weighted_median(lengths), width_m=weighted_median(widths), area_m2=weighted_median(area))


def judge_leaves(
    proposals: Proposals,
    evidence: Evidence,
    median_leaf: MedianLeaf,
    violation_weight: float,
    outlined: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """(N,), 0 to 1: whether each is one whole leaf, by its size, its free silhouette and what sees through it.

    An outline that lies on edges of the photographs is as good as one at which depth jumps, since depth often has a
    hole there. Where depth is missing below such an outline, the leaf counts as seen for the most part, and depth that
    looks through it counts half: it may be wrong.

    Args:
        violation_weight: Of the share of a leaf that views look through.
        outlined: (N,), 0 to 1, whether the outlines lie on edges of photographs; None where that is not known.
    """
    edges = np.zeros(len(proposals)) if outlined is None else outlined
    lengths = proposals.leaves.length_m / median_leaf.length_m
    # A small leaf is not as narrow as a stem of its width: widths are compared with those that go with the lengths.
    widths = leaf_width(proposals.leaves.parameters) * proposals.leaves.length_m / median_leaf.width_m
    widths = widths / np.sqrt(lengths)
    areas = evidence.area_m2 / median_leaf.area_m2
    ends = np.maximum(np.clip((evidence.free - 0.7 * evidence.continued) / 0.35, 0, 1), edges)
    # Stems are narrow; what is much too wide or long is several leaves, or ground.
    wide = np.clip((widths - 0.25) / 0.3, 0, 1) * np.exp(-0.5 * np.square(np.log(np.maximum(widths, 1)) / 0.5))
    long = np.exp(-0.5 * np.square(np.log(lengths) / np.where(lengths < 1, SHORTER, LONGER)))
    through = violation_weight * evidence.violated * (1 - TRUSTED_THROUGH * edges)
    unseen = evidence.unseen * (TRUSTED_UNSEEN * edges - 0.2)
    seen = np.clip(evidence.on - through + unseen, 0, 1)
    explained = np.clip((proposals.explained - 0.5) / 0.4, 0, 1)
    return np.asarray(ends * wide * long * seen * explained * np.clip(areas / WHOLE_AREA, 0, 1))


def prior_distance(numbers: NDArray[np.float64], prior: LeafPrior) -> NDArray[np.float64]:
    """(N,), squared distance of leaves (N, 22) from a prior, in its deviations and in its nearest version."""
    means, precisions = prior.versions()
    offsets = numbers - means[:, None]
    return np.asarray(np.einsum("gni,gij,gnj->gn", offsets, precisions, offsets, optimize=True).min(axis=0))


def judge_likeness(proposals: Proposals, prior: LeafPrior) -> NDArray[np.float64]:
    """(N,), 0 to 1: whether each is like the leaves that a prior was learned of, in one of its versions."""
    distance = prior_distance(proposals.numbers(), prior)
    # Of 22 numbers of a normal distribution the sum of squares is below 34 in 95 of 100; what was learned is wide.
    # Few leaves do not show how different leaves may be.
    learned_share = min(1.0, prior.learned / ENOUGH)
    return np.asarray(np.exp(-learned_share * np.maximum(distance - 14.0, 0) / 10.0))
