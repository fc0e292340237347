"""The pixels of an image file, upright and checked, in the encoding that the file has.

Photographs and masks are read through here, so that whatever can be wrong with a file is refused in one place.
"""

import logging
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from usdfoliage.capture.folder.camera_raw import develop_raw, is_camera_raw, read_raw_exif
from usdfoliage.capture.folder.coded_color import linear_from_coded
from usdfoliage.capture.folder.exif import as_image_spec
from usdfoliage.capture.folder.heic import is_heic, read_heic, read_heic_header
from usdfoliage.errors import CaptureError
from usdfoliage.files.library_text import library_text
from usdfoliage.files.reading import open_regular

logger = logging.getLogger(__name__)

MIN_SIDE_PX = 16  # nothing of a plant can be seen in less
MAX_PIXELS = 400_000_000  # 4.8 GB of linear colour; larger than any camera's picture, smaller than a decompression bomb

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_START_BYTES = 16  # by which kinds of files are distinguished


@dataclass(frozen=True, kw_only=True, eq=False)
class Raster:
    """The first picture of a file, turned upright by its EXIF orientation."""

    path: Path
    color: NDArray[Any]  # (H, W, 1) or (H, W, 3), uint8, uint16 or float32, as encoded in the file
    alpha: NDArray[Any] | None  # (H, W), same type
    premultiplied: bool  # color is multiplied by alpha
    orientation: int  # EXIF orientation that was undone, 1 for none
    profile: str  # description of the embedded ICC profile, "" for none
    interoperability: str  # EXIF interoperability index, "R03" means Adobe RGB
    chromaticities: tuple[float, ...]  # of an EXR: x, y of red, green, blue and white; empty for none

    @property
    def is_float(self) -> bool:
        return self.color.dtype == np.float32


def read_raster(path: Path) -> Raster:
    """Read the first picture of an image file.

    Integers of 8 and 16 bits stay what they are; everything else becomes float32, other integers scaled to [0, 1].
    HEIC has 8 bits, and a camera's raw file is developed to linear float32 (see develop_raw). Both are turned upright
    when they are decoded: for them upright pixels are the stored ones, and the orientation is 1.
    CMYK is converted to RGB by the plain formula (1 − C)(1 − K); the embedded CMYK profile is not used.

    Raises:
        CaptureError: No such file, a folder, no permission; not an image, truncated or damaged; smaller than
            MIN_SIDE_PX or larger than MAX_PIXELS; no colour or grey channels; pixels that are NaN, infinite or
            negative.
    """
    start = _check_file(path)
    if is_heic(start):
        return _read_heic_raster(path)
    if is_camera_raw(path.name):
        return _read_raw_raster(path)
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)  # the division by alpha would cost the exactness of 16 bits
    try:
        source = oiio.ImageInput.open(str(path), hints)
    except TypeError as error:  # a name that is not valid Unicode
        raise CaptureError(f"the file name of {path!r} is not valid Unicode", "rename it") from error
    if source is None or source.format_name() == "null":
        reason = library_text(oiio.geterror) or "no reason given"
        raise CaptureError(f"{path} is not an image that can be read ({reason})", "use JPEG, HEIC, PNG, TIFF or EXR")
    try:
        return _read_picture(path, source)
    finally:
        source.close()


def read_image_spec(path: Path) -> Any | None:
    """What a file states of itself and of the camera, as OpenImageIO states it; None for what is no image.

    Of HEIC and raw files the orientation is 1, as read_raster undoes it; the size of a raw file is not looked up.
    """
    try:
        with open_regular(path) as file:
            start = file.read(_START_BYTES)
    except OSError:
        return None
    if is_heic(start):
        try:
            header = read_heic_header(path)
        except CaptureError:
            return None
        return as_image_spec(header.width_px, header.height_px, {**header.exif, "Orientation": 1})
    if is_camera_raw(path.name):
        return as_image_spec(0, 0, {**read_raw_exif(path), "Orientation": 1})
    source = oiio.ImageInput.open(str(path))
    if source is None:
        library_text(oiio.geterror)
        return None
    spec = source.spec()
    source.close()
    return spec


