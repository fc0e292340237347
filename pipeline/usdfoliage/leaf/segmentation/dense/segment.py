"""Leaves as hypotheses that all views judge: the method dense.

Depth is made coherent across views and cut into patches of one surface where it jumps. To each patch, and to those of
other views that show the same, a leaf is fitted; every view is asked whether it sees that leaf, sees through it, and
sees it end where its silhouette is. What is most like a whole leaf claims its pixels first, is fitted again to all of
them, and leaves the rest to the next pass, which also tries neighbouring pieces as one leaf. What size, form and colour
leaves have is learned from the surest ones of the scene. Everything that was proposed stays in a pool, from which the
leaves of the scene are chosen in the end. Our own idea; where it is like section 4 of the paper is that the most
visible leaves come first and help to find the others.
"""

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.files.threads import map_threaded
from usdfoliage.leaf.fit.prior import LeafPrior, generic_prior, learn_prior
from usdfoliage.leaf.photographs.outline_edges import judge_outlines, measure_outlines
from usdfoliage.leaf.points import LeafPoints, no_points
from usdfoliage.leaf.segmentation.dense.choice import (
    IN_PASSES,
    ProposalPool,
    choose_leaves,
    claim_points,
    rate_worth,
    surface_apart,
    weigh_proposals,
)
from usdfoliage.leaf.segmentation.dense.evidence import Evidence
from usdfoliage.leaf.segmentation.dense.foliage_color import judge_colors
from usdfoliage.leaf.segmentation.dense.fragments import append_points, join_points, pair_fragments
from usdfoliage.leaf.segmentation.dense.leafness import MedianLeaf, judge_leaves, judge_likeness, measure_median_leaf
from usdfoliage.leaf.segmentation.dense.median_length import (
    free_share,
    gather_measure,
)
from usdfoliage.leaf.segmentation.dense.overlap import Overlaps, group_patches
from usdfoliage.leaf.segmentation.dense.patches import (
    Patches,
)
from usdfoliage.leaf.segmentation.dense.pool import join_pool
from usdfoliage.leaf.segmentation.dense.proposals import Proposals, join_proposals, propose_leaves, refit_proposals
from usdfoliage.leaf.segmentation.dense.scene import (
    Scene,
    expect_length,
    fill_scene_rims,
    find_within,
    may_be_leaves,
    measure_length,
    measure_scene,
    overlap_patches,
    points_of_parts,
    points_of_patches,
)
from usdfoliage.leaf.segmentation.dense.selection import drop_twins, select_leaves
from usdfoliage.leaf.segmentation.dense.settings import DenseSegmentationSettings, PassSettings
from usdfoliage.leaf.segmentation.model import Candidates, Segmentation, Step, find_nothing, nonzero
from usdfoliage.progress import PartCounter, Progress

PatchKey = tuple[int, int, int]  # view; how many pixels, and the sum of their indices

ASSUMED_WIDTH = 0.5  # in lengths, before any leaf was seen
SIZE_SPREAD = 2.0  # factor by which patches that show a leaf differ from the median size


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pass:
    """What a pass has found."""

    proposals: Proposals
    points: LeafPoints
    labels: Sequence[NDArray[np.int32]]
    prior: LeafPrior
    median_leaf: MedianLeaf
    quality: NDArray[np.float64]  # of all proposals that were tried
    dropped: dict[str, int]  # how many of them went, by reason


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposed:
    """What all passes have proposed."""

    candidates: Sequence[Candidates]
    passes: Sequence[Step]
    pool: ProposalPool | None  # None where no patch may be a leaf


