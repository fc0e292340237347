"""Pictures of texels that were computed, as files."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import AssetError
from usdfoliage.files.atomic import whole_file
from usdfoliage.geometry.color import encode_srgb


def write_texels(path: Path, texels: NDArray[np.floating]) -> None:
    """Write a PNG of sRGB numbers, and opacity, from linear texels (H, W, 3 or 4), not multiplied by it, 0 to 1.

    Raises:
        AssetError: It cannot be encoded.
        WriteError: It cannot be written.
    """
    numbers = np.dstack([encode_srgb(np.asarray(texels[..., 2::-1], np.float32)), texels[..., 3:]])
    pixels = np.rint(255 * np.clip(numbers, 0, 1)).astype(np.uint8)
    good, encoded = cv2.imencode(".png", np.ascontiguousarray(pixels))
    if not good:
        raise AssetError(f"the picture {path.name} could not be encoded")
    with whole_file(path) as new:
        new.write_bytes(encoded.tobytes())
