"""The leaves in a scan: which pixels are leaf, and which of them are one leaf."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError, FitError
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.leaf.lobed.cutout import Finding, cut_out_leaves
from usdfoliage.remarks import Argument

_INSIDE = 0.5  # of a pixel, from which on it is of the leaf


@dataclass(frozen=True, kw_only=True)
class PieceSettings:
    """What of a mask is a leaf."""

    smallest: float = 0.02  # of the area of the largest piece; smaller ones are dust
    min_px: int = 400  # of a leaf
    max_leaves: int = 99  # leaves of one scan

    def __post_init__(self) -> None:
        if not (0 < self.smallest < 1 and self.min_px >= 1 and 1 <= self.max_leaves <= 99):
            raise ValueError("smallest must be between 0 and 1, min_px at least 1, max_leaves 1 to 99")


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafPieces:
    """The leaves of a mask, from left to right."""

    labels: NDArray[np.int32]  # (H, W), number of the piece of each pixel
    numbers: tuple[int, ...]  # of the pieces that are leaves
    boxes_px: tuple[tuple[int, int, int, int], ...]  # left, top, width and height of each
    dust: int  # pieces that are too small

    def mask(self, leaf: int) -> NDArray[np.bool_]:
        """(H, W) of one leaf."""
        return self.labels == self.numbers[leaf]

    def is_cut(self, leaf: int) -> bool:
        """Whether a leaf reaches the border of the picture."""
        left, top, width, height = self.boxes_px[leaf]
        rows, columns = self.labels.shape
        return left == 0 or top == 0 or left + width == columns or top + height == rows


def split_pieces(mask: NDArray[np.bool_], settings: PieceSettings = PieceSettings()) -> LeafPieces:
    """The leaves of a mask (H, W).

    Raises:
        CaptureError: It has no leaf of enough pixels, or too many.
    """
    _, labels, measures, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = measures[1:, cv2.CC_STAT_AREA]
    largest = int(areas.max()) if len(areas) else 0
    if largest < settings.min_px:
        raise CaptureError(
            f"the largest piece of the mask has {largest} pixels, and a leaf needs {settings.min_px}",
            "scan the leaf at a higher resolution, or correct the mask",
        )
    leaves = 1 + np.flatnonzero((areas >= settings.smallest * largest) & (areas >= settings.min_px))
    if len(leaves) > settings.max_leaves:
        raise CaptureError(
            f"the mask has {len(leaves)} pieces, and at most {settings.max_leaves} leaves are taken from one scan",
            "cut the scan into several, or correct the mask",
        )
    leaves = leaves[np.lexsort((measures[leaves, cv2.CC_STAT_TOP], measures[leaves, cv2.CC_STAT_LEFT]))]
    return LeafPieces(
        labels=labels,
        numbers=tuple(leaves.tolist()),
        boxes_px=tuple((int(left), int(top), int(wide), int(high)) for left, top, wide, high in measures[leaves, :4]),
        dust=len(areas) - len(leaves),
    )


def cut_out_scan(linear: NDArray[np.float32]) -> tuple[NDArray[np.bool_], frozenset[Finding]]:
    """(H, W) where leaves are in a picture (H, W, 3), linear, and what was found about them.

    Raises:
        CaptureError: No leaf was found.
    """
    encoded = np.rint(255 * np.clip(encode_srgb(linear), 0, 1)).astype(np.uint8)
    try:
        found = cut_out_leaves(encoded)
    except FitError as error:
        remedy = ("paint the leaf white on black, and give that with ", Argument(name="mask"))
        raise CaptureError(error.text, remedy) from error
    mask = np.zeros(found.reduced.shape[:2], np.float32)
    for leaf in found.leaves:
        (row, column), (height, width) = leaf.corner, leaf.mask.shape
        mask[row : row + height, column : column + width][leaf.mask] = 1
    if mask.shape != linear.shape[:2]:
        mask = cv2.resize(mask, linear.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return mask >= _INSIDE, frozenset().union(*(leaf.findings for leaf in found.leaves))
