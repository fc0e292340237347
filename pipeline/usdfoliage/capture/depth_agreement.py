"""Which depth is believed: what fits the photographs and what the other views' depth confirms."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.capture.patch_match import MatchedPlanes, warps
from usdfoliage.geometry.pinhole import Pinhole


@dataclass(frozen=True, kw_only=True)
class AgreementSettings:
    """Which depth is believed."""

    max_cost: float = 0.6  # mean of one minus the correlation: above it nothing fits
    agreeing: int = 2  # other views whose depth must agree
    agree_px: float = 1.5  # between a pixel and where it comes back to from the other view
    agree_share: float = 0.01  # between two depths that agree
    min_region_px: int = 12  # smaller connected pieces of depth are dropped

    def __post_init__(self) -> None:
        if not 0 < self.max_cost < 2 or self.agreeing < 0 or self.min_region_px < 0:
            raise ValueError("max_cost must be in (0, 2), agreeing and min_region_px not below 0")
        if not (self.agree_px > 0 and self.agree_share > 0):
            raise ValueError("agree_px and agree_share must be above 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthEstimate:
    """Depth of one photograph, as far as others confirm it."""

    camera: Pinhole  # of its size: the photograph's, or smaller if that was larger than max_side_px
    depth_m: NDArray[np.float32]  # (H, W), along the optical axis, 0 where there is none
    normals: NDArray[np.float32]  # (H, W, 3), in camera axes, of length 1, toward the camera; 0 where there is no depth
    confidence: NDArray[np.float32]  # (H, W) in [0, 1]: how well others fit and how many agree; 0 without depth
    agreeing: NDArray[np.uint8]  # (H, W), other views whose depth agrees


def confirm_depth(
    matched: MatchedPlanes,
    source_planes: Sequence[MatchedPlanes | None],
    settings: AgreementSettings = AgreementSettings(),
    *,
    threads: int = 0,
) -> DepthEstimate:
    """The depth of one view that fits and that its sources agree with.

    A pixel is seen in a source and, by the depth there, back again; it agrees if it comes back near to where it
    started and both depths are alike. Small pieces that are left are dropped.

    Args:
        matched: The planes of the view.
        source_planes: Those of its sources; None where there are none.
        settings: What is believed.
        threads: 0: one per core.
    """
    known = [planes for planes in source_planes if planes is not None]
    depth_m = np.where(matched.cost <= settings.max_cost, matched.depth_m, np.float32(0))
    agreeing = np.zeros(depth_m.shape, np.uint8)
    if known:
        agreeing = _native.count_agreeing(
            depth_m,
            [planes.depth_m for planes in known],
            np.stack([warps(matched.camera, planes.camera) for planes in known]),
            settings.agree_px,
            settings.agree_share,
            threads,
        )
    depth_m[agreeing < min(settings.agreeing, len(known))] = 0
    depth_m = _drop_small_pieces(depth_m, settings.agree_share, settings.min_region_px)
    there = depth_m > 0
    share = np.minimum(agreeing / max(1, settings.agreeing + 1), 1)
    fit = np.clip(1 - matched.cost / settings.max_cost, 0, 1)
    return DepthEstimate(
        camera=matched.camera,
        depth_m=depth_m,
        normals=np.where(there[..., None], matched.normals(), np.float32(0)),
        confidence=np.where(there, fit * share, 0).astype(np.float32),
        agreeing=np.where(there, agreeing, 0).astype(np.uint8),
    )


def _drop_small_pieces(depth_m: NDArray[np.float32], share: float, least_px: int) -> NDArray[np.float32]:
    """Without connected pieces of depth below least_px; a jump by more than a share of the depth parts pieces."""
    if least_px <= 1 or not (depth_m > 0).any():
        return depth_m
    levels = np.zeros(depth_m.shape, np.float32)
    np.log(depth_m, out=levels, where=depth_m > 0)
    lowest = levels[depth_m > 0].min()
    steps = np.clip(np.rint((levels - lowest) * (4 / share)) + 1, 1, 32000)  # quarters of what parts pieces
    quarters = np.where(depth_m > 0, steps, 0).astype(np.int16)
    cv2.filterSpeckles(quarters, 0, least_px - 1, 4)
    return np.where(quarters > 0, depth_m, np.float32(0))
