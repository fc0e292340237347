"""How much the pixels of a leaf look like those of the surest leaves rather than like the rest of the photographs."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.files.threads import map_threaded
from usdfoliage.leaf.segmentation.dense.evidence import Evidence

BINS, STEP = 32, 3  # of a* and b*, and their width in 8-bit units
FLOOR = 1e-4  # probability of a bin that nobody has
SUREST, FEWEST = 0.9, 20  # quantile of trust from which leaves show which colours leaves have, and their least number
HAS = 0.1  # of a leaf's pixels that have a colour, up to a step off, from which on the leaf has it
COMMON = 0.03  # share of the surest leaves that have a colour, from which on leaves have it
STRANGE = (0.2, 0.6)  # share of a leaf's pixels of such colours, at which it has no trust, and from which on all
NEUTRAL, SPAN = -0.6, 0.5  # log ratio at which a leaf has no trust, and up to where trust rises to 1


def index_colors(views: Sequence[View]) -> list[NDArray[np.int32]]:
    """Number (H, W) of each pixel's bin of a* and b*, view by view; light and shadow do not count."""
    indices = []
    for view in views:
        lab = cv2.cvtColor(view.srgb, cv2.COLOR_RGB2LAB).astype(np.int32)
        a, b = (np.clip((lab[..., channel] - 128) // STEP + BINS // 2, 0, BINS - 1) for channel in (1, 2))
        indices.append((a * BINS + b).astype(np.int32))
    return indices


def judge_colors(
    indices: Sequence[NDArray[np.int32]],
    views: Sequence[View],
    depths_m: Sequence[NDArray[np.floating]],
    evidence: Evidence,
    tolerance_m: float,
    quality: NDArray[np.float64],
    *,
    threads: int = 0,
) -> NDArray[np.float64]:
    """(N,), 0 to 1: whether each leaf has the colours of the best ones. Where all has one colour all are 1.

    That a colour is rare in the photographs does not make it a leaf's: bits of soil between leaves are rare too. So
    leaves of colours that hardly one of the surest leaves has are not trusted either.

    Args:
        indices: What index_colors gives.
        tolerance_m: Between a probe and what is seen there.
        quality: (N,), of the leaves by their shape; the best fourth gives the colour of leaves.
        threads: At most so many, 0 for one per core; the result is the same.
    """
    count = len(quality)
    if not count:
        return np.zeros(0)
    probes = evidence.points_m.shape[1]
    flat = evidence.points_m.reshape(-1, 3)

    def sample_view(number: int) -> tuple[NDArray[np.intp], NDArray[np.int32], NDArray[np.intp]]:
        index, camera, depth_m = indices[number], views[number].camera, depths_m[number]
        places, distance_m = camera.project(flat)
        with np.errstate(invalid="ignore"):  # behind the camera
            x, y = places.T
            which = np.flatnonzero((x >= 0) & (y >= 0) & (x < camera.width_px) & (y < camera.height_px))
        column, row = places[which].astype(np.int64).T
        seen = np.abs(depth_m[row, column] - distance_m[which]) < tolerance_m
        histogram = np.bincount(index[::2, ::2].ravel(), minlength=BINS * BINS)
        return which[seen] // probes, index[row[seen], column[seen]], histogram

    leaf, color, histograms = zip(*map_threaded(sample_view, range(len(views)), threads=threads), strict=True)
    leaves, colors, whole = np.concatenate(leaf), np.concatenate(color), np.sum(histograms, axis=0)
    everywhere = _smooth(whole)
    pixels = np.bincount(leaves, minlength=count)
    total = np.maximum(pixels, 1)
    trust, share = quality, 0.75
    factor = np.ones(count)
    for _ in range(2):  # leaves that turn out to look like soil do not teach
        teachers = (trust >= np.quantile(trust, share)).astype(np.float64)
        ratio = np.log(_smooth(np.bincount(colors, teachers[leaves], minlength=BINS * BINS)) / everywhere)
        mean = np.bincount(leaves, np.clip(ratio, -3, 3)[colors], minlength=count) / total
        factor = np.clip((mean - NEUTRAL) / SPAN, 0.02, 1.0)
        trust, share = quality * factor, 0.6
    known = np.bincount(leaves, _common_colors(leaves, colors, trust)[colors], minlength=count) / total
    known[pixels == 0] = 1.0
    none, whole_share = STRANGE
    return np.asarray(factor * np.clip((known - none) / (whole_share - none), 0.02, 1.0))


def _common_colors(
    leaves: NDArray[np.intp], colors: NDArray[np.int32], trust: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(BINS * BINS,), 0 to 1, which colours the surest leaves have, by the leaf and the colour of each pixel (P,)."""
    surest = np.argsort(-trust, kind="stable")[: max(FEWEST, round((1 - SUREST) * len(trust)))]
    number = np.full(len(trust), -1)
    number[surest] = np.arange(len(surest))
    counted = number[leaves] >= 0
    bins = number[leaves[counted]] * BINS * BINS + colors[counted]
    pixels = np.bincount(bins, minlength=len(surest) * BINS * BINS).reshape(-1, BINS, BINS).astype(np.float32)
    pixels /= np.maximum(pixels.sum(axis=(1, 2), keepdims=True), 1)
    has = np.stack([cv2.boxFilter(one, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT) for one in pixels])
    return np.asarray(np.clip((has > HAS).mean(axis=0).ravel() / COMMON, 0, 1))


def _smooth(histogram: NDArray[np.number]) -> NDArray[np.float64]:
    smooth = cv2.GaussianBlur(histogram.reshape(BINS, BINS).astype(np.float64), (0, 0), 1.0).ravel()
    return np.asarray(smooth / max(float(smooth.sum()), 1e-12) + FLOOR)
