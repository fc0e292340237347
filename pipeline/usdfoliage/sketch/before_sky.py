"""The part of a crown that stands before the sky, and what that makes likely of the part below. Our own.

A proposed mask follows colours. Before the sky a tree is whatever is no sky, whatever its colours are: that part is
added down to the row where other plants join it. Below, the crown is about as wide as it was there, and closes towards
the bottom of the proposal.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.sketch.sky_behind import share_of_tree

Mask = NDArray[np.bool_]

_AXIS = 0.12  # of the picture's width, to either side of the crown's middle, where its upper part stands
_WIDEST = 0.85  # of the picture's width, that a crown before the sky has at most
_ABOVE = 0.06  # of the picture's height, above the proposal, where that part may begin
_ENOUGH = 0.08  # of the picture's height: rows before the sky that are worth it
_LOWEST = 0.2  # of that part's height from below, whose width the rest has
_WIDER = 1.4  # than that, which the proposal may be below
_NARROW = 0.6  # of half of an ellipse: a proposal that holds less of it lost the lower part of the crown
_SHARE = 0.25  # of a pixel before the sky, that is the tree
_BELOW = 2.0  # of that width: depth of the rest, at most


def complete_before_sky(mask: Mask, sky: Mask, colors: NDArray[np.float64]) -> Mask:
    """A proposed crown with all that stands before the sky; as it is, where the sky shows no such part.

    Args:
        mask: (H, W), not empty.
        sky: (H, W), of the same picture.
        colors: (H, W, 3), of the same picture, 0 to 255.
    """
    height = len(mask)
    rows, columns = np.nonzero(mask)
    bottom, axis = int(rows.max()), float(np.median(columns))
    behind = share_of_tree(colors, sky, ~sky, 0.5 * max(mask.shape))
    solid = np.where(behind.known, behind.share > _SHARE, ~sky).astype(np.uint8)
    solid = cv2.morphologyEx(solid, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    found = _lowest_part(solid, axis, int(rows.min()), bottom)
    if found is None:
        return mask
    part, last = found
    of_part = np.flatnonzero(part.any(axis=1))
    if len(of_part) < _ENOUGH * height:
        return mask
    lower = part[last - round(_LOWEST * len(of_part)) : last + 1]
    # Medians of the rows: what stands beside the tree may join it in the last ones.
    left, right = lower.argmax(axis=1), lower.shape[1] - 1 - lower[:, ::-1].argmax(axis=1)
    middle, half = (float(np.median(each)) for each in ((left + right) / 2, (right - left + 1) / 2))
    bottom = min(bottom, last + round(_BELOW * 2 * half))
    likely, widest = (_closing(mask.shape, last, bottom, middle, wider * half) for wider in (1.0, _WIDER))
    rest = mask & widest
    rest[: last + 1] = False
    if rest.sum() < _NARROW * likely.sum():
        rest |= likely
    together = (part | rest).astype(np.uint8)
    contours, _ = cv2.findContours(together, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(together, contours, -1, 1, cv2.FILLED)  # sky that shines through is inside
    return together > 0


def _lowest_part(solid: NDArray[np.uint8], axis: float, first: int, last: int) -> tuple[Mask, int] | None:
    """What stands before the sky about an axis, down to the last row where it joins nothing wider, and that row."""
    height, width = solid.shape
    near = np.abs(np.arange(width) - axis) <= _AXIS * width
    best = None
    for row in range(max(1, first - round(_ABOVE * height)), last + 1, max(1, height // 200)):
        count, labels, stats, _ = cv2.connectedComponentsWithStats(solid[: row + 1])
        here = labels[row][near]
        here = here[here > 0]
        if count < 2 or not len(here):
            continue
        number = int(np.bincount(here).argmax())
        left, wide = stats[number, cv2.CC_STAT_LEFT], stats[number, cv2.CC_STAT_WIDTH]
        if left <= 0 or left + wide >= width or wide > _WIDEST * width:
            break
        part = np.zeros(solid.shape, bool)
        part[: row + 1] = labels == number
        best = part, row
    return best


def _closing(shape: tuple[int, ...], first: int, last: int, middle: float, half: float) -> Mask:
    """(H, W) half of an ellipse that hangs from a row."""
    row, column = np.mgrid[: shape[0], : shape[1]]
    down = (row - first) / max(last - first, 1)
    return np.asarray((down >= 0) & (((column - middle) / max(half, 1.0)) ** 2 + down**2 <= 1))
