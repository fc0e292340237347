"""How much of a pixel is tree, where sky is behind it. Our own.

Fine leaves and twigs are narrower than a pixel, whose colour then is a mixture of theirs and the sky's. A mixture of
normal distributions takes it for sky. The sky's colour is known beside it, and that of the leaves too, so that the
share of the leaves is.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_NEAR = 0.05  # of the crown's size, within which colours of sky and of leaves are taken
_WIDER = 5.0  # times as far, where none is as near as that
_SMALL = 0.25  # of that distance, the pixels of the smaller picture in which it is measured
_FAINT = 1e-4  # weight of the colour that is taken where there is no other
_SOME = 0.03  # weight of sky near a pixel, from which on it is known
_BESIDE_PX = 2.0  # from leaves, that pure sky keeps; and leaves from what is none
_APART = 30.0  # difference of colours, from which on a share is known


@dataclass(frozen=True, kw_only=True, eq=False)
class SkyBehind:
    """The share of the tree in pixels that have sky beside them."""

    share: Floats  # (H, W) 0 sky, 1 tree; may leave that range
    known: Mask  # (H, W), sky is beside the pixel
    before_sky: Mask  # (H, W), sky is in that part of the crown, and may shine through
    pure: Mask  # (H, W) sky alone


def share_of_tree(colors: Floats, sky: Mask, tree: Mask, size_px: float) -> SkyBehind:
    """How much of each pixel is tree.

    Args:
        colors: (H, W, 3), 0 to 255.
        sky: (H, W), about where sky is.
        tree: (H, W), about where the tree is.
        size_px: Of the crown.
    """
    sigma = max(1.0, _NEAR * size_px)
    pure = sky & (_away_from(tree) > _BESIDE_PX)
    deep = tree & (_away_from(~tree) > _BESIDE_PX)
    deep = deep if deep.any() else tree
    far_sky, some_sky = _mean_far(colors, pure, _WIDER * sigma)
    of_sky, near_sky = _mean_near(colors, pure, sigma, far_sky)
    of_tree, _ = _mean_near(colors, deep, 2 * sigma, _mean(colors, deep))
    across = of_tree - of_sky
    square = (across**2).sum(axis=2)
    share = ((colors - of_sky) * across).sum(axis=2) / np.maximum(square, 1.0)
    apart = square > _APART**2
    return SkyBehind(share=share, known=(near_sky > _SOME) & apart, before_sky=(some_sky > _SOME) & apart, pure=pure)


def _away_from(mask: Mask) -> NDArray[np.float32]:
    """(H, W) pixels to the nearest one of a mask; far where it is empty."""
    if not mask.any():
        return np.full(mask.shape, 1e6, np.float32)
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


def _mean(colors: Floats, mask: Mask) -> Floats:
    """(3,) the mean colour of a mask's pixels; of all where it is empty."""
    return np.asarray(colors[mask].mean(axis=0) if mask.any() else colors.mean(axis=(0, 1)))


def _mean_far(colors: Floats, mask: Mask, sigma: float) -> tuple[Floats, Floats]:
    """As _mean_near, of all pixels far from the mask's, in a smaller picture: what is so smooth has few pixels."""
    height, width = mask.shape
    shrink = max(1.0, _SMALL * sigma)
    size = (max(1, round(width / shrink)), max(1, round(height / shrink)))
    weight, total = (
        cv2.GaussianBlur(cv2.resize(each, size, interpolation=cv2.INTER_AREA), (0, 0), sigma / shrink)
        for each in (mask.astype(np.float64), colors * mask[..., None])
    )
    mean = (total + _FAINT * _mean(colors, mask)) / (weight + _FAINT)[..., None]
    wide, known = (cv2.resize(each, (width, height), interpolation=cv2.INTER_LINEAR) for each in (mean, weight))
    return np.asarray(wide), np.asarray(known)


def _mean_near(colors: Floats, mask: Mask, sigma: float, elsewhere: Floats) -> tuple[Floats, Floats]:
    """(H, W, 3) the mean colour of a mask's pixels near each place, and (H, W) the weight that they have there.

    Far from all of them it is another one, (H, W, 3) or (3,).
    """
    weight = cv2.GaussianBlur(mask.astype(np.float64), (0, 0), sigma)
    total = cv2.GaussianBlur(colors * mask[..., None], (0, 0), sigma)
    return (total + _FAINT * elsewhere) / (weight + _FAINT)[..., None], weight
