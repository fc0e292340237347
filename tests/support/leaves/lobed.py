"""Lobed leaves that are drawn: round lobes of any lengths and directions around a middle, with a petiole below."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.leaf.lobed.branches import LobedShape, build_branches
from usdfoliage.leaf.lobed.model import model_lobed_leaf


def lobed_mask(angles_deg: Sequence[float] = (-20, 35, 90, 145, 200), size: int = 240) -> NDArray[np.bool_]:
    """(size, size) a lobe in each direction, from the right counter-clockwise."""
    mask = np.zeros((size, size), np.uint8)
    middle = np.array([size / 2, size / 2])
    cv2.circle(mask, tuple(middle.astype(int)), size // 8, 1, cv2.FILLED)
    for number, angle in enumerate(np.radians(angles_deg)):
        reach = (0.36, 0.42)[number % 2] * size
        tip = middle + reach * np.array([np.cos(angle), -np.sin(angle)])
        cv2.line(mask, tuple(middle.astype(int)), tuple(tip.astype(int)), 1, size // 9)
    cv2.line(mask, tuple(middle.astype(int)), (size // 2, int(0.95 * size)), 1, max(3, size // 60))
    return mask.astype(bool)


def lobed_shape(angles_deg: Sequence[float] = (-20, 35, 90, 145, 200), size: int = 240) -> LobedShape:
    """Its branches and ties, in pixels with y up."""
    return build_branches(model_lobed_leaf(lobed_mask(angles_deg, size)).ties)
