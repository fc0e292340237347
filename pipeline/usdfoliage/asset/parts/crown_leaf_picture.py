"""The picture that the leaves of a crown are cut out by, and the colours of all of them, as files of an asset."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.crown.leaf_picture import LeafPicture
from usdfoliage.errors import AssetError
from usdfoliage.files.atomic import whole_file
from usdfoliage.geometry.color import encode_srgb


def brightness_of(leaf: LeafPicture) -> float:
    """Factor on the numbers of the file: it holds no number above 1, and a leaf is brighter than its mean in places."""
    return max(1.0, float(leaf.rgba[..., :3].max()))


def write_leaf_picture(path: Path, leaf: LeafPicture) -> None:
    """Write a PNG of sRGB numbers and opacity; what it holds times brightness_of is the leaf.

    Raises:
        AssetError: It cannot be encoded.
        WriteError: It cannot be written.
    """
    color = encode_srgb(leaf.rgba[..., :3] / np.float32(brightness_of(leaf)))
    _write_png(path, np.dstack([color, leaf.rgba[..., 3]])[..., [2, 1, 0, 3]])


def write_leaf_colors(path: Path, color: NDArray[np.floating]) -> None:
    """Write a square PNG of sRGB numbers: the colours (N, L, 3) of the leaves of clusters, linear, row after row."""
    leaves = encode_srgb(np.clip(color, 0, 1).reshape(-1, 3).astype(np.float32))
    side = int(np.ceil(np.sqrt(len(leaves))))
    square = np.zeros((side * side, 3), np.float32)
    square[: len(leaves)] = leaves
    _write_png(path, square.reshape(side, side, 3)[..., ::-1])


def _write_png(path: Path, channels: NDArray[np.floating]) -> None:
    """Write (H, W, C) numbers from 0 to 1, blue first."""
    good, encoded = cv2.imencode(".png", np.ascontiguousarray(np.rint(255 * np.clip(channels, 0, 1)).astype(np.uint8)))
    if not good:
        raise AssetError(f"the picture {path.name} could not be encoded")
    with whole_file(path) as new:
        new.write_bytes(encoded.tobytes())
