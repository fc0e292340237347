"""Pictures in HEIC files, as phones write them: the boxes are read here, and FFmpeg decodes their tiles.

Thumbnails, depth, gain maps and the other pictures beside the primary one are not read.

Sources: ISO/IEC 23008-12:2022, High Efficiency Image File Format; ISO/IEC 14496-15:2022, section 8, for how HEVC lies
in files; ICC.1:2022, 10.15 and 10.7, for the description of a profile.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.boxes import ByteReader
from usdfoliage.capture.folder.coded_color import CodedColor, read_coded_color
from usdfoliage.capture.folder.exif import ExifValue, read_exif
from usdfoliage.capture.folder.ffmpeg import read_frames, require_ffmpeg
from usdfoliage.capture.folder.heic_contents import HeicContents, HeicItem, read_contents
from usdfoliage.errors import CaptureError

_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"mif2", b"msf1", b"heif"}
_HEVC, _GRID = b"hvc1", b"grid"
_MAX_TILES = 4096
_START = b"\0\0\0\1"  # before each unit of a stream (ISO/IEC 23008-2, annex B)
_OTHERS = {b"av01": "AV1 (AVIF)", b"jpeg": "JPEG", b"avc1": "H.264", b"j2k1": "JPEG 2000", b"vvc1": "VVC"}


@dataclass(frozen=True, kw_only=True)
class HeicHeader:
    """What a HEIC file states of its primary picture."""

    width_px: int  # as shown
    height_px: int
    profile: str  # description of its ICC profile, "" for none
    color: CodedColor  # as far as stated
    exif: dict[str, ExifValue]  # by OpenImageIO's names; its orientation is not that of the picture


def is_heic(start: bytes) -> bool:
    """Whether a file with these first bytes is one, AVIF among them."""
    return start[4:8] == b"ftyp" and (start[8:12] in _BRANDS or start[8:12] in (b"avif", b"avis"))


def read_heic_header(path: Path) -> HeicHeader:
    """What the file states; no pixels are read.

    Raises:
        CaptureError: As read_heic.
    """
    try:
        return _read_header(path, read_contents(path))
    except (ValueError, struct.error) as error:
        raise _damaged(path, error) from error


def read_heic(path: Path, max_pixels: int) -> tuple[HeicHeader, NDArray[np.uint8]]:
    """The primary picture, (H, W, 3) red, green, blue, as shown: cropped, turned and mirrored as the file states.

    More than 8 bits are reduced to 8.

    Args:
        path: The file.
        max_pixels: Refused are pictures with more.

    Raises:
        CaptureError: The file is damaged or truncated, its picture is too large, or of a kind that is not read; OpenCV
            lacks FFmpeg.
    """
    try:
        contents = read_contents(path)
        header = _read_header(path, contents)
        require_ffmpeg(path)
        pixels = header.width_px * header.height_px
        if pixels > max_pixels:
            raise CaptureError(
                f"{path} states {header.width_px}×{header.height_px} pixels, {pixels / 1e6:.0f} million; "
                f"at most {max_pixels / 1e6:.0f} million are read: reduce it"
            )
        primary = contents.items[contents.primary]
        tiles, (columns, rows, width, height) = _list_tiles(contents)
        tile_width, tile_height = contents.items[tiles[0]].size
        if tile_width * columns < width or tile_height * rows < height or tile_width * tile_height > max_pixels:
            raise ValueError(
                f"{columns}×{rows} tiles of {tile_width}×{tile_height} do not make {width}×{height} pixels"
            )
        canvas = np.zeros((height, width, 3), np.uint8)
        for place, frame in enumerate(_decode(contents, tiles)):
            if frame.shape[:2] != (tile_height, tile_width):
                raise ValueError(f"tile {place + 1} has {frame.shape[1]}×{frame.shape[0]} pixels")
            top, left = place // columns * tile_height, place % columns * tile_width
            piece = frame[: max(height - top, 0), : max(width - left, 0)]
            canvas[top : top + piece.shape[0], left : left + piece.shape[1]] = piece
        return header, np.ascontiguousarray(_show(canvas, primary))
    except (ValueError, struct.error) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> CaptureError:
    return CaptureError(f"{path} is a truncated or damaged HEIC file ({error})", "copy it again from the phone")


def _read_header(path: Path, contents: HeicContents) -> HeicHeader:
    primary = contents.items[contents.primary]
    tiles, _ = _list_tiles(contents)
    kind = next((each for each in (contents.items[number].kind for number in tiles) if each != _HEVC), _HEVC)
    if kind != _HEVC:
        coding = _OTHERS.get(kind, repr(kind))
        raise CaptureError(f"{path} holds a picture coded as {coding}, which is not read", "save it as JPEG or HEIC")
    width, height = _displayed_size(primary)
    profile, color = "", CodedColor()
    for item in (contents.items[tiles[0]], primary):  # what is stated of the whole counts
        for name, content in item.properties:
            if name == b"colr" and content[:4] in (b"prof", b"rICC"):
                profile = _describe_profile(content[4:])
            elif name == b"colr":
                color = read_coded_color(content) or color
    return HeicHeader(width_px=width, height_px=height, profile=profile, color=color, exif=_read_exif(contents))


def _read_exif(contents: HeicContents) -> dict[str, ExifValue]:
    for number in contents.described_by.get(contents.primary, ()):
        item = contents.items.get(number)
        if item is not None and item.kind == b"Exif":
            block = contents.bytes_of(number)
            return read_exif(block[4 + int.from_bytes(block[:4], "big") :])
    return {}


def _list_tiles(contents: HeicContents) -> tuple[tuple[int, ...], tuple[int, int, int, int]]:
    """The tiles of the primary picture, row by row; their columns and rows, and the size of the picture's pixels."""
    primary = contents.items[contents.primary]
    if primary.kind != _GRID:
        return (contents.primary,), (1, 1, *primary.size)
    reader = ByteReader(contents.bytes_of(contents.primary))
    is_long = (reader.take(2)[1]) & 1
    rows, columns = reader.number(1) + 1, reader.number(1) + 1
    width, height = reader.number(4 if is_long else 2), reader.number(4 if is_long else 2)
    tiles = contents.made_of.get(contents.primary, ())
    if len(tiles) != rows * columns or len(tiles) > _MAX_TILES or any(tile not in contents.items for tile in tiles):
        raise ValueError(f"it has {len(tiles)} tiles of {columns}×{rows}")
    return tiles, (columns, rows, width, height)


