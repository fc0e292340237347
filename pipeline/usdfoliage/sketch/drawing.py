"""Lines and masks in a picture, as all of this package draws and measures them."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from usdfoliage.geometry.lines import arc_lengths, points_at

SHIFT = 4  # bits of a pixel's fraction, of the points of fixed_points
_PLACES = 400  # along an outline that is evened out

Floats = NDArray[np.float64]


def fixed_points(line: Floats) -> NDArray[np.int32]:
    """Points (K, 2) in pixels for OpenCV, with SHIFT: its pixels have their middles at whole numbers."""
    return np.round((line - 0.5) * (1 << SHIFT)).astype(np.int32)


def draw_lines(lines: Sequence[Floats], shape: tuple[int, ...], width: int) -> NDArray[np.bool_]:
    """(H, W) what is under lines (K, 2) that are so many pixels wide."""
    drawn = np.zeros(shape[:2], np.uint8)
    for line in lines:
        cv2.polylines(drawn, [fixed_points(line)], False, 1, width, shift=SHIFT)
    return drawn > 0


def even_out(outline: Floats, reach_px: float) -> Floats:
    """(N, 2) a closed outline (K, 2) without the tremor of a hand: a mean along it with a deviation of so many pixels.

    Args:
        outline: Its corners.
        reach_px: Of the mean; the outline is as it was where this is small against its whole length.
    """
    closed = np.concatenate([outline, outline[:1]])
    length = float(arc_lengths(closed)[-1])
    if not length > 0 or not reach_px > 0:
        return outline
    places = points_at(closed, np.linspace(0, length, _PLACES, endpoint=False))
    return np.asarray(gaussian_filter1d(places, reach_px * _PLACES / length, axis=0, mode="wrap"), np.float64)


def rows_and_columns(
    points: Floats, shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Pixel of each point (..., 2 or 3) that has y upwards, in a picture (H, W), and whether it is in the picture."""
    height, width = shape[:2]
    column, row = np.floor(points[..., 0]).astype(np.int64), np.floor(-points[..., 1]).astype(np.int64)
    within = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return np.clip(row, 0, height - 1), np.clip(column, 0, width - 1), within


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
