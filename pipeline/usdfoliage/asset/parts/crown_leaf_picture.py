"""The picture of a leaf that the leaves of a crown are cut out by."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import AssetError
from usdfoliage.files.atomic import whole_file

LEAF_PX = 128  # along a side


def write_leaf_picture(path: Path) -> None:
    """Write a picture of a leaf in grey, its mean brightness 1, to be coloured; transparent beside the leaf.

    Raises:
        AssetError: It cannot be encoded.
        WriteError: It cannot be written.
    """
    good, encoded = cv2.imencode(".png", leaf_picture())
    if not good:
        raise AssetError(f"the picture {path.name} could not be encoded")
    with whole_file(path) as new:
        new.write_bytes(encoded.tobytes())


def leaf_picture(size: int = LEAF_PX) -> NDArray[np.uint8]:
    """(size, size, 4) a leaf with a midrib and veins; its base is below."""
    across, down = np.meshgrid(np.linspace(-1, 1, size), np.linspace(1, 0, size))
    half = 0.98 * np.sin(np.pi * np.clip(down, 0, 1)) ** 0.75 * (1.15 - 0.3 * down)
    inside = np.abs(across) < np.minimum(half, 1.0)
    veins = np.cos(2 * np.pi * 7 * (down - 0.35 * np.abs(across)))
    shade = 0.8 + 0.05 * veins + 0.12 * np.exp(-((across / 0.05) ** 2)) - 0.08 * np.abs(across)
    grey = np.rint(255 * np.clip(shade, 0, 1)).astype(np.uint8)
    return np.dstack([grey, grey, grey, np.where(inside, 255, 0).astype(np.uint8)])
