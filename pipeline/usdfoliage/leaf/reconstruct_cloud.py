"""The main job on a cloud alone: points in, leaves with their colours out. No photograph is needed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.fit.flip import flip_leaves
from usdfoliage.leaf.fit.silhouette_order import order_silhouettes
from usdfoliage.leaf.fit.surface import SurfaceFitSettings, fit_leaves_to_surface
from usdfoliage.leaf.fit.wood_ends import find_wood_ends
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.reconstruct import choose_sound
from usdfoliage.leaf.segmentation.cloud.segment import CloudSegmentation, segment_cloud
from usdfoliage.leaf.segmentation.cloud.settings import CloudSegmentationSettings
from usdfoliage.leaf.segmentation.model import Step
from usdfoliage.progress import StepProgress, follow_step
from usdfoliage.remarks import Remark, remark

CLOUD_STEPS = ("segmentation", "fit", "direction", "colours")
LOOSE = 0.15  # share of points in no surface, from which a cloud is full of noise
FEW = 30  # points of the median leaf, below which leaves are hardly shown


@dataclass(frozen=True, kw_only=True)
class CloudReconstructionSettings:
    """How the leaves of a cloud are found and fitted."""

    segmentation: CloudSegmentationSettings = field(default_factory=CloudSegmentationSettings)
    fit: SurfaceFitSettings = field(default_factory=lambda: SurfaceFitSettings(min_points=10))


@dataclass(frozen=True, kw_only=True, eq=False)
class CloudReconstruction:
    """The leaves of a cloud, and how they were found."""

    leaves: Leaves  # M, in the frame of the points, with confidence, residual_m, origin and, of a coloured cloud, color
    leaf: NDArray[np.int32]  # (N,), which of them each point is of, -1 for none
    certainty: NDArray[np.float64]  # (M,), that its base is not its apex: 0.5 nothing is known to 1
    segmentation: CloudSegmentation
    steps: Sequence[Step]
    remarks: Sequence[Remark]  # what whoever uses the leaves should know
    seconds: Mapping[str, float]  # by step


def reconstruct_cloud_leaves(
    points_m: NDArray[np.float64],
    colors: NDArray[np.float64] | None = None,
    settings: CloudReconstructionSettings = CloudReconstructionSettings(),
    progress: StepProgress | None = None,
    *,
    min_confidence: float = 0.0,
    threads: int = 0,
) -> CloudReconstruction:
    """Find single leaves in a cloud and fit the 21 parameters of each.

    That there are none is a result: a reconstruction of no leaves.

    Args:
        points_m: (N, 3), metres, finite, in any order and axes.
        colors: (N, 3), linear Rec.709, NaN where a point has none; None where none has.
        settings: How.
        progress: Called at each step.
        min_confidence: Leaves of less are dropped.
        threads: At most so many, 0 for one per core; the result is the same.

    Raises:
        ValueError: An array is not of this shape.
    """
    if colors is not None and colors.shape != points_m.shape:
        raise ValueError(f"colors must be {points_m.shape}, not {colors.shape}")
    seconds: dict[str, float] = {}
    step = partial(follow_step, seconds=seconds, progress=progress)
    with step("segmentation") as report:
        segmentation = segment_cloud(points_m, settings.segmentation, report, threads=threads)
    with step("fit") as report:
        fitted = fit_leaves_to_surface(segmentation.leaves, settings.fit, threads=threads, progress=report)
    with step("direction"):
        ends = find_wood_ends(fitted.leaves, points_m[segmentation.leaf < 0], threads=threads)
        leaves = order_silhouettes(flip_leaves(fitted.leaves, ends.flip))
        # How similar to a leaf the points are counts for more than how near its surface comes to them.
        leaves = replace(leaves, confidence=segmentation.leaves.confidence[fitted.source])
        sound, dropped = choose_sound(leaves, min_confidence)
        leaves = leaves.take(sound)
        leaf = _renumber(segmentation.leaf, fitted.source[sound], len(segmentation.leaves))
    with step("colours"):
        if colors is not None and len(leaves):
            leaves = replace(leaves, color=median_colors(colors, leaf, len(leaves)))
    return CloudReconstruction(
        leaves=leaves,
        leaf=leaf,
        certainty=ends.certainty[sound],
        segmentation=segmentation,
        steps=[
            Step(name="regions of the cloud", count=segmentation.regions),
            Step(name="leaves of the cloud", count=len(segmentation.leaves), dropped=segmentation.dropped),
            Step(name="fitted leaves", count=len(fitted.leaves), dropped=fitted.dropped),
            Step(name="kept leaves", count=len(leaves), dropped=dropped),
        ],
        remarks=describe_cloud_leaves(leaves, leaf, segmentation),
        seconds=seconds,
    )


def median_colors(colors: NDArray[np.float64], leaf: NDArray[np.int32], count: int) -> NDArray[np.float64] | None:
    """The median colour (count, 3) of the points of each leaf; that of all leaves where its points have none.

    Args:
        colors: (N, 3), linear Rec.709, NaN where a point has none.
        leaf: (N,), which leaf each point is of, -1 for none.
        count: Of leaves.
    """
    known = np.isfinite(colors).all(axis=1) & (leaf >= 0)
    if not known.any():
        return None
    order = np.argsort(leaf[known], kind="stable")
    ends = np.searchsorted(leaf[known][order], np.arange(count + 1))
    ordered = colors[known][order]
    median = np.full((count, 3), np.nan)
    for number in range(count):
        own = ordered[ends[number] : ends[number + 1]]
        if len(own):
            median[number] = np.median(own, axis=0)
    return np.asarray(np.where(np.isnan(median), np.nanmedian(median, axis=0), median))


def describe_cloud_leaves(
    leaves: Leaves, leaf: NDArray[np.int32], segmentation: CloudSegmentation
) -> tuple[Remark, ...]:
    """What whoever uses the leaves of a cloud should know."""
    remarks = []
    if segmentation.thinned_m > 0:
        text = (
            f"leaves are looked for in one point a cell of {1000 * segmentation.thinned_m:.2g} mm; the points are "
            "denser than their noise, or too many"
        )
        remarks.append(remark("leaves-in-thinned-cloud", text))
    if segmentation.loose > LOOSE:
        text = f"{100 * segmentation.loose:.0f} % of the points lie in no surface; leaves that they hide are not found"
        remarks.append(remark("cloud-noisy", text, remedy="filter the scan, or scan again from nearer"))
    if not len(leaves):
        text = f"no leaf was found, of {segmentation.regions:,} regions of the cloud"
        remedy = "leaves need some 30 points each, in smooth surfaces"
        return (*remarks, remark("no-leaf-in-cloud", text, remedy=remedy))
    points = float(np.median(np.bincount(leaf[leaf >= 0], minlength=len(leaves))))
    if points < FEW:
        text = f"the median leaf has {points:.0f} points, of {FEW} that show one; some leaves are guessed or not found"
        remarks.append(remark("leaves-sparse-in-cloud", text, remedy="scan from nearer, or with a finer step"))
    return tuple(remarks)


def _renumber(leaf: NDArray[np.int32], kept: NDArray[np.int64], count: int) -> NDArray[np.int32]:
    """Leaves of points (N,), numbered as they were kept; -1 for those that were not."""
    number = np.full(count + 1, -1, np.int32)
    number[kept] = np.arange(len(kept))
    return np.asarray(number[leaf])