def _decode(contents: HeicContents, tiles: Sequence[int]) -> "list[NDArray[np.uint8]]":
    """The pixels of tiles; those that share their parameters are decoded as frames of one video."""
    frames: list[NDArray[np.uint8]] = []
    for parameters, group in groupby(tiles, key=lambda tile: contents.items[tile].of(b"hvcC")):
        numbers = list(group)
        if parameters is None:
            raise ValueError("a picture lacks the parameters of its decoder")
        head, size = _read_parameters(parameters)
        stream = head + b"".join(_as_stream(contents.bytes_of(number), size) for number in numbers)
        decoded = list(read_frames(stream))
        if len(decoded) != len(numbers):
            raise ValueError(f"{len(numbers) - len(decoded)} of {len(numbers)} tiles cannot be decoded")
        frames += decoded
    return frames


def _read_parameters(content: bytes) -> tuple[bytes, int]:
    """The units that a decoder needs first, as a stream, and how many bytes state the length of a unit."""
    reader = ByteReader(content)
    size = (reader.take(22)[21] & 3) + 1
    stream = b""
    for _ in range(reader.number(1)):
        reader.take(1)
        for _ in range(reader.number(2)):
            stream += _START + reader.take(reader.number(2))
    return stream, size


def _as_stream(data: bytes, size: int) -> bytes:
    """Units that are stored with their lengths, as a stream."""
    reader = ByteReader(data)
    stream = b""
    while reader.left >= size:
        stream += _START + reader.take(reader.number(size))
    return stream


def _clean_aperture(content: bytes, width: int, height: int) -> tuple[int, int, int, int]:
    """Left, top, width and height of what is shown of a picture (ISO/IEC 14496-12, 12.1.4)."""
    fractions = struct.unpack_from(">IIIIiIiI", content)
    if not all(fractions[1::2]):
        raise ValueError("it is cropped to a fraction of nothing")
    wide, high, right, down = (fractions[k] / fractions[k + 1] for k in (0, 2, 4, 6))
    left, top = round(right + (width - wide) / 2), round(down + (height - high) / 2)
    wide, high = round(wide), round(high)
    if left < 0 or top < 0 or wide < 1 or high < 1 or left + wide > width or top + high > height:
        raise ValueError("it is cropped to more than it is")
    return left, top, wide, high


def _displayed_size(item: HeicItem) -> tuple[int, int]:
    width, height = item.size
    for kind, content in item.properties:
        if kind == b"clap":
            _, _, width, height = _clean_aperture(content, width, height)
        elif kind == b"irot" and content[:1] and content[0] & 1:
            width, height = height, width
    return width, height


def _show(pixels: NDArray[np.uint8], item: HeicItem) -> NDArray[np.uint8]:
    """Cropped, turned and mirrored, in the order that the file states (ISO/IEC 23008-12, 6.5.9 to 6.5.12)."""
    for kind, content in item.properties:
        if kind == b"clap":
            left, top, width, height = _clean_aperture(content, pixels.shape[1], pixels.shape[0])
            pixels = pixels[top : top + height, left : left + width]
        elif kind == b"irot" and content[:1]:
            pixels = np.rot90(pixels, content[0] & 3)  # against the clock, as NumPy turns
        elif kind == b"imir" and content[:1]:
            pixels = pixels[:, ::-1] if content[0] & 1 else pixels[::-1]
    return pixels


def _describe_profile(profile: bytes) -> str:
    """The description of an ICC profile in one line, "" where it has none."""
    try:
        reader = ByteReader(profile, 128)
        for _ in range(min(reader.number(4), 200)):
            name, start, length = reader.take(4), reader.number(4), reader.number(4)
            if name != b"desc":
                continue
            text = ByteReader(profile, start, min(start + length, len(profile)))
            kind = text.take(4)
            text.take(4)
            if kind == b"desc":  # of version 2
                return " ".join(text.take(text.number(4)).split(b"\0")[0].decode("ascii", "replace").split())
            if kind == b"mluc" and text.number(4) and text.number(4):
                text.take(4)
                size, at = text.number(4), text.number(4)
                return " ".join(profile[start + at : start + at + size].decode("utf-16-be", "replace").split())
    except ValueError:
        pass
    return ""
