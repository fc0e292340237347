"""Pictures as files: whether a file is one, which numbers it holds, and its copy in an asset."""

from pathlib import Path

import OpenImageIO as oiio

from usdfoliage.errors import AssetError
from usdfoliage.files.atomic import copy_whole
from usdfoliage.files.library_text import library_text
from usdfoliage.files.reading import open_regular, reason_of, why_irregular

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
