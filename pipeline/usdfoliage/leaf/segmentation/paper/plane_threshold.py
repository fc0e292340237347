"""δ_plane from the data: how far apart neighbouring points of one leaf may lie.

The paper has its user choose it, typically 2 cm, for 1 to 15 m of foliage. What it must do is seen in eq. 7 and 8: at
an affinity of 0.85 and σ = 0.2 two coplanar superpixels are joined as long as their nearest points are at most 0.114
δ_plane apart. Nearest points of one leaf are apart by a pixel's footprint (depth / focal length) divided by the
cosine of the angle at which the leaf is seen, and by the noise of the depth. Hence 0.114 δ_plane = √((2 footprints)²
+ noise²): leaves seen at up to 60° hold together. For a footprint of 1.1 mm without noise that is the paper's 2 cm.
Our own idea.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.errors import FitError
from usdfoliage.leaf.segmentation.paper.affinity import AffinitySettings

_STEEPEST_FOOTPRINTS = 2.0  # between neighbouring points of a surface seen at 60°
_JUMP_FOOTPRINTS = 24.0  # in depth between neighbouring pixels: no surface, one thing before another
_BAND_PX = 15  # around such a jump, where the noise is measured


def auto_plane_threshold(views: Sequence[View], settings: AffinitySettings = AffinitySettings()) -> float:
    """δ_plane in metres for a set of views, proportional to the scale of the scene.

    Footprint and noise are those of what stands before something else, where a view shows such things: that is the
    foliage, and not the wall or the ground behind it.

    Raises:
        FitError: No view has depth.
    """
    measured = [measure_footprints(view) for view in views if view.has_depth]
    if not measured:
        raise FitError("δ_plane cannot be found: no view has depth")
    before = np.concatenate([footprints for footprints, _ in measured])
    noises = np.array([noise for _, noise in measured])
    footprint_m, noise_m = float(np.median(before)), float(np.median(noises))
    return float(np.hypot(_STEEPEST_FOOTPRINTS * footprint_m, noise_m) / settings.reach)


def measure_footprints(view: View) -> tuple[NDArray[np.float64], float]:
    """The footprints in metres of pixels that stand before others, all pixels if none does; the noise of their depth.

    The noise is robust: from the median second difference of the depth along rows, which is 0 on a plane.
    """
    focal = float(np.sqrt(view.camera.focal_px[0] * view.camera.focal_px[1]))
    known = view.depth_m > 0
    if view.mask is not None and (known & view.mask).any():
        known &= view.mask
    depth = np.where(known, view.depth_m, 0).astype(np.float32)
    smooth = cv2.medianBlur(depth, 5)  # single wrong depths jump too
    footprint = smooth / focal
    before = np.zeros(depth.shape, np.bool_)
    for axis in (0, 1):
        one, other = (smooth[:-1], smooth[1:]) if axis == 0 else (smooth[:, :-1], smooth[:, 1:])
        near = np.minimum(one, other)
        jump = (near > 0) & (np.abs(one - other) > _JUMP_FOOTPRINTS * near / focal)
        lower = np.s_[1:] if axis == 0 else np.s_[:, 1:]
        upper = np.s_[:-1] if axis == 0 else np.s_[:, :-1]
        before[upper] |= jump & (one < other)
        before[lower] |= jump & (other < one)
    if np.count_nonzero(before) < 1e-3 * np.count_nonzero(known):
        before = smooth > 0
    if not before.any():
        before, footprint = known, depth / focal
    chosen = footprint[before].astype(np.float64)

    # The surfaces that these pixels belong to: what is near them, in the picture and in depth.
    edge = np.where(before, smooth, np.float32(np.inf))
    farthest = cv2.erode(edge, np.ones((_BAND_PX, _BAND_PX), np.uint8), borderType=cv2.BORDER_REPLICATE) * (
        1 + _JUMP_FOOTPRINTS / focal
    )
    rows = depth.astype(np.float64)
    left, middle, right = rows[:, :-2], rows[:, 1:-1], rows[:, 2:]
    same_surface = (np.minimum(left, right) > 0) & (middle > 0) & (middle <= farthest[:, 1:-1])
    bend = np.abs(left - 2 * middle + right)[same_surface & np.isfinite(farthest[:, 1:-1])]
    noise_m = 1.4826 * float(np.median(bend)) / np.sqrt(6) if len(bend) else 0.0
    return chosen, noise_m
