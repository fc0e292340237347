"""How far outside of the leaves somebody drew the stroke around them. Our own.

Where sky is behind the crown it is seen where its leaves end. A hand keeps about the same distance all around, so that
it is known also where grass or other trees are behind.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.lines import arc_lengths, points_at

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PLACES = 400  # along the stroke
_ENOUGH = 40  # of them must have sky behind
_FARTHEST = 0.12  # of the crown's size; what is farther is a bay of the crown
_SKY_BETWEEN = 0.6  # of the way from the stroke to the leaves


@dataclass(frozen=True, kw_only=True)
class StrokeMargin:
    """Distances from a stroke inwards to the leaves, in pixels."""

    middle_px: float  # the median
    spread_px: float  # half of the range of the middle half


def measure_margin(stroke_px: Floats, leaves: Mask, sky: Mask, size_px: float) -> StrokeMargin | None:
    """The margin between a stroke and the leaves, where sky is between; None where too little is.

    Args:
        stroke_px: (N, 2), closed.
        leaves: (H, W), as they were found.
        sky: (H, W), pure sky.
        size_px: Of the crown.
    """
    if not leaves.any() or not sky.any():
        return None
    closed = np.concatenate([stroke_px, stroke_px[:1]])
    places = points_at(closed, np.linspace(0, arc_lengths(closed)[-1], _PLACES, endpoint=False))
    away, label = cv2.distanceTransformWithLabels(
        (~leaves).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    row_of, column_of = np.nonzero(leaves)
    at = np.zeros((int(label.max()) + 1, 2))
    at[label[row_of, column_of]] = np.stack([column_of + 0.5, row_of + 0.5], axis=-1)
    height, width = leaves.shape
    column, row = np.floor(places).astype(int).T
    within = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    places, column, row = places[within], column[within], row[within]
    target = at[label[row, column]]
    between = places[:, None] + (target - places)[:, None] * np.linspace(0, 0.9, 8)[:, None]
    x, y = np.clip(np.floor(between).astype(int), 0, [width - 1, height - 1]).transpose(2, 0, 1)
    clear = (sky[y, x].mean(axis=1) > _SKY_BETWEEN) & (away[row, column] < _FARTHEST * size_px)
    if clear.sum() < _ENOUGH:
        return None
    low, middle, high = np.percentile(away[row, column][clear], [25, 50, 75])
    return StrokeMargin(middle_px=float(middle), spread_px=float(high - low) / 2)
