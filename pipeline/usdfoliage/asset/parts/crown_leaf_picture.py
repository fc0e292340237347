"""The picture of a leaf that the leaves of a crown are cut out by, as a file of an asset."""

from pathlib import Path

import cv2
import numpy as np

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
    rgba = np.rint(255 * np.clip(np.dstack([color, leaf.rgba[..., 3]]), 0, 1)).astype(np.uint8)
    good, encoded = cv2.imencode(".png", np.ascontiguousarray(rgba[..., [2, 1, 0, 3]]))
    if not good:
        raise AssetError(f"the picture {path.name} could not be encoded")
    with whole_file(path) as new:
        new.write_bytes(encoded.tobytes())
