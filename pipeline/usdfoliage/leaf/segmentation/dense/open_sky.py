"""The sky of depth maps: what has no depth since nothing is there."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

OPEN_PX, OPEN_SHARE = 6, 0.01  # radius of a disc that fits into open sky, in pixels and in the longer side
FAR = 4.0  # times the greatest depth, where the sky is put


def put_sky_far(depths_m: Sequence[NDArray[np.float32]]) -> list[NDArray[np.float32]]:
    """Depth maps (H, W) in which large areas without depth lie far behind all else: leaves end before them.

    Small ones are holes, which do not count.
    """
    far_m = FAR * max(float(depth_m.max(initial=0.0)) for depth_m in depths_m)
    filled = []
    for depth_m in depths_m:
        empty = (depth_m <= 0).astype(np.uint8)
        radius = max(OPEN_PX, round(OPEN_SHARE * max(depth_m.shape)))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        wide = cv2.copyMakeBorder(empty, radius, radius, radius, radius, cv2.BORDER_REPLICATE)
        sky = cv2.morphologyEx(wide, cv2.MORPH_OPEN, disc)[radius:-radius, radius:-radius] > 0
        filled.append(np.where(sky & (empty > 0), np.float32(far_m), depth_m).astype(np.float32))
    return filled
