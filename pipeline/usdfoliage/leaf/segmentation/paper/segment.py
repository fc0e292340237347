"""The paper's segmentation, from views to the points of single leaves.

Source: G. Chaurasia, P. Beardsley, Editable Parametric Dense Foliage from 3D Capture, 2017, section 4.
"""

import logging
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from usdfoliage.capture.view import View
from usdfoliage.errors import FitError
from usdfoliage.leaf.segmentation.model import Candidates, Segmentation
from usdfoliage.leaf.segmentation.paper.affinity import AffinitySettings
from usdfoliage.leaf.segmentation.paper.candidates import CandidateSettings, ViewCandidates, segment_view
from usdfoliage.leaf.segmentation.paper.plane_threshold import auto_plane_threshold
from usdfoliage.leaf.segmentation.paper.planes import PlaneSettings
from usdfoliage.leaf.segmentation.paper.refinement import RefinementSettings, refine_leaves
from usdfoliage.leaf.segmentation.paper.superpixels import SuperpixelSettings
from usdfoliage.leaf.segmentation.paper.template import TemplateSettings, draw_template, measure_ratio
from usdfoliage.progress import Progress

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class PaperSegmentationSettings:
    """Settings of every step of section 4."""

    # This is the distance δ_plane of the paper; auto derives it from the data. Unit: metres. Range: above 0.
    plane_threshold_m: float | None = None
    seed: int = 0  # Every random choice of RANSAC starts from this number. Range: 0 or more.
    superpixels: SuperpixelSettings = field(default_factory=SuperpixelSettings)
    planes: PlaneSettings = field(default_factory=PlaneSettings)
    affinity: AffinitySettings = field(default_factory=AffinitySettings)
    candidates: CandidateSettings = field(default_factory=CandidateSettings)
    template: TemplateSettings = field(default_factory=TemplateSettings)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)

    def __post_init__(self) -> None:
        if self.plane_threshold_m is not None and not (
            np.isfinite(self.plane_threshold_m) and self.plane_threshold_m > 0
        ):
            raise ValueError(f"plane_threshold_m must be above 0, not {self.plane_threshold_m}")


def segment_paper(
    views: Sequence[View],
    settings: PaperSegmentationSettings = PaperSegmentationSettings(),
    progress: Progress | None = None,
) -> Segmentation:
    """Find single leaves as the paper does.

    Args:
        views: With depth; those without give no candidates.
        settings: Of every step.
        progress: Called with the views done and all.

    Raises:
        FitError: No view has depth.
    """
    threshold_m = settings.plane_threshold_m
    if threshold_m is None:
        threshold_m = auto_plane_threshold(views, settings.affinity)
    elif not any(view.has_depth for view in views):
        raise FitError("no leaf can be found: no view has depth")
    dropped: Counter[str] = Counter()
    began = time.perf_counter()
    found: list[ViewCandidates | None] = []
    for number, view in enumerate(views):
        if progress is not None:
            progress(number, len(views))
        if not view.has_depth:
            dropped["views without depth"] += 1
            found.append(None)
            continue
        one = segment_view(
            view,
            threshold_m,
            settings.superpixels,
            settings.planes,
            settings.affinity,
            settings.candidates,
            rng=np.random.default_rng([settings.seed, number]),
        )
        dropped.update(one.dropped)
        found.append(one)
    if progress is not None:
        progress(len(views), len(views))
    candidates = [
        one.candidates
        if one is not None
        else Candidates(labels=np.zeros(view.depth_m.shape, np.int32), confidence=np.empty(0))
        for view, one in zip(views, found, strict=True)
    ]
    half_axes = np.concatenate([one.shapes.half_axes_m for one in found if one is not None])
    confidence = np.concatenate([one.shapes.confidence for one in found if one is not None])
    logger.info(
        "%d candidate leaves in %d views, plane threshold %.4f m, %.1f s",
        len(confidence), len(views), threshold_m, time.perf_counter() - began,
    )  # fmt: skip
    if (half_axes[:, 1:] > 0).any():
        ratio = measure_ratio(half_axes, confidence, settings.template)
    else:
        ratio = 1.0  # there is nothing to lay a template on
    template = draw_template(ratio, settings.template)
    refined = refine_leaves(views, found, template, threshold_m, settings.refinement)
    dropped.update(refined.dropped)
    logger.info("%d leaves, %.1f s", len(refined.leaves), time.perf_counter() - began)
    return Segmentation(candidates=candidates, leaves=refined.leaves, dropped=dict(dropped))
