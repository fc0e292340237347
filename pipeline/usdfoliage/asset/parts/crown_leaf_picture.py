"""The picture of a leaf that the leaves of a crown are cut out by, as a file of an asset."""

from pathlib import Path

import numpy as np

from usdfoliage.asset.materials.picture import write_texels
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