def segment_dense(
    views: Sequence[View],
    settings: DenseSegmentationSettings = DenseSegmentationSettings(),
    progress: Progress | None = None,
    *,
    threads: int = 0,
) -> Segmentation:
    """Find the leaves of a scene.

    Args:
        views: Of one world; those without depth are not used.
        settings: How.
        progress: Called with the steps done and their number.
        threads: At most so many, 0 for one per core; the result is the same.
    """
    used = [index for index, view in enumerate(views) if view.has_depth]
    if not used:
        return find_nothing(views)
    counter = PartCounter(progress, 2 * len(used) + 7)
    proposed = propose_in_passes(views, used, settings, counter.add, threads)
    candidates, passes = proposed.candidates, proposed.passes
    if proposed.pool is None:
        return Segmentation(candidates=candidates, leaves=no_points(), passes=passes)
    leaves, dropped = choose_leaves(proposed.pool, settings, threads)
    passes = [*passes, Step(name="proposals of all passes", count=len(proposed.pool.proposals))]
    counter.add()
    return Segmentation(candidates=candidates, leaves=leaves, dropped=dropped, passes=passes)


def propose_in_passes(
    views: Sequence[View],
    used: Sequence[int],
    settings: DenseSegmentationSettings,
    step: Callable[[], None],
    threads: int,
) -> Proposed:
    """All leaves that may be there, as proposals; step is called twice for each view used, and six times more."""
    scene = measure_scene(views, used, settings, step, threads)

    overlaps = overlap_patches(scene, settings, threads)
    step()
    median_m = measure_length(scene, overlaps, settings, threads)
    large = median_m >= settings.large_px * scene.footprint_m > 0
    if large:
        scene = fill_scene_rims(scene, settings, threads)
        overlaps = overlap_patches(scene, settings, threads)
        median_m = measure_length(scene, overlaps, settings, threads)
    patches = scene.patches
    scene = expect_length(replace(scene, large=large), median_m, settings)
    candidates = _candidates(views, used, patches, median_m)
    groups = _choose_groups(patches, overlaps, median_m, settings)
    count, grouped = len(overlaps.view), sum(map(len, groups))
    small = {"too small, too large or without a free edge": count - grouped, "of one that another view shows": grouped}
    small["of one that another view shows"] -= len(groups)
    passes = [Step(name="candidates like a leaf", count=len(groups), dropped=nonzero(small))]
    if not groups:
        return Proposed(candidates=candidates, passes=passes, pool=None)
    group_of = np.zeros(len(overlaps.view), np.int64)
    for number, group in enumerate(groups, start=1):
        group_of[group] = number
    points = points_of_patches(scene, patches, group_of, len(groups), threads)
    points = append_points(points, points_of_parts(scene, median_m, settings, threads))
    proposals = propose_leaves(points, median_m, ASSUMED_WIDTH, scene.tolerance_m, threads=threads)
    step()

    state = _settle(scene, proposals, None, None, settings.first, settings, threads=threads)
    parts = [proposals, state.proposals]
    passes.append(_describe(state, "first"))
    step()
    named = {"second": settings.second, "third": settings.third, "last": settings.last}
    hopeless: set[PatchKey] = set()
    for name, passing in named.items():
        found = len(state.proposals)
        proposals, pairs, keys = _propose_more(scene, state, settings, hopeless, threads)
        if not len(proposals):
            break
        # The first fits give the size, and the second the form, that the next are judged by.
        median_leaf = state.median_leaf if name == "second" else None
        prior = None if name == "second" else state.prior
        scene = expect_length(scene, state.median_leaf.length_m, settings)
        state = _settle(scene, proposals, median_leaf, prior, passing, settings, pairs=pairs, threads=threads)
        parts += [proposals.take(np.arange(found, len(proposals))), state.proposals]
        unlike = state.quality[found : found + len(keys)] < settings.hopeless * passing.min_quality
        hopeless |= {key for key, failed in zip(keys, unlike, strict=True) if failed}
        passes.append(_describe(state, name))
        step()
    pool = ProposalPool(proposals=join_pool(parts), scene=scene, median_leaf=state.median_leaf, prior=state.prior)
    return Proposed(candidates=candidates, passes=passes, pool=pool)


def _choose_groups(
    patches: Sequence[Patches], overlaps: Overlaps, median_m: float, settings: DenseSegmentationSettings
) -> list[NDArray[np.int64]]:
    plausible = may_be_leaves(patches, median_m, 0.08, settings)
    stability = np.where(overlaps.views_seen > 0, overlaps.stability, 0.5)
    size = np.minimum(gather_measure(patches, "area_m2") / median_m**2, 0.5)
    return group_patches(overlaps, plausible * free_share(patches) * size * (stability + 0.01))