def apply_orientation(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Turn (H, W, …) pixels upright: EXIF orientation 1 to 8 states where the stored row 0 and column 0 belong."""
    if orientation >= 5:
        pixels = np.swapaxes(pixels, 0, 1)  # stored rows are columns of the picture
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels


def _check_file(path: Path) -> bytes:
    """The first bytes of a file that can be read."""
    try:
        if path.is_dir():
            raise CaptureError(f"{path} is a folder", "give an image file")
        if not path.exists():
            raise CaptureError(f"{path} does not exist", "check the path")
        if not path.is_file():  # opening a pipe would wait for ever
            raise CaptureError(f"{path} is not a regular file", "give an image file")
        size_bytes = path.stat().st_size
        if size_bytes == 0:
            raise CaptureError(f"{path} is empty (0 bytes)", "copy it again")
        with open_regular(path) as file:
            start = file.read(_START_BYTES)
            damage = _png_damage(file, size_bytes) if start.startswith(_PNG_SIGNATURE) else ""
        if damage:
            raise CaptureError(f"{path} is {damage}", "copy it again")
        return start
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise CaptureError(f"{path!s} cannot be read: {reason}", "check the path and its permissions") from error


def _png_damage(file: BinaryIO, size_bytes: int) -> str:
    """What is wrong with the chunks of a PNG, "" for nothing.

    libpng would accept that the last one is missing, and print on stderr about everything else.
    """
    position = len(_PNG_SIGNATURE)
    while position + 12 <= size_bytes:
        file.seek(position)
        length, kind = struct.unpack(">I4s", file.read(8))
        position += 12 + length
        if position > size_bytes:
            break
        if position == len(_PNG_SIGNATURE) + 12 + length and (kind != b"IHDR" or length != 13):
            return "damaged: it does not begin with the header of a PNG"
        if kind == b"IHDR":
            header = file.read(length)
            file.seek(-length, 1)
            damage = _png_header_damage(header)
            if damage:
                return damage
        if kind[:1].isupper():  # chunks that a picture cannot do without
            checksum = zlib.crc32(file.read(length), zlib.crc32(kind))
            if checksum != int.from_bytes(file.read(4), "big"):
                return f"damaged: chunk {kind!r} has a wrong checksum"
        if kind == b"IEND":
            return ""
    return f"truncated: {size_bytes} bytes without the end of the PNG"


def _png_header_damage(header: bytes) -> str:
    width, height, bits, kind, *others = struct.unpack(">IIBBBBB", header)
    known = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}  # bits by kind of colour
    if not (0 < width < 2**31 and 0 < height < 2**31) or bits not in known.get(kind, ()):
        return f"damaged: its header states {width}×{height} pixels of {bits} bits, colour {kind}"
    if others[:2] != [0, 0] or others[2] > 1:
        return "damaged: its header states a compression, filter or interlacing that no PNG has"
    return ""


def _read_heic_raster(path: Path) -> Raster:
    header, pixels = read_heic(path, MAX_PIXELS)
    _check_size(path, header.width_px, header.height_px)
    color, profile = header.color, header.profile
    if not profile and color.is_display_p3:
        profile = "Display P3"
    has_curve = profile or color.is_srgb
    return _bare_raster(path, pixels if has_curve else linear_from_coded(pixels / np.float32(255), color), profile)


def _read_raw_raster(path: Path) -> Raster:
    developed = develop_raw(path, MAX_PIXELS)
    _check_size(path, developed.linear.shape[1], developed.linear.shape[0])
    if developed.orientation != 1:
        logger.info("%s is turned upright, as its orientation is %d", path, developed.orientation)
    return _bare_raster(path, developed.linear / np.float32(65535), "")


def _bare_raster(path: Path, color: NDArray[Any], profile: str) -> Raster:
    return Raster(
        path=path,
        color=color,
        alpha=None,
        premultiplied=False,
        orientation=1,
        profile=profile,
        interoperability="",
        chromaticities=(),
    )


def _check_size(path: Path, width: int, height: int) -> None:
    if min(width, height) < MIN_SIDE_PX:
        raise CaptureError(f"{path} is {width}×{height} pixels; at least {MIN_SIDE_PX} a side are needed")


def _read_picture(path: Path, source: Any) -> Raster:
    spec = source.spec()
    if spec.deep or spec.depth > 1:
        raise CaptureError(f"{path} is a deep or volume image", "give a flat picture")
    for width, height in ((spec.width, spec.height), (spec.full_width, spec.full_height)):
        _check_size(path, width, height)
        if width * height > MAX_PIXELS:
            raise CaptureError(
                f"{path} states {width}×{height} pixels, {width * height / 1e6:.0f} million; "
                f"at most {MAX_PIXELS / 1e6:.0f} million are read: reduce it"
            )
    try:
        names = [str(name) for name in spec.channelnames]
    except UnicodeDecodeError as error:
        raise CaptureError(f"{path} has channel names that are not Unicode", "copy it again") from error
    color_at, alpha_at = _choose_channels(path, names, spec.alpha_channel)
    chosen = color_at if alpha_at is None else [*color_at, alpha_at]
    first, end = min(chosen), max(chosen) + 1

    kind = str(spec.format)
    pixels = source.read_image(0, 0, first, end, kind if kind in ("uint8", "uint16") else "float")
    failed = source.has_error
    failure = library_text(source.geterror)  # the only sign of a truncated JPEG, whose rest is grey
    if pixels is None or failed or failure:
        raise CaptureError(f"{path} is truncated or damaged ({failure or 'no reason given'})", "copy it again")
    if source.seek_subimage(1, 0):  # True where there is a second picture
        logger.info("%s has several pictures; the first is read", path)
    if spec.get_int_attribute("tiff:PhotometricInterpretation") == 5 or "CMYK" in (
        library_text(spec.get_string_attribute, "jpeg:ColorSpace"),
        library_text(spec.get_string_attribute, "tiff:ColorSpace"),
    ):
        logger.info("%s is CMYK; converted by R = (1 − C)(1 − K) without its profile", path)

    pixels = np.asarray(pixels).reshape(spec.height, spec.width, end - first)
    if pixels.dtype not in (np.uint8, np.uint16):
        pixels = pixels.astype(np.float32, copy=False)
        _check_values(path, pixels, names[first:end], [index - first for index in chosen])
    if source.format_name() == "openexr":
        pixels = _display_window(path, pixels, spec)

    orientation = spec.get_int_attribute("Orientation", 1)
    if orientation not in range(1, 9):
        logger.warning("%s has EXIF orientation %d, which does not exist; taken as upright", path, orientation)
        orientation = 1
    pixels = apply_orientation(pixels, orientation)
    chromaticities = spec.getattribute("chromaticities")
    return Raster(
        path=path,
        color=np.ascontiguousarray(pixels[..., [index - first for index in color_at]]),
        alpha=None if alpha_at is None else np.ascontiguousarray(pixels[..., alpha_at - first]),
        premultiplied=alpha_at is not None and not spec.get_int_attribute("oiio:UnassociatedAlpha"),
        orientation=orientation,
        profile=library_text(spec.get_string_attribute, "ICCProfile:profile_description"),
        interoperability=library_text(spec.get_string_attribute, "Exif:InteroperabilityIndex"),
        chromaticities=() if chromaticities is None else tuple(float(value) for value in chromaticities),
    )


def _choose_channels(path: Path, names: list[str], alpha_channel: int) -> tuple[list[int], int | None]:
    """Indices of R, G, B (or of one grey channel) and of alpha."""
    alpha = alpha_channel if alpha_channel >= 0 else None
    lower = [name.lower() for name in names]
    if {"r", "g", "b"} <= set(lower):
        return [lower.index(name) for name in "rgb"], alpha
    if "y" in lower and not {"ry", "by"} & set(lower):
        return [lower.index("y")], alpha
    others = [index for index in range(len(names)) if index != alpha]
    if len(others) == 1:
        return others, alpha
    raise CaptureError(
        f"{path} has {len(names)} channels ({', '.join(names)}), neither R, G, B nor a single grey one",
        "save it as RGB, RGBA or grey",
    )


def _check_values(path: Path, pixels: NDArray[np.float32], names: list[str], chosen: list[int]) -> None:
    kinds = (
        ("not a number or infinite", ~np.isfinite(pixels[..., chosen]), "repair them"),
        ("negative", pixels[..., chosen] < 0, "clamp them at 0"),
    )
    for kind, bad, remedy in kinds:
        count = int(np.count_nonzero(bad))
        if count:
            row, column, channel = (int(index[0]) for index in np.nonzero(bad))
            value = pixels[row, column, chosen[channel]]
            raise CaptureError(
                f"{path} has {count} values that are {kind}, the first at column {column}, row {row}, "
                f"channel {names[chosen[channel]]}: {value:g}",
                remedy,
            )


def _display_window(path: Path, pixels: NDArray[Any], spec: Any) -> NDArray[Any]:
    """What an EXR shows: its data window, cropped or filled up with zeros to the display window."""
    left, top = spec.x - spec.full_x, spec.y - spec.full_y
    if (left, top, spec.width, spec.height) == (0, 0, spec.full_width, spec.full_height):
        return pixels
    right, bottom = min(left + spec.width, spec.full_width), min(top + spec.height, spec.full_height)
    if right <= max(left, 0) or bottom <= max(top, 0):
        raise CaptureError(f"{path} has no pixels in its display window", "write it with an overlapping data window")
    displayed = np.zeros((spec.full_height, spec.full_width, pixels.shape[2]), pixels.dtype)
    displayed[max(top, 0) : bottom, max(left, 0) : right] = pixels[
        max(-top, 0) : bottom - top, max(-left, 0) : right - left
    ]
    return displayed
