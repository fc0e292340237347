"""Which depth is believed, and its last refinement.

Section 4 of J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020: the likelihood of a
pixel's depth is how well it fits the photographs times how far the other views' depth confirms it (equation 3); which
pixels keep their depth minimises equation 4 over the whole picture by a graph cut, along the photograph's edges; and a
guided filter smooths what is kept between them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.capture.mvs.patch_match import MatchedPlanes, warps
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.native_settings import native_settings

_CARRIED = 0.02  # confidence of pixels that keep their depth for their neighbours' sake alone
_CUT_UNIT = 1000  # of costs, as whole numbers for the graph cut


@dataclass(frozen=True, kw_only=True)
class AgreementSettings:
    """Which depth is believed."""

    max_cost: float = 1.3  # A pixel whose plane costs more has no depth, because nothing fits. Range: above 0, below 3.
    agreeing: int = 2  # The depths of this many other photographs must agree with a pixel's. Range: 0 or more.
    # A pixel is dropped where more photographs see through it than this many for each that agrees. Range: 0 or more.
    through: float = 1.0
    # Two depths agree where a pixel comes back from the other photograph within this distance. Unit: pixels. Range:
    # above 0.
    agree_px: float = 1.5
    agree_share: float = 0.01  # Two depths agree where they differ by up to this share. Range: above 0.
    # A pixel of lower likelihood gets no depth, as far as its neighbours allow. Range: 0 to below 1.
    min_likelihood: float = 0.05
    # The graph cut charges this for an edge of the kept depth where the photograph has no edge; 0 makes no cut.
    # Range: 0 to below 100.
    smoothness: float = 0.4
    # A colour difference of this size divides the cost smoothness by e. Unit: of 765. Range: above 0.
    edge: float = 30.0
    # A pixel's colour is compared with the background within this radius; 0 compares nothing. Unit: pixels. Range: 0
    # to 64.
    fringe_px: int = 8
    # Where surface and background differ in colour by less, fringes are not searched. Unit: of 765. Range: 0 or more.
    fringe_contrast: float = 24.0
    # A fringe pixel loses its depth where its colour is nearer to the background's, by this share of the distance to
    # its own surface's. Range: 0 to below 1.
    fringe_nearer: float = 0.4
    fringe_passes: int = 6  # Fringes are removed in this many passes, the outermost pixels first. Range: 0 or more.
    # The guided filter that smooths depth has this radius; 0 does not filter. Unit: pixels. Range: 0 or more.
    filter_px: int = 1
    # The guided filter takes a colour difference of this size for an edge. Unit: of 255. Range: above 0.
    filter_color: float = 8.0
    filter_share: float = 0.001  # The guided filter moves a pixel's depth by this share of it at most. Range: above 0.
    min_region_px: int = 6  # Smaller connected regions of depth are dropped. Unit: pixels. Range: 0 or more.

    def __post_init__(self) -> None:
        if not 0 < self.max_cost < 3 or self.agreeing < 0 or min(self.min_region_px, self.filter_px) < 0:
            raise ValueError("max_cost must be in (0, 3), agreeing, min_region_px and filter_px not below 0")
        positive = (self.agree_px, self.agree_share, self.edge, self.filter_color, self.filter_share)
        if not all(np.isfinite(value) and value > 0 for value in positive):
            raise ValueError("agree_px, agree_share, edge, filter_color and filter_share must be above 0")
        if not (0 <= self.fringe_px <= 64 and self.fringe_passes >= 0 and 0 <= self.fringe_nearer < 1):
            raise ValueError("fringe_px must be in [0, 64], fringe_passes not below 0, fringe_nearer in [0, 1)")
        if not self.through >= 0 or not 0 <= self.min_likelihood < 1 or not 0 <= self.smoothness < 100:
            raise ValueError("through must not be below 0, min_likelihood must be in [0, 1), smoothness in [0, 100)")


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
    source_opens: Sequence[NDArray[np.uint8]],
    srgb: NDArray[np.uint8],
    settings: AgreementSettings = AgreementSettings(),
    *,
    threads: int = 0,
) -> DepthEstimate:
    """The depth of one view that fits and that its sources agree with.

    A pixel is seen in a source and, by the depth there, back again; it agrees if it comes back near to where it
    started and both depths agree. Small pieces that are left are dropped.

    Args:
        matched: The planes of the view.
        source_planes: Those of its sources; None where there are none.
        source_opens: Where each of the sources sees nothing, as open_maps gives it for those with planes; or empty.
        srgb: (H, W, 3), the photograph at the size of the planes.
        settings: What is believed.
        threads: 0: one per core.
    """
    known = [planes for planes in source_planes if planes is not None]
    depth_m = np.where(matched.cost <= settings.max_cost, matched.depth_m, np.float32(0))
    sources = [
        _native.DepthSource(
            depth_m=planes.depth_m,
            warps=warps(matched.camera, planes.camera),
            open=source_opens[k] if source_opens else None,
        )
        for k, planes in enumerate(known)
    ]
    counts = _native.count_agreeing(
        depth_m, sources, settings=native_settings(_native.AgreementSettings, settings), threads=threads
    )
    agreeing = counts.agreeing
    depth_m[counts.through > settings.through * agreeing] = 0
    needed = min(settings.agreeing, len(known))
    fit = np.clip(1 - matched.cost / settings.max_cost, 0, 1)
    likelihood = fit * np.minimum(agreeing / (needed + 1), 1)
    depth_m[~choose_pixels(likelihood, agreeing >= needed, depth_m, srgb, settings)] = 0
    depth_m = drop_fringe(depth_m, srgb, settings, threads=threads)
    depth_m = drop_small_pieces(depth_m, settings.agree_share, settings.min_region_px)
    depth_m = smooth_depth(depth_m, likelihood, srgb, settings)
    there = depth_m > 0
    return DepthEstimate(
        camera=matched.camera,
        depth_m=depth_m,
        normals=np.where(there[..., None], matched.normals(), np.float32(0)),
        confidence=np.where(there, np.maximum(likelihood, _CARRIED), 0).astype(np.float32),
        agreeing=np.where(there, agreeing, 0).astype(np.uint8),
    )


def choose_pixels(
    likelihood: NDArray[np.floating],
    confirmed: NDArray[np.bool_],
    depth_m: NDArray[np.float32],
    srgb: NDArray[np.uint8],
    settings: AgreementSettings = AgreementSettings(),
) -> NDArray[np.bool_]:
    """Which pixels (H, W) keep their depth, equation 4.

    u(p) is 1 where depth is kept: that costs min_likelihood − L(p), and each pair of neighbours of which one is kept
    costs smoothness, less across an edge of the photograph. Pairs that lie at different depths do not hold together.

    Args:
        likelihood: (H, W), L in [0, 1].
        confirmed: (H, W), pixels that enough views agree with; others have no likelihood, but may be carried along.
        depth_m: (H, W), 0 where there is none to keep.
        srgb: (H, W, 3).
        settings: Costs.
    """
    kept = (depth_m > 0) & confirmed
    if settings.smoothness == 0:
        return kept
    gain = np.where(kept, likelihood - settings.min_likelihood, -settings.min_likelihood)
    colors = srgb.astype(np.int16)
    pairs = []
    for axis in (0, 1):
        step = np.abs(np.roll(colors, -1, axis) - colors).sum(axis=2) / settings.edge
        weight = settings.smoothness * np.exp(-step)
        beside = np.roll(depth_m, -1, axis)
        nearer_m = np.minimum(depth_m, beside)
        torn = (nearer_m > 0) & (np.abs(beside - depth_m) > settings.agree_share * nearer_m)
        weight[torn] = 0
        weight[(slice(None), -1) if axis else (-1, slice(None))] = 0
        pairs.append(np.rint(weight * _CUT_UNIT).astype(np.int32))
    terminal = np.rint(-gain * _CUT_UNIT).astype(np.int32)  # to the end of those dropped where positive
    terminal[depth_m <= 0] = 8 * _CUT_UNIT * max(1, round(settings.smoothness))
    return np.asarray((_native.cut_grid(pairs[0], pairs[1], terminal) != 0) & (depth_m > 0))


def drop_fringe(
    depth_m: NDArray[np.float32],
    srgb: NDArray[np.uint8],
    settings: AgreementSettings = AgreementSettings(),
    *,
    threads: int = 0,
) -> NDArray[np.float32]:
    """Depth (H, W) without the fringe of background that windows give to thin things before it.

    Beside a twig a window sees the twig, and matches best at its depth. The colour of such a pixel is that of what has
    no depth around it, or lies farther, rather than the mean of what has its own depth.

    Args:
        depth_m: (H, W), 0 where there is none.
        srgb: (H, W, 3).
        settings: How near.
        threads: 0: one per core.
    """
    for _ in range(settings.fringe_passes if settings.fringe_px else 0):
        fringe = _native.find_fringe(
            depth_m,
            srgb,
            settings=native_settings(_native.FringeSettings, settings, gap=2 * settings.agree_share),
            threads=threads,
        )
        if not fringe.any():
            break
        depth_m = np.where(fringe != 0, np.float32(0), depth_m)
    return depth_m


def smooth_depth(
    depth_m: NDArray[np.float32],
    likelihood: NDArray[np.floating],
    srgb: NDArray[np.uint8],
    settings: AgreementSettings = AgreementSettings(),
) -> NDArray[np.float32]:
    """Depth (H, W) after a guided filter, likely pixels weighing more; a pixel moves within its own surface only.

    K. He et al., Guided image filtering, 2010. Inverse depth is filtered: planes are linear in it.
    """
    if settings.filter_px == 0 or not (depth_m > 0).any():
        return depth_m
    there = depth_m > 0
    inverse = np.divide(1, depth_m, out=np.zeros_like(depth_m), where=there)
    weight = np.where(there, np.maximum(likelihood, 0.05), 0).astype(np.float32)
    eps = (settings.filter_color / 255) ** 2
    guide = np.ascontiguousarray(srgb.astype(np.float32) / 255)
    both = cv2.ximgproc.guidedFilter(guide, np.dstack([weight * inverse, weight]), settings.filter_px, eps)
    smooth = np.divide(both[..., 0], both[..., 1], out=inverse.copy(), where=there & (both[..., 1] > 1e-4))
    near = there & (np.abs(smooth - inverse) <= settings.filter_share * inverse)
    return np.where(near, np.divide(1, smooth, out=depth_m.copy(), where=near), depth_m).astype(np.float32)


def drop_small_pieces(depth_m: NDArray[np.float32], share: float, min_px: int) -> NDArray[np.float32]:
    """Without connected pieces of depth below min_px; a jump by more than a share of the depth parts pieces."""
    if min_px <= 1 or not (depth_m > 0).any():
        return depth_m
    levels = np.zeros(depth_m.shape, np.float32)
    np.log(depth_m, out=levels, where=depth_m > 0)
    lowest = levels[depth_m > 0].min()
    steps = np.clip(np.rint((levels - lowest) * (4 / share)) + 1, 1, 32000)  # quarters of what parts pieces
    quarters = np.where(depth_m > 0, steps, 0).astype(np.int16)
    cv2.filterSpeckles(quarters, 0, min_px - 1, 4)
    return np.where(quarters > 0, depth_m, np.float32(0))
