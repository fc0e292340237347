"""Pictures as files: whether a file is one, which numbers it holds, its copy in an asset, and one of texels."""

from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from usdfoliage.errors import AssetError
from usdfoliage.files.atomic import copy_whole, whole_file
from usdfoliage.files.library_text import library_text
from usdfoliage.files.reading import open_regular, reason_of, why_irregular
from usdfoliage.geometry.color import encode_srgb

_NO_PICTURES = frozenset(("ffmpeg", "null"))  # of OpenImageIO: videos, and any file of that suffix


def why_no_picture(path: Path) -> str:
    """Why a file is no picture; empty for one. Nothing but its header is read.

    Raises:
        TypeError: Its name is not valid Unicode.
    """
    irregular = why_irregular(path)
    if irregular or path.is_dir():
        return irregular or "it is a folder"
    source = oiio.ImageInput.open(str(path))
    if source is None:
        return library_text(oiio.geterror) or "no reason given"
    kind = source.format_name()
    source.close()
    return f"{kind} is no format of pictures" if kind in _NO_PICTURES else ""


def is_linear(file: str) -> bool:
    """Whether a picture's format holds linear numbers, by its name; those of any other are sRGB."""
    return file.lower().endswith((".exr", ".hdr", ".pfm"))


def usd_color_space(file: str) -> str:
    """The sourceColorSpace of a picture of colours: not `auto`, by which Blender may take them for data."""
    return "raw" if is_linear(file) else "sRGB"


def copy_picture(source: Path, target: Path) -> None:
    """Copy a picture, and nothing but a picture, into an asset.

    Raises:
        AssetError: It cannot be read, or is no picture.
        WriteError: target cannot be written.
    """
    try:
        with open_regular(source):  # it is there, and may be read
            reason = why_no_picture(source)
    except TypeError as error:  # of OpenImageIO
        raise AssetError(f"the file name of {source!r} is not valid Unicode", "rename it") from error
    except OSError as error:
        raise AssetError(f"{source} cannot be copied: {reason_of(error)}", "check it and its permissions") from error
    if reason:
        raise AssetError(f"{source} is no picture, and is not copied into the asset ({reason})", "name a picture")
    copy_whole(source, target)


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
