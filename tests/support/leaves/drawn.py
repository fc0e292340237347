"""Pictures of single leaves, drawn from formulas: an ellipse that is red at its base and green at its apex."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.geometry.color import encode_srgb


def drawn_leaf(width_px: int = 60, height_px: int = 100, around_px: int = 20) -> NDArray[np.float32]:
    """(H, W, 4), linear: an ellipse with transparent pixels around, its base below."""
    y, x = np.mgrid[0 : height_px + 2 * around_px, 0 : width_px + 2 * around_px] + 0.5
    across = (x - around_px - width_px / 2) / (width_px / 2)
    along = (y - around_px - height_px / 2) / (height_px / 2)
    leaf = across**2 + along**2 <= 1
    share = np.clip((along + 1) / 2, 0, 1)  # 0 at the apex, 1 at the base
    color = np.stack([0.05 + 0.25 * share, 0.3 - 0.2 * share, np.full_like(share, 0.04)], axis=-1)
    return np.dstack([np.where(leaf[..., None], color, 0.9), leaf]).astype(np.float32)


def write_leaf(path: Path, rgba: NDArray[np.floating]) -> Path:
    """The picture as a PNG of sRGB and opacity; returns path."""
    pixels = np.rint(255 * np.clip(np.dstack([encode_srgb(rgba[..., :3]), rgba[..., 3]]), 0, 1)).astype(np.uint8)
    assert cv2.imwrite(str(path), np.ascontiguousarray(pixels[..., [2, 1, 0, 3]]))
    return path
