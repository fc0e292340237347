"""Depth maps made to agree with each other: noise averaged out, outliers dropped, holes filled. Our own.

Every view is fused anew from its own raw depth and that of the views nearest to it, so that the result does not depend
on the order of the views.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.segmentation.dense.depth_view import depth_view
from usdfoliage.native_settings import native_settings
from usdfoliage.progress import Progress

logger = logging.getLogger(__name__)

_REPLACED, _FILLED, _REMOVED = 3, 4, 5  # of _native.fuse_depth
_MAD = 1.4826  # standard deviations of a normal distribution in its median absolute deviation
_WINDOW_PX = 3  # of the planes that noise is measured about
_STEEPEST = 4.0  # footprints of depth a pixel, on these planes
_SUPPORT = 10.0  # neighbours that such a plane needs
_FRONT_PX = 12  # from the edge of a surface that stands before others
_FRONT_SHARE = 0.02  # of the pixels, that must be of such surfaces


@dataclass(frozen=True, kw_only=True)
class CoherenceSettings:
    """When depths of several views are of one surface."""

    neighbors: int = 10  # The depth of this many nearest photographs is compared. Range: 0 or more.
    # Depths of one surface differ by up to this many footprints of a pixel. Unit: footprints. Range: 0 or more.
    footprints: float = 2.5
    # Depths of one surface differ, in addition, by up to this many standard deviations of the noise. Unit: standard
    # deviations. Range: 0 or more.
    noises: float = 4.0
    # A pixel's depth is kept where at least this many depths agree, its own included. Range: 2 or more.
    min_own: int = 2
    # At least this many agreeing depths of other photographs replace a depth that is not confirmed, or fill a hole.
    # Range: 2 or more.
    min_others: int = 3
    # The noise of a photograph's depth is measured at this many pixels. Unit: pixels. Range: 1 or more.
    noise_samples: int = 10_000

    def __post_init__(self) -> None:
        if self.neighbors < 0 or self.footprints < 0 or self.noises < 0:
            raise ValueError(f"neighbors, footprints and noises must not be below 0, not {self}")
        if self.min_own < 2 or self.min_others < 2:
            raise ValueError(f"at least 2 depths must agree, not {self}")
        if self.noise_samples < 1:
            raise ValueError(f"noise_samples must be at least 1, not {self.noise_samples}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CoherentDepth:
    """The depth of V views."""

    depth_m: tuple[NDArray[np.float32], ...]  # V of (H, W), along the optical axis, 0 where there is none
    noise_m: tuple[float, ...]  # V, standard deviation of what is left, along the optical axis
    raw_noise_m: tuple[float, ...]  # V, the same before
    filled_px: tuple[int, ...]  # V, pixels that had no depth
    replaced_px: tuple[int, ...]  # V, pixels that had another depth
    removed_px: tuple[int, ...]  # V, pixels that have none any more


def make_depth_coherent(
    views: Sequence[View],
    settings: CoherenceSettings = CoherenceSettings(),
    progress: Progress | None = None,
    *,
    threads: int = 0,
) -> CoherentDepth:
    """The views' depth, each from its own and what the views nearest to it saw of the same surfaces.

    A pixel's own depth is averaged with those of other views that agree with it. One that nobody confirms although
    other views look there gives way to the nearest depth that enough of them agree on, as does a hole, or is dropped.
    One that no other view could have seen stays as it is: a single view is returned unchanged.

    Args:
        views: With or without depth; those without get what the others saw.
        settings: When depths agree.
        progress: Called with views done and in all.
        threads: At most so many, 0 for one per core; the result is the same.
    """
    seen = [depth_view(view.camera, view.depth_m) for view in views]
    raw_noise = [_measure(one, settings, threads) for one in seen]
    known = [index for index, view in enumerate(views) if view.has_depth]
    reference_m = [_median_depth(view) for view in views]

    depths: list[NDArray[np.float32]] = []
    noise: list[float] = []
    counts: list[NDArray[np.intp]] = []
    for index in range(len(views)):
        asked = nearest_views([view.camera for view in views], index, known, reference_m[index], settings.neighbors)
        # the depth of all of them is compared with each other
        spread = [raw_noise[k] for k in (index, *asked) if raw_noise[k] > 0]
        noise_m = float(np.sqrt(np.mean(np.square(spread)))) if spread else 0.0
        fused = _native.fuse_depth(
            seen[index],
            [seen[k] for k in asked],
            settings=native_settings(
                _native.FuseSettings,
                settings,
                noise_m=settings.noises * noise_m,
                min_own=settings.min_own,
                min_others=settings.min_others,
            ),
            threads=threads,
        )
        depths.append(fused.depth_m)
        counts.append(np.bincount(fused.kinds.ravel(), minlength=_REMOVED + 1))
        now = depth_view(views[index].camera, fused.depth_m)
        noise.append(_measure(now, settings, threads) if asked else raw_noise[index])
        if progress is not None:
            progress(index + 1, len(views))
    result = CoherentDepth(
        depth_m=tuple(depths),
        noise_m=tuple(noise),
        raw_noise_m=tuple(raw_noise),
        filled_px=tuple(int(count[_FILLED]) for count in counts),
        replaced_px=tuple(int(count[_REPLACED]) for count in counts),
        removed_px=tuple(int(count[_REMOVED]) for count in counts),
    )
    logger.info(
        "depth of %d views: %d pixels filled, %d replaced, %d removed",
        len(views), sum(result.filled_px), sum(result.replaced_px), sum(result.removed_px),
    )  # fmt: skip
    return result


def nearest_views(
    cameras: Sequence[Pinhole], index: int, among: Sequence[int], depth_m: float, count: int
) -> list[int]:
    """Up to count of the numbers among, without index, that look the most as the camera index does.

    How far two cameras differ is the angle between their axes plus the distance between them in depths: about the
    angle that they see a surface at this depth under.
    """
    if not count:
        return []
    here = cameras[index]
    difference = []
    for other in among:
        there = cameras[other]
        cosine = float(np.clip(here.cam_from_world[2, :3] @ there.cam_from_world[2, :3], -1, 1))
        difference.append(
            float(np.linalg.norm(here.position_m - there.position_m)) / depth_m + float(np.arccos(cosine))
        )
    order = np.argsort(difference, kind="stable")
    return [among[k] for k in order.tolist() if among[k] != index][:count]


def measure_noise(view: View, samples: int = 10_000, *, threads: int = 0) -> float:
    """Standard deviation of a view's depth about the surfaces it shows, along the optical axis; 0 without depth.

    Measured robustly about planes through small windows; steps of rounded depth count as noise.
    """
    return _measure_noise(depth_view(view.camera, view.depth_m), samples, threads)


def _measure(seen: _native.DepthView, settings: CoherenceSettings, threads: int) -> float:
    return _measure_noise(seen, settings.noise_samples, threads)


def _measure_noise(seen: _native.DepthView, samples: int, threads: int) -> float:
    depth, (focal_x, focal_y, _, _) = seen.depth_m, seen.intrinsics
    pixels = _front_pixels(depth, float(np.sqrt(focal_x * focal_y)))
    if not len(pixels):
        return 0.0
    pixels = pixels[np.arange(min(samples, len(pixels))) * len(pixels) // min(samples, len(pixels))]
    rows, columns = np.divmod(pixels, depth.shape[1])
    noise_m = _noise_of_steps(depth, rows, columns)
    own = depth.ravel()[pixels].astype(np.float64)
    # the fit takes what lies within some noises of the plane, so it is repeated with the noise it showed
    for _ in range(3):
        planes = _native.fit_local_planes(
            seen, pixels, radius_px=_WINDOW_PX, steepest=_STEEPEST, noise_m=noise_m, threads=threads
        )
        good = planes.support >= _SUPPORT
        if not good.any():
            return noise_m
        away_m = np.abs(own[good] * planes.slopes[good, 2] - 1) * own[good]
        noise_m = float(_MAD * np.median(away_m))
    return noise_m


def _front_pixels(depth: NDArray[np.float32], focal_px: float) -> NDArray[np.intp]:
    """Indices of pixels beside the edge of a surface that stands before others: there the leaves are.

    Walls and ground behind them, often most of the picture, may be much noisier, or so coarsely rounded that the noise
    does not show. So pixels whose neighbours are all as deep as they are do not count either. All pixels with depth if
    too few are left.
    """
    known = depth > 0
    smooth = cv2.medianBlur(depth, 5)  # without single outliers
    behind = cv2.dilate(smooth, np.ones((2 * _FRONT_PX + 1, 2 * _FRONT_PX + 1), np.uint8))
    # farther than any surface through the pixel could be
    front = known & (smooth > 0) & (behind > depth * np.float32(1 + _STEEPEST * _FRONT_PX / focal_px))
    wide = cv2.copyMakeBorder(depth, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    front &= np.logical_or.reduce(
        [part != depth for part in (wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:])]
    )
    pixels = np.flatnonzero(front)
    if len(pixels) < _FRONT_SHARE * np.count_nonzero(known):
        pixels = np.flatnonzero(known)
    return pixels


def _noise_of_steps(depth: NDArray[np.float32], rows: NDArray[np.intp], columns: NDArray[np.intp]) -> float:
    """A first guess, in metres along the ray: of inverse depth, linear on planes, second differences are noise."""
    found = []
    for down, right in ((0, 1), (1, 0)):
        inside = (rows >= down) & (rows < depth.shape[0] - down) & (columns >= right)
        inside &= columns < depth.shape[1] - right
        r, c = rows[inside], columns[inside]
        before, own, after = (depth[r + k * down, c + k * right].astype(np.float64) for k in (-1, 0, 1))
        known = (before > 0) & (after > 0)
        before, own, after = before[known], own[known], after[known]
        found.append(np.abs(1 / before + 1 / after - 2 / own) * own**2)
    steps = np.concatenate(found)
    return float(_MAD / np.sqrt(6) * np.median(steps)) if len(steps) else 0.0


def _median_depth(view: View) -> float:
    depth = view.depth_m[view.depth_m > 0]
    return float(np.median(depth)) if len(depth) else 1.0
