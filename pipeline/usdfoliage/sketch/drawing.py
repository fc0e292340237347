"""Lines and masks in a picture, as all of this package draws and measures them."""

import cv2
import numpy as np
from numpy.typing import NDArray

SHIFT = 4  # bits of a pixel's fraction, of the points of fixed_points

Floats = NDArray[np.float64]


def fixed_points(line: Floats) -> NDArray[np.int32]:
    """Points (K, 2) in pixels for OpenCV, with SHIFT: its pixels have their middles at whole numbers."""
    return np.round((line - 0.5) * (1 << SHIFT)).astype(np.int32)


def arc_lengths(line: Floats) -> Floats:
    """(K,) way to each point of a line (K, 2 or 3) from its first one."""
    return np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def points_at(line: Floats, arc: Floats) -> Floats:
    """(N, D) the points of a line (K, D) after so much of its way (N,)."""
    own = arc_lengths(line)
    return np.stack([np.interp(arc, own, line[:, k]) for k in range(line.shape[1])], axis=-1)


def dilate(mask: NDArray[np.bool_], by_px: float) -> NDArray[np.bool_]:
    """(H, W) the pixels of a mask, and those that are no farther from it."""
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away <= by_px)


def close_gaps(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """(H, W) a mask with its gaps up to twice as wide as reach, also at the borders of the picture."""
    pad = 2 * reach
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    closed = cv2.morphologyEx(np.pad(mask.astype(np.uint8), pad), cv2.MORPH_CLOSE, kernel)
    return np.asarray(closed[pad:-pad, pad:-pad] > 0)
