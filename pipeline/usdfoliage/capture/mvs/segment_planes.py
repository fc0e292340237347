"""Segments of one colour in a photograph, and the plane of each: what holds depth together where there is no texture.

Equation 2 of J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020: each segment of a
mean-shift segmentation is one plane, from which the depth of its pixels should not differ. Mean shift alone joins a
leaf with the next one over a soft shadow; its colours are therefore parted into superpixels, none of which is large.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class SegmentSettings:
    """How photographs are segmented, and which planes are believed."""

    spatial_px: int = 4  # Mean shift has this radius in the picture. Unit: pixels. Range: 1 or more.
    color: float = 15.0  # Mean shift has this radius in colour. Unit: of 255. Range: above 0.
    size_px: int = 14  # Segments are about this wide and high. Unit: pixels. Range: 4 or more.
    compactness: float = 12.0  # Segments follow colour less and are rounder where this is larger. Range: above 0.
    min_px: int = 20  # A segment with depth at fewer pixels gets no plane. Unit: pixels. Range: 3 or more.
    refits: int = 4  # A plane is fitted again this often, and outliers weigh less each time. Range: 1 or more.
    # A plane is believed where it fits at least this share of its segment's pixels. Range: 0 to 1.
    min_share: float = 0.4

    def __post_init__(self) -> None:
        if self.spatial_px < 1 or self.size_px < 4 or self.min_px < 3 or self.refits < 1:
            raise ValueError("spatial_px and refits must be at least 1, size_px 4 and min_px 3")
        if not (self.color > 0 and self.compactness > 0 and 0 <= self.min_share <= 1):
            raise ValueError("color and compactness must be above 0, min_share in [0, 1]")


def segment_photo(srgb: NDArray[np.uint8], settings: SegmentSettings = SegmentSettings()) -> NDArray[np.int32]:
    """The segment (H, W), from 0, of every pixel of a photograph (H, W, 3)."""
    smooth = cv2.pyrMeanShiftFiltering(
        np.ascontiguousarray(srgb), settings.spatial_px, settings.color, None, 1, (3, 4, 1.0)
    )
    pixels = cv2.ximgproc.createSuperpixelSLIC(
        cv2.cvtColor(smooth, cv2.COLOR_RGB2Lab), cv2.ximgproc.SLICO, settings.size_px, settings.compactness
    )
    pixels.iterate(5)
    pixels.enforceLabelConnectivity(15)
    return np.asarray(pixels.getLabels(), np.int32)


def fit_segment_planes(
    slopes: NDArray[np.float32],
    cost: NDArray[np.float32],
    labels: NDArray[np.int32],
    tolerance: float,
    settings: SegmentSettings = SegmentSettings(),
) -> NDArray[np.float32]:
    """The plane of each pixel's segment, as inverse depth and its slopes (H, W, 3), as MatchedPlanes holds them.

    A surface's plane is a linear function of the pixel in inverse depth. It is fitted by weighted least squares from
    the segment's median on, pixels that match well weigh more, those far from the plane nothing.

    Args:
        slopes: (H, W, 3), the pixels' own planes; inverse depth 0 for none.
        cost: (H, W), of them.
        labels: (H, W), segments from 0.
        tolerance: Inverse depth that a pixel may differ by and still belong to a plane.
        settings: Which planes are believed.

    Returns:
        0 where a segment has no plane.
    """
    height, width = labels.shape
    rows, columns = np.meshgrid(np.arange(height, dtype=np.float64), np.arange(width, dtype=np.float64), indexing="ij")
    has = slopes[..., 0] > 0
    label, x, y = labels[has], columns[has], rows[has]
    value, weight = slopes[..., 0][has].astype(np.float64), np.exp(-2 * cost[has].astype(np.float64))
    count = int(labels.max()) + 1
    size = np.bincount(labels.ravel(), minlength=count)
    center_x = np.bincount(labels.ravel(), columns.ravel(), count) / np.maximum(size, 1)
    center_y = np.bincount(labels.ravel(), rows.ravel(), count) / np.maximum(size, 1)
    x -= center_x[label]
    y -= center_y[label]

    order = np.lexsort((value, label))
    first = np.searchsorted(label[order], np.arange(count + 1))
    with_depth = np.diff(first)
    middle = np.minimum(first[:-1] + with_depth // 2, max(0, len(order) - 1))
    planes = np.zeros((count, 3))  # value at the segment's centre, slopes right and down
    planes[:, 0] = np.where(with_depth > 0, value[order][middle] if len(order) else 0.0, 0.0)

    counts = np.zeros(count, np.int64)
    for refit in range(settings.refits + 1):
        away = np.abs(value - planes[label, 0] - planes[label, 1] * x - planes[label, 2] * y)
        reach = tolerance * max(1.0, 2.0 ** (settings.refits - 1 - refit))  # tilted ones are far from their median
        counts = np.bincount(label[away <= reach], minlength=count)
        if refit == settings.refits:
            break
        part = weight * np.maximum(0, 1 - (away / reach) ** 2) ** 2
        one = np.ones_like(x)
        sums = [np.bincount(label, part * factor, count) for factor in (one, x, y, x * x, x * y, y * y)]
        right = [np.bincount(label, part * factor * value, count) for factor in (one, x, y)]
        normal = np.stack([sums[k] for k in (0, 1, 2, 1, 3, 4, 2, 4, 5)], -1).reshape(-1, 3, 3).astype(np.float64)
        # Thin segments do not show how they tilt across.
        normal += np.einsum("n,ij->nij", 0.5 + 1e-3 * sums[0], np.diag([0.0, 1.0, 1.0])) + np.diag([1e-9, 0, 0])
        planes = np.asarray(np.linalg.solve(normal, np.stack(right, -1)[..., None])[..., 0], np.float64)
    believed = (with_depth >= settings.min_px) & (counts >= settings.min_share * size) & (planes[:, 0] > 0)

    own = planes[labels]
    field = np.empty((height, width, 3), np.float32)
    field[..., 0] = own[..., 0] + own[..., 1] * (columns - center_x[labels]) + own[..., 2] * (rows - center_y[labels])
    field[..., 1:] = own[..., 1:]
    field[~believed[labels] | (field[..., 0] <= 0)] = 0
    return field
