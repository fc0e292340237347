"""The map of the silhouette's jitter, from an image file."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from usdfoliage.asset.packed_files import is_packed, unpacked
from usdfoliage.errors import CaptureError
from usdfoliage.files.library_text import library_text

MIN_TEXELS = 2  # one alone is no wave
MAX_TEXELS = 16_384  # what OpenGL takes in one row


def read_jitter_map(path: Path) -> NDArray[np.float64]:
    """One cycle of the jitter (M,), -1 inwards to 1 outwards: the first row of the image's first channel, 0 to 1.

    Raises:
        AssetError: It is not in the package that it should lie in.
        CaptureError: The file is missing, is no image, is narrower than MIN_TEXELS or wider than MAX_TEXELS, or has
            values outside 0 to 1.
    """
    if is_packed(path):
        with unpacked(path) as file:
            return read_jitter_map(file)
    if not path.is_file():
        raise CaptureError(f"{path} is missing", "name an image whose first row is one cycle of the jitter")
    try:
        source = oiio.ImageInput.open(str(path))
    except TypeError as error:  # a name that is not valid Unicode
        raise CaptureError(f"the file name of {path!r} is not valid Unicode", "rename it") from error
    if source is None:
        reason = library_text(oiio.geterror) or "no reason given"
        raise CaptureError(f"{path} is not an image that can be read ({reason})", "use PNG, TIFF or EXR")
    try:
        spec = source.spec()
        if spec.width < MIN_TEXELS:
            raise CaptureError(f"{path} is {spec.width} pixel wide; a wave needs {MIN_TEXELS} or more")
        if spec.width > MAX_TEXELS:
            raise CaptureError(f"{path} is {spec.width} pixels wide, {MAX_TEXELS} are allowed", "scale it down")
        pixels = source.read_image(0, 0, 0, 1, oiio.FLOAT)
        reason = library_text(source.geterror)
    finally:
        source.close()
    if pixels is None:
        why = reason or "no reason given"
        raise CaptureError(f"{path} cannot be read to its end ({why})", "write it again")
    row = np.asarray(pixels, np.float64).reshape(spec.height, spec.width, -1)[0, :, 0]
    if not ((row >= 0) & (row <= 1)).all():  # false for NaN too
        raise CaptureError(
            f"{path} has values from {row.min():g} to {row.max():g}; 0 (inwards) to 1 (outwards) are needed"
        )
    return 2 * row - 1
