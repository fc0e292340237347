"""The picture that the leaves of a crown are cut out by, and the colours of all of them, as files of an asset."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.materials.texels import write_texels
from usdfoliage.crown.leaf_picture import LeafPicture


def brightness_of(leaf: LeafPicture) -> float:
    """Factor on the numbers of the file: it holds no number above 1, and a leaf is brighter than its mean in places."""
    return max(1.0, float(leaf.rgba[..., :3].max()))


def write_leaf_picture(path: Path, leaf: LeafPicture) -> None:
    """Write a PNG of sRGB numbers and opacity; what it holds times brightness_of is the leaf.

    Raises:
        AssetError: It cannot be encoded.
        WriteError: It cannot be written.
    """
    write_texels(path, np.dstack([leaf.rgba[..., :3] / np.float32(brightness_of(leaf)), leaf.rgba[..., 3]]))


def write_leaf_colors(path: Path, color: NDArray[np.floating]) -> None:
    """Write a square PNG of the linear colours (N, L, 3) of the leaves of clusters, row after row.

    Raises:
        AssetError: It cannot be encoded.
        WriteError: It cannot be written.
    """
    leaves = color.reshape(-1, 3)
    side = int(np.ceil(np.sqrt(len(leaves))))
    square = np.zeros((side * side, 3), np.float32)
    square[: len(leaves)] = leaves
    write_texels(path, square.reshape(side, side, 3))
