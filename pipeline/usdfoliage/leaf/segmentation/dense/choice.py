"""The last choice: the leaves of a scene out of all that was proposed, and the points that show them. Our own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.files.threads import map_threaded
from usdfoliage.leaf.fit.prior import LeafPrior
from usdfoliage.leaf.photographs.outline_edges import judge_outlines, measure_outlines
from usdfoliage.leaf.points import LeafPoints
from usdfoliage.leaf.segmentation.dense.claims import claim_pixels, collect_points, complete_claims
from usdfoliage.leaf.segmentation.dense.evidence import Evidence, weigh_evidence
from usdfoliage.leaf.segmentation.dense.foliage_color import judge_colors
from usdfoliage.leaf.segmentation.dense.leafness import MedianLeaf, judge_leaves
from usdfoliage.leaf.segmentation.dense.pool import ProposalFacts, find_proposal_facts, rate_proposals
from usdfoliage.leaf.segmentation.dense.proposals import Proposals
from usdfoliage.leaf.segmentation.dense.scene import Scene, noise_with_misfit
from usdfoliage.leaf.segmentation.dense.selection import drop_twins, select_leaves
from usdfoliage.leaf.segmentation.dense.settings import DenseSegmentationSettings
from usdfoliage.leaf.segmentation.model import nonzero

WORTH_AREAS = (0.1, 1.2)  # median areas, between which a larger leaf is worth more
# Powers of the area. In the passes a whole leaf has to go before its pieces, which are as good as it is; in the end the
# probability knows pieces for themselves, and small leaves shall not be lost to larger wrong ones.
IN_PASSES = 0.5
IN_THE_END = 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class ProposalPool:
    """Everything that the passes proposed, and what they learned of the scene."""

    proposals: Proposals
    scene: Scene
    median_leaf: MedianLeaf
    prior: LeafPrior


@dataclass(frozen=True, kw_only=True, eq=False)
class ClaimedPoints:
    """The points of the leaves that enough pixels show."""

    points: LeafPoints  # of the leaves kept
    labels: Sequence[NDArray[np.int32]]  # (H, W) of each view, 0 for none, k for the leaf k - 1 of those kept
    kept: NDArray[np.intp]  # numbers of the leaves


def choose_leaves(
    pool: ProposalPool, settings: DenseSegmentationSettings, threads: int
) -> tuple[LeafPoints, dict[str, int]]:
    """The leaves that are the most probable and share no surface, each with its probability; what went, by reason."""
    scene = pool.scene
    facts, evidence = measure_pool(pool, settings, threads)
    probability = rate_proposals(facts)
    sure = probability > settings.min_confidence
    worth = rate_worth(probability * sure, evidence, pool.median_leaf, IN_THE_END)
    chosen = select_leaves(evidence, worth, surface_apart(scene, pool.median_leaf), settings.shared)
    chosen = chosen[drop_twins(pool.proposals.leaves.take(chosen), probability[chosen], settings.twins)]
    claimed = claim_points(scene, pool.proposals.take(chosen), pool.median_leaf, settings, threads)
    dropped = {
        "rejected by the views in the end": int(np.count_nonzero(~sure)),
        "of a leaf that another shows better": int(np.count_nonzero(sure)) - len(chosen),
        "shown by too few pixels": len(chosen) - len(claimed.kept),
    }
    points = replace(
        claimed.points,
        confidence=probability[chosen[claimed.kept]],
        view=scene.numbers[claimed.points.view].astype(np.int32),
        point_view=scene.numbers[claimed.points.point_view].astype(np.int32),
    )
    return points, nonzero(dropped)


def rate_worth(
    quality: NDArray[np.float64], evidence: Evidence, median_leaf: MedianLeaf, power: float
) -> NDArray[np.float64]:
    """(N,), what leaves are chosen by: of those as good the larger goes first, so a whole leaf before its pieces.

    Args:
        power: Of the area that is seen, in median areas.
    """
    seen = np.clip(evidence.area_m2 * evidence.on / median_leaf.area_m2, *WORTH_AREAS)
    return np.asarray(quality * np.power(seen, power))


def measure_pool(
    pool: ProposalPool, settings: DenseSegmentationSettings, threads: int
) -> tuple[ProposalFacts, Evidence]:
    """What all proposals of a pool are rated by, and what the views show of them."""
    scene, leaves = pool.scene, pool.proposals.leaves
    evidence = weigh_proposals(scene, pool.proposals, settings, threads)
    cameras = [view.camera for view in scene.views]
    edges = measure_outlines(leaves, cameras, scene.edges, settings.outlines, threads=threads)
    whole = replace(pool.proposals, explained=np.ones(len(leaves)))
    outlined = judge_outlines(edges, settings.outlines)
    by_shape = judge_leaves(whole, evidence, pool.median_leaf, 1.0, outlined)
    color = judge_colors(
        scene.colors, scene.views, scene.depths_m, evidence, scene.tolerance_m + 1e-12, by_shape, threads=threads
    )  # fmt: skip
    return find_proposal_facts(pool.proposals, evidence, edges, color, pool.median_leaf, pool.prior), evidence


def weigh_proposals(scene: Scene, proposals: Proposals, settings: DenseSegmentationSettings, threads: int) -> Evidence:
    """What the views of a scene show of proposals."""
    noise_m = noise_with_misfit(scene, settings.evidence.footprints, settings.evidence.noises)
    return weigh_evidence(proposals.leaves, scene.views, scene.depths_m, noise_m, settings.evidence, threads=threads)


def surface_apart(scene: Scene, median_leaf: MedianLeaf) -> float:
    """Metres between surfaces that are not the same."""
    return max(scene.tolerance_m, 0.04 * median_leaf.length_m)


def claim_points(
    scene: Scene, proposals: Proposals, median_leaf: MedianLeaf, settings: DenseSegmentationSettings, threads: int
) -> ClaimedPoints:
    """Give each leaf the pixels that show it; leaves with too few of them get none."""
    labels = claim_pixels(
        proposals.leaves, scene.views, scene.depths_m, scene.noise_m, settings.claims, threads=threads
    )  # fmt: skip
    reach_px = settings.reach * median_leaf.length_m / scene.footprint_m if scene.footprint_m else 0.0
    labels = tuple(
        map_threaded(
            lambda pair: complete_claims(pair[0], pair[1].labels, reach_px),
            zip(labels, scene.patches, strict=True),
            threads=threads,
        )
    )
    pixels = sum(np.bincount(label.ravel(), minlength=len(proposals) + 1) for label in labels)
    enough = np.asarray(pixels)[1:] > settings.patches.min_px
    number = np.concatenate([[0], np.cumsum(enough) * enough]).astype(np.int32)
    labels = tuple(number[label] for label in labels)
    points = collect_points(
        scene.views, scene.depths_m, labels, int(enough.sum()), settings=settings.points, noise_m=scene.noise_m,
        planes=scene.planes, threads=threads,
    )  # fmt: skip
    return ClaimedPoints(points=points, labels=labels, kept=np.flatnonzero(enough))