def _propose_more(
    scene: Scene, state: _Pass, settings: DenseSegmentationSettings, hopeless: Set[PatchKey], threads: int
) -> tuple[Proposals, NDArray[np.int64], list[PatchKey]]:
    """What was found, leaves of patches nobody claims, and pieces as one leaf.

    Pairs (K, 2) are the leaves that the last ones are of, keys the patches of those before. The hopeless patches
    are not tried again.
    """
    median_m = state.median_leaf.length_m

    def segment_again(number: int) -> Patches:
        # Claims end a pixel early or late; their rims are not leaves.
        rest = cv2.erode((state.labels[number] == 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        return find_within(scene, number, rest, settings)

    patches = list(map_threaded(segment_again, range(len(scene.views)), threads=threads))
    keys = [(view, *key) for view, one in enumerate(patches) for key in one.pixel_keys()]
    plausible = may_be_leaves(patches, median_m, 0.05, settings)
    plausible &= np.array([key not in hopeless for key in keys], bool)
    number = np.where(plausible, np.cumsum(plausible), 0)
    rest_points = points_of_patches(scene, patches, number, int(plausible.sum()), threads)
    pairs = pair_fragments(state.proposals, state.points, median_m)
    points = append_points(rest_points, join_points(state.points, pairs))
    width = state.median_leaf.width_m / median_m
    more = propose_leaves(points, median_m, width, scene.tolerance_m, threads=threads)
    return join_proposals(state.proposals, more), pairs, [keys[index] for index in np.flatnonzero(plausible)]


def _near_expected(median_leaf: MedianLeaf, expected_m: float, settings: DenseSegmentationSettings) -> MedianLeaf:
    """The median leaf, not far from what was expected: what is measured of few leaves drifts to pieces, or stems."""
    length_m = float(np.clip(median_leaf.length_m, expected_m / settings.shorter, expected_m * settings.longer))
    scale = length_m / median_leaf.length_m
    width_m = max(median_leaf.width_m * scale, settings.slender * length_m)
    return MedianLeaf(
        length_m=length_m, width_m=width_m, area_m2=median_leaf.area_m2 * scale * width_m / median_leaf.width_m
    )


def _judge(
    scene: Scene,
    proposals: Proposals,
    evidence: Evidence,
    median_leaf: MedianLeaf | None,
    prior: LeafPrior | None,
    violation_weight: float,
    settings: DenseSegmentationSettings,
    threads: int,
) -> tuple[NDArray[np.float64], MedianLeaf]:
    """(N,), 0 to 1, of each proposal, and the median leaf, measured where it is not known."""
    everything = np.ones(len(proposals))
    cameras = [view.camera for view in scene.views]
    edges = measure_outlines(proposals.leaves, cameras, scene.edges, settings.outlines, threads=threads)
    outlined = judge_outlines(edges, settings.outlines)
    first = median_leaf or measure_median_leaf(proposals, evidence, everything)
    by_shape = judge_leaves(proposals, evidence, first, violation_weight, outlined)
    by_color = judge_colors(
        scene.colors, scene.views, scene.depths_m, evidence, scene.tolerance_m + 1e-12, by_shape, threads=threads
    )  # fmt: skip
    if median_leaf is None:
        median_leaf = _near_expected(measure_median_leaf(proposals, evidence, by_color), scene.median_m, settings)
        by_shape = judge_leaves(proposals, evidence, median_leaf, violation_weight, outlined)
    likeness = judge_likeness(proposals, prior) if prior else everything
    return by_shape * by_color * likeness, median_leaf


def _settle(
    scene: Scene,
    proposals: Proposals,
    median_leaf: MedianLeaf | None,
    prior: LeafPrior | None,
    passing: PassSettings,
    settings: DenseSegmentationSettings,
    *,
    pairs: NDArray[np.int64] | None = None,
    threads: int,
) -> _Pass:
    """Keep the best proposals, give them the pixels that show them, and fit them to these."""
    dropped = dict[str, int]()
    evidence = weigh_proposals(scene, proposals, settings, threads)
    quality, median_leaf = _judge(
        scene, proposals, evidence, median_leaf, prior, passing.violation_weight, settings, threads
    )
    good = quality > passing.min_quality
    dropped["unlike a leaf"] = int(np.count_nonzero(~good))
    worth = rate_worth(quality, evidence, median_leaf, IN_PASSES) * good
    if pairs is not None and len(pairs):
        _favour_joined(proposals, quality, worth, pairs, passing.min_quality, median_leaf, settings)
    kept = select_leaves(evidence, worth, surface_apart(scene, median_leaf), passing.max_overlap)
    kept = kept[drop_twins(proposals.leaves.take(kept), worth[kept], settings.twins)]
    dropped["of a leaf that another shows better"] = int(np.count_nonzero(good)) - len(kept)
    proposals = proposals.take(kept)

    claimed = claim_points(scene, proposals, median_leaf, settings, threads)
    dropped["shown by too few pixels"] = len(proposals) - len(claimed.kept)
    proposals, points, labels = proposals.take(claimed.kept), claimed.points, claimed.labels
    generic = generic_prior(median_leaf.length_m, median_leaf.width_m / median_leaf.length_m)
    if not len(proposals):
        return _Pass(
            proposals=proposals, points=points, labels=labels, prior=prior or generic,
            median_leaf=median_leaf, quality=quality, dropped=nonzero(dropped),
        )  # fmt: skip
    evidence = weigh_proposals(scene, proposals, settings, threads)
    trust, _ = _judge(
        scene,
        replace(proposals, explained=np.ones(len(proposals))),
        evidence,
        median_leaf,
        None,
        1.0,
        settings,
        threads,
    )
    teachers = np.argsort(-trust * evidence.on, kind="stable")[: max(20, len(proposals) // 2)]
    prior = learn_prior(proposals.numbers()[teachers], generic)
    proposals = refit_proposals(points, proposals, prior, scene.tolerance_m, threads=threads)
    return _Pass(
        proposals=proposals,
        points=points,
        labels=labels,
        prior=prior,
        median_leaf=median_leaf,
        quality=quality,
        dropped=nonzero(dropped),
    )


def _favour_joined(
    proposals: Proposals,
    quality: NDArray[np.float64],
    worth: NDArray[np.float64],
    pairs: NDArray[np.int64],
    min_quality: float,
    median_leaf: MedianLeaf,
    settings: DenseSegmentationSettings,
) -> None:
    """Two pieces that make one good leaf go after it: half a leaf is often the better leaf by itself."""
    lengths = proposals.leaves.length_m
    begin = len(proposals) - len(pairs)
    for number, (first, second) in enumerate(pairs, start=begin):
        needed = max(settings.joined_quality * min(quality[first], quality[second]), min_quality)
        longer = 1.02 * max(lengths[first], lengths[second]) < lengths[number] < 1.6 * median_leaf.length_m
        if quality[number] > needed and proposals.explained[number] > 0.9 and longer:
            worth[number] = max(worth[number], 1.02 * max(worth[first], worth[second]))


def _candidates(
    views: Sequence[View], used: Sequence[int], patches: Sequence[Patches], median_m: float
) -> list[Candidates]:
    """The patches of each view, for the report: how full of itself each is, and how far of the median size."""
    found = dict(zip(used, patches, strict=True))
    candidates = []
    for index, view in enumerate(views):
        if index in found:
            one = found[index]
            size = np.sqrt(np.maximum(one.length_m * one.width_m, 1e-30) / (median_m**2 * ASSUMED_WIDTH))
            like = np.exp(-0.5 * np.square(np.log(size) / np.log(SIZE_SPREAD)))
            candidates.append(Candidates(labels=one.labels, confidence=np.clip(one.fill, 0, 1) * like))
        else:
            nothing = np.zeros((view.camera.height_px, view.camera.width_px), np.int32)
            candidates.append(Candidates(labels=nothing, confidence=np.zeros(0)))
    return candidates


def _describe(state: _Pass, name: str) -> Step:
    return Step(
        name=f"leaves after the {name} pass",
        count=len(state.proposals),
        dropped=state.dropped,
        tried=len(state.quality),
    )
