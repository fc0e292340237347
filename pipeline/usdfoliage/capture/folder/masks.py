"""Masks: which pixels of a photograph are the plant."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.listing import counted
from usdfoliage.capture.folder.raster import Raster, apply_orientation, read_raster
from usdfoliage.errors import CaptureError
from usdfoliage.remarks import Remark, remark

logger = logging.getLogger(__name__)

_EXTREME_SHARE = 0.1  # grey within a tenth of black or white counts as black or white


@dataclass(frozen=True, kw_only=True)
class CleanMaskSettings:
    """What becomes of holes, and what is too small."""

    fill_holes_up_to: float = 1.0  # largest hole that is filled, as a share of the crown's area; 1 fills all, 0 none
    min_width_px: int = 24  # a crown smaller than this, either way, has no silhouette worth the name

    def __post_init__(self) -> None:
        if not 0 <= self.fill_holes_up_to <= 1:
            raise ValueError(f"fill_holes_up_to must be in [0, 1], not {self.fill_holes_up_to}")
        if self.min_width_px < 1:
            raise ValueError(f"min_width_px must be at least 1, not {self.min_width_px}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CleanMask:
    """One crown."""

    mask: NDArray[np.bool_]  # (H, W), one 8-connected component, holes filled: what the silhouette is of
    foliage: NDArray[np.bool_]  # (H, W), the same without what was filled: where the picture shows the plant
    remarks: tuple[Remark, ...]  # on what was changed, and where the crown is cut


def read_mask(path: Path, photo_shape: tuple[int, ...], photo_orientation: int = 1) -> NDArray[np.bool_]:
    """Read a mask, white = plant, as (H, W).

    A pixel is the plant where the mean of its channels is at least half of white, as encoded. Where alpha varies, it is
    the mask, unless the opaque pixels are themselves a black and white picture; then both must be white.

    Args:
        path: An image; of several pictures in it the first is taken.
        photo_shape: (height, width, …) of the photograph as shown, that is after its EXIF orientation.
        photo_orientation: That orientation. It also turns a mask whose size agrees only with the stored photograph.

    Raises:
        CaptureError: The file cannot be used (see read_raster), has another size, or is empty or full.
    """
    raster = read_raster(Path(path))
    mask, brightest = _threshold(raster)
    height, width = photo_shape[:2]
    if mask.shape != (height, width) and mask.shape == (width, height) and photo_orientation >= 5:
        logger.info("%s fits the photograph before its EXIF orientation %d; turned by it too", path, photo_orientation)
        mask = np.ascontiguousarray(apply_orientation(mask, photo_orientation))
    if mask.shape != (height, width):
        raise CaptureError(
            f"the mask {path} is {mask.shape[1]}×{mask.shape[0]} pixels, its photograph {width}×{height}; "
            f"they must have the same size"
        )
    if not mask.any():
        raise CaptureError(
            f"the mask {path} is empty: its brightest pixel is {brightest:.1%} of white, the plant must be above 50%",
            "paint the plant white",
        )
    if mask.all():
        raise CaptureError(f"the mask {path} is full: all {mask.size} pixels are white", "paint the background black")
    return mask


def clean_mask(mask: NDArray[np.bool_], settings: CleanMaskSettings = CleanMaskSettings()) -> CleanMask:
    """The largest component of a mask, with the sky gaps inside filled; its silhouette stays as it is.

    Args:
        mask: (H, W) bool, true = plant.

    Raises:
        ValueError: mask is not (H, W) of bool.
        CaptureError: No plant, or one below the minimum size.
    """
    if mask.ndim != 2 or mask.dtype != np.bool_:
        raise ValueError(f"mask must be (H, W) of bool, not {mask.shape} of {mask.dtype}")
    total = int(np.count_nonzero(mask))
    if total == 0:
        raise CaptureError("the mask is empty; at least one white region is needed")
    remarks: list[Remark] = []

    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    crown = labels == largest
    area = int(stats[largest, cv2.CC_STAT_AREA])
    if count > 2:
        text = f"{count - 1} components; the largest, {area / total:.1%} of the area, was taken"
        remarks.append(remark("mask-in-pieces", text))

    width, height = int(stats[largest, cv2.CC_STAT_WIDTH]), int(stats[largest, cv2.CC_STAT_HEIGHT])
    if min(width, height) < settings.min_width_px:
        raise CaptureError(
            f"the crown in the mask is {width}×{height} pixels; at least {settings.min_width_px} each way are needed: "
            f"use a larger photograph, or correct the mask"
        )

    foliage = crown
    crown, filled, filled_px, left = _fill_holes(crown, settings.fill_holes_up_to * area)
    if filled:
        text = f"{counted(filled, 'hole')} filled, {filled_px / area:.1%} of the area"
        remarks.append(remark("mask-holes-filled", text))
    if left:
        text = f"{counted(left, 'hole')} kept, larger than {settings.fill_holes_up_to:.1%} of the area"
        remarks.append(remark("mask-holes-kept", text))

    borders = {"left": crown[:, 0], "right": crown[:, -1], "top": crown[0], "bottom": crown[-1]}
    touched = [name for name, pixels in borders.items() if pixels.any()]
    if touched:
        text = f"the mask touches the image border ({', '.join(touched)}): the crown is cut there"
        remarks.append(remark("mask-at-border", text))
    return CleanMask(mask=crown, foliage=foliage, remarks=tuple(remarks))


def _threshold(raster: Raster) -> tuple[NDArray[np.bool_], float]:
    """The mask, and its brightest value, 1 for white."""
    white = 1.0 if raster.is_float else float(np.iinfo(raster.color.dtype).max)
    grey = raster.color.mean(axis=2, dtype=np.float32) / np.float32(white)
    if raster.alpha is None or raster.alpha.min() == raster.alpha.max():
        return grey >= 0.5, float(grey.max())
    alpha = raster.alpha / np.float32(white)
    if raster.premultiplied:
        grey = np.divide(grey, alpha, out=np.zeros_like(grey), where=alpha > 0)
    opaque = grey[alpha >= 0.5]
    if _is_black_and_white(opaque):
        product = grey * alpha
        return product >= 0.5, float(product.max())
    return alpha >= 0.5, float(alpha.max())


def _is_black_and_white(grey: NDArray[Any]) -> bool:
    black, white = grey <= _EXTREME_SHARE, grey >= 1 - _EXTREME_SHARE
    return bool(black.any() and white.any() and np.mean(black | white) > 0.95)


def _fill_holes(mask: NDArray[np.bool_], max_area: float) -> tuple[NDArray[np.bool_], int, int, int]:
    """Fill background regions (4-connected) that do not reach the image border.

    Returns:
        The mask, how many holes were filled, their pixels, how many were too large.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    is_hole = np.ones(count, np.bool_)
    is_hole[0] = False  # the mask itself
    for border in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        is_hole[border] = False
    areas = stats[:, cv2.CC_STAT_AREA]
    fill = is_hole & (areas <= max_area)
    return (
        mask | fill[labels],
        int(np.count_nonzero(fill)),
        int(areas[fill].sum()),
        int(np.count_nonzero(is_hole & ~fill)),
    )
