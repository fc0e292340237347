"""Whether a leaf is what is left of one that moved: its points scatter, and around it depth was lost.

Depth is kept where photographs agree. Of a leaf that moved between them pieces agree by chance, each photograph with
another one, in places that differ. Such a piece ends like a leaf, but it is rougher than the plant's other leaves, and
what surrounds it is green without depth. Either sign alone is met with right leaves too: depth is lost around many
where photographs are far apart. Our own.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from usdfoliage.capture.view import View
from usdfoliage.files.threads import map_threaded
from usdfoliage.geometry.picture_agreement import find_vegetation
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

_ALONG = 16  # places of the outline on either side
_NEAR, _WIDE = 0.03, 0.15  # leaf lengths: beside the outline depth ends in any case; the ring reaches so far
_MIN_NEAR_PX = 2
_OFF = 0.3  # leaf lengths, within which depth is of the leaf
_SEEN = 0.3  # share of a leaf's pixels whose depth is its own, from which a view shows it
_MIN_PX = 20  # of a leaf in a view that shows it
_ROUGH = 1.5  # times the median residual of a plant's leaves, in their lengths, beyond which one is rough
_ROUGHEST = 3.0  # times it beyond that; more does not count
# In the logarithm of the odds, of what is lost times the roughness. Set by generated captures whose leaves move and by
# those that stand still (tools/bench/bad_captures.py, tools/bench/leaves.py).
_WEIGHT = 3.0
_SUREST = 1e-6


class _Outlines(NamedTuple):
    points_m: NDArray[np.float64]  # (N, P, 3), around each leaf
    middle_m: NDArray[np.float64]  # (N, 3)
    length_m: NDArray[np.float64]  # (N,)


def lower_confidence(
    leaves: Leaves, confidence: NDArray[np.float64], views: Sequence[View], *, threads: int = 0
) -> NDArray[np.float64]:
    """(N,), the probability that leaves of one plant are right, once it is known what is lost around them.

    Args:
        leaves: N, in the world of the views, with residual_m; without it nothing is known of them.
        confidence: (N,), the probability without that.
        views: With depth.
        threads: 0: one per core. The result is the same.
    """
    if leaves.residual_m is None or not len(leaves):
        return confidence
    residual = leaves.residual_m / leaves.length_m
    median = float(np.median(residual))
    rough = np.clip(residual / median - _ROUGH, 0, _ROUGHEST) if median > 0 else np.zeros(len(leaves))
    weight = np.zeros(len(leaves))
    looked_at = np.flatnonzero(rough > 0)
    lost = measure_lost_surroundings(leaves.take(looked_at), views, threads=threads)
    weight[looked_at] = _WEIGHT * lost * rough[looked_at]
    odds = logit(np.clip(confidence, _SUREST, 1 - _SUREST)) - weight
    return np.where(weight > 0, expit(odds), confidence)


def measure_lost_surroundings(leaves: Leaves, views: Sequence[View], *, threads: int = 0) -> NDArray[np.float64]:
    """(N,), the share of a ring around each leaf that is green without depth: the median of the views that show it.

    0 for a leaf that no view shows by depth, and where leaves are not green.

    Args:
        leaves: N, in the world of the views.
        views: With depth; others show nothing.
        threads: 0: one per core. The result is the same.
    """
    v = np.linspace(0, 1, _ALONG)
    places = np.concatenate([grid_places(np.array([-1.0]), v), grid_places(np.array([1.0]), v[::-1])])
    points_m = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf())
    outlines = _Outlines(points_m=points_m, middle_m=points_m.mean(axis=1), length_m=leaves.length_m)
    with_depth = [view for view in views if view.has_depth]
    shares = np.full((len(with_depth), len(leaves)), np.nan)
    for number, share in enumerate(map_threaded(lambda view: _lost_in(outlines, view), with_depth, threads=threads)):
        shares[number] = share
    lost = np.zeros(len(leaves))
    seen = np.isfinite(shares).any(axis=0)
    lost[seen] = np.nanmedian(shares[:, seen], axis=0)
    return lost


def _lost_in(outlines: _Outlines, view: View) -> NDArray[np.float64]:
    """(N,), the share of the ring around each leaf, NaN where the view does not show it."""
    there = view.depth_m > 0
    lost = find_vegetation(view.srgb) & ~there
    height, width = there.shape
    middles_m = view.camera.project(outlines.middle_m)[1]
    shares = np.full(len(outlines.length_m), np.nan)
    for number, (points_m, length_m) in enumerate(zip(outlines.points_m, outlines.length_m, strict=True)):
        places, distance_m = view.camera.project(points_m)
        if not (np.isfinite(places).all() and distance_m.min() > 0):
            continue
        length_px = length_m * view.camera.focal_px[0] / middles_m[number]
        near_px = max(_MIN_NEAR_PX, round(_NEAR * length_px))
        wide_px = near_px + max(_MIN_NEAR_PX, round((_WIDE - _NEAR) * length_px))
        low = np.floor(places.min(axis=0)).astype(int) - wide_px
        high = np.ceil(places.max(axis=0)).astype(int) + wide_px + 1
        low, high = np.maximum(low, 0), np.minimum(high, (width, height))
        if (high - low).min() <= 0:
            continue
        blade = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
        cv2.fillPoly(blade, [np.rint(places - low).astype(np.int32)], 1)
        part = slice(low[1], high[1]), slice(low[0], high[0])
        depth_m = view.depth_m[part][blade > 0]
        own = np.abs(depth_m - middles_m[number]) < _OFF * length_m
        if len(depth_m) < _MIN_PX or np.count_nonzero(own) < _SEEN * len(depth_m):
            continue
        ring = (_grow(blade, wide_px) > 0) & (_grow(blade, near_px) == 0)
        if ring.any():
            shares[number] = float(lost[part][ring].mean())
    return shares


def _grow(blade: NDArray[np.uint8], by_px: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.dilate(blade, np.ones((2 * by_px + 1, 2 * by_px + 1), np.uint8)), np.uint8)
