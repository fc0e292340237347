"""Superpixels: small regions of one colour, the grains that leaves are put together from.

Source: G. Chaurasia, P. Beardsley, Editable Parametric Dense Foliage from 3D Capture, 2017, section 4.1; R. Achanta et
al., SLIC Superpixels Compared to State-of-the-art Superpixel Methods, 2012.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class SuperpixelSettings:
    """How fine a picture is divided."""

    # A superpixel is this wide and high; auto derives it from the size of the picture. Unit: pixels. Range: 3 or
    # more.
    size_px: int | None = None
    # Where size_px is auto, the picture's longer side has this many superpixels at most. Range: 2 or more.
    finest: int = 120
    # A colour difference of this size weighs as much as one side of a superpixel. Larger values give rounder
    # superpixels. Unit: Lab units. Range: above 0.
    ruler: float = 12.0
    iterations: int = 8  # Pixels are clustered in this many iterations. Range: 1 or more.
    smallest: float = 0.15  # A superpixel below this share of size_px² is merged with a neighbour. Range: 0 to below 1.

    def __post_init__(self) -> None:
        if self.size_px is not None and self.size_px < 3:
            raise ValueError(f"size_px must be at least 3, not {self.size_px}")
        if self.finest < 2 or self.iterations < 1:
            raise ValueError(f"finest must be at least 2 and iterations at least 1, not {self}")
        if self.ruler <= 0 or not 0 <= self.smallest < 1:
            raise ValueError(f"ruler must be above 0 and smallest in [0, 1), not {self}")

    def side_px(self, height_px: int, width_px: int) -> int:
        """The side of a superpixel in a picture of this size."""
        if self.size_px is not None:
            return self.size_px
        return max(5, round(max(height_px, width_px) / self.finest))


def segment_superpixels(
    srgb: NDArray[np.uint8],
    valid: NDArray[np.bool_] | None = None,
    settings: SuperpixelSettings = SuperpixelSettings(),
) -> NDArray[np.int32]:
    """Divide a picture into superpixels, by SLIC on Lab.

    Args:
        srgb: (H, W, 3), red, green, blue, encoded for display.
        valid: (H, W), where superpixels are wanted; everywhere if None.
        settings: Their size.

    Returns:
        (H, W): their numbers, from 0 without gaps, in the order of their first pixels; -1 where not valid.

    Raises:
        ValueError: The arrays are not of these shapes.
    """
    if srgb.ndim != 3 or srgb.shape[2] != 3 or srgb.dtype != np.uint8:
        raise ValueError(f"srgb must be (H, W, 3) of uint8, not {srgb.shape} of {srgb.dtype}")
    height, width = srgb.shape[:2]
    if valid is not None and valid.shape != (height, width):
        raise ValueError(f"valid must be {(height, width)}, not {valid.shape}")
    side = min(settings.side_px(height, width), height, width)
    if side < 3:  # a picture this narrow has no regions to find
        labels = np.zeros((height, width), np.int32)
    else:
        lab = cv2.cvtColor(cv2.GaussianBlur(srgb, (3, 3), 0), cv2.COLOR_RGB2LAB)
        slic = cv2.ximgproc.createSuperpixelSLIC(lab, cv2.ximgproc.SLIC, side, settings.ruler)
        slic.iterate(settings.iterations)
        slic.enforceLabelConnectivity(round(100 * settings.smallest))
        labels = np.asarray(slic.getLabels(), np.int32)
    if valid is not None:
        labels = np.where(valid, labels, -1)
    return renumber(labels)


def renumber(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Number what is not below 0 from 0 without gaps, in the order of first pixels."""
    flat = labels.ravel()
    known = flat >= 0
    numbers, first, inverse = np.unique(flat[known], return_index=True, return_inverse=True)
    order = np.empty(len(numbers), np.int32)
    order[np.argsort(first)] = np.arange(len(numbers), dtype=np.int32)
    result = np.full(flat.shape, -1, np.int32)
    result[known] = order[inverse]
    return result.reshape(labels.shape)
