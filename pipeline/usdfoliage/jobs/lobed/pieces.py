"""The leaves in a scan: which pixels are leaf, and which of them are one leaf."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.remarks import Argument

_BORDER = 0.02  # of the shorter side: the frame whose colour is that of the background
_CONTRAST = 0.08  # of white, in the mean, by which a leaf differs from the background
_COVER = (0.002, 0.98)  # share of the picture that leaves cover
_GRAIN = 5  # pixels across: what is smaller is grain of the picture
_WHOLE = 0.01  # share of what stands out that its largest piece has; of grain no piece has so much


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


def threshold_leaf(linear: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) what differs in colour from the frame of a picture (H, W, 3), linear, by the threshold of Otsu.

    Raises:
        CaptureError: Nothing stands out clearly from the frame.
    """
    encoded = np.clip(encode_srgb(linear), 0, 1).astype(np.float32)
    width = max(1, round(_BORDER * min(linear.shape[:2])))
    inner = encoded[width:-width, width:-width]
    framed = np.ones(linear.shape[:2], bool)
    framed[width : width + inner.shape[0], width : width + inner.shape[1]] = False
    background = np.median(encoded[framed], axis=0)
    away = np.linalg.norm(encoded - background, axis=2) / np.sqrt(3)
    levels = cv2.medianBlur(np.rint(255 * np.clip(away, 0, 1)).astype(np.uint8), _GRAIN)
    threshold, _ = cv2.threshold(levels, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    mask = levels > threshold
    cover = float(mask.mean())
    contrast = float(away[mask].mean() - away[~mask].mean()) if 0 < cover < 1 else 0.0
    areas = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)[2][1:, cv2.CC_STAT_AREA]
    is_whole = len(areas) > 0 and areas.max() >= _WHOLE * areas.sum()
    if contrast < _CONTRAST or not is_whole or not _COVER[0] <= cover <= _COVER[1]:
        raise CaptureError(
            f"no leaf stands out from the background: {cover:.1%} of the picture differ from its frame, by "
            f"{contrast:.1%} of white in the mean, where {_CONTRAST:.0%} are needed",
            ("paint the leaf white on black, and give that with ", Argument(name="mask")),
        )
    return mask
