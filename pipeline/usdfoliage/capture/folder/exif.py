"""EXIF of files that OpenImageIO does not read, under the names that it gives to what EXIF of a JPEG has.

Sources: TIFF 6.0, Adobe, 1992, section 2; CIPA DC-008, Exif 2.32, 4.6.
"""

import math
import struct
from collections.abc import Mapping

import OpenImageIO as oiio

ExifValue = str | float | tuple[float, ...]

# Tags by the folder ("IFD") that they are in.
_MAIN = {0x010F: "Make", 0x0110: "Model", 0x0112: "Orientation"}
_EXIF = {
    0x9405: "Exif:CameraElevationAngle",
    0x920A: "Exif:FocalLength",
    0xA002: "Exif:PixelXDimension",
    0xA20E: "Exif:FocalPlaneXResolution",
    0xA210: "Exif:FocalPlaneResolutionUnit",
    0xA405: "Exif:FocalLengthIn35mmFilm",
}
_GPS = {
    1: "GPS:LatitudeRef",
    2: "GPS:Latitude",
    3: "GPS:LongitudeRef",
    4: "GPS:Longitude",
    5: "GPS:AltitudeRef",
    6: "GPS:Altitude",
}
_BELOW = {0x8769: _EXIF, 0x8825: _GPS}
_WHOLE = {
    "Orientation",
    "Exif:FocalPlaneResolutionUnit",
    "Exif:FocalLengthIn35mmFilm",
    "Exif:PixelXDimension",
    "GPS:AltitudeRef",
}
# Numbers of a type, and how struct calls them; the types 5 and 10 are fractions of two.
_TYPES = {1: "B", 2: "s", 3: "H", 4: "I", 5: "II", 6: "b", 7: "B", 8: "h", 9: "i", 10: "ii", 11: "f", 12: "d"}
_MAX_VALUES, _MAX_ENTRIES = 1000, 1000


def read_exif(block: bytes) -> dict[str, ExifValue]:
    """What a block of EXIF, or the head of a raw file that is built as TIFF, has of the camera and the place.

    Args:
        block: From the letters of the byte order on.

    Returns:
        Values by OpenImageIO's names; those that are damaged are left out.
    """
    return _read_folders(block, _MAIN)


def read_exif_part(block: bytes, part: str) -> dict[str, ExifValue]:
    """The same of a block that holds one folder of EXIF alone, "main", "exif" or "gps"."""
    return _read_folders(block, {"main": _MAIN, "exif": _EXIF, "gps": _GPS}[part])


def as_image_spec(width_px: int, height_px: int, values: Mapping[str, ExifValue]) -> oiio.ImageSpec:
    """What OpenImageIO would state of such a picture, its EXIF among it."""
    spec = oiio.ImageSpec(width_px, height_px, 3, oiio.UINT8)
    for name, value in values.items():
        if isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(f"float[{len(value)}]"), value)
        elif isinstance(value, str):
            spec.attribute(name, value)
        else:
            spec.attribute(name, int(value) if name in _WHOLE else float(value))
    return spec


def _read_folders(block: bytes, tags: Mapping[int, str]) -> dict[str, ExifValue]:
    order = {b"II": "<", b"MM": ">"}.get(bytes(block[:2]))
    if order is None or len(block) < 8:
        return {}
    (first,) = struct.unpack_from(f"{order}I", block, 4)
    values: dict[str, ExifValue] = {}
    waiting = [(first, tags)]
    seen: set[int] = set()
    while waiting:
        start, tags = waiting.pop()
        if start in seen or start + 2 > len(block):
            continue
        seen.add(start)
        (count,) = struct.unpack_from(f"{order}H", block, start)
        for k in range(min(count, _MAX_ENTRIES)):
            at = start + 2 + 12 * k
            if at + 12 > len(block):
                break
            tag, kind, length = struct.unpack_from(f"{order}HHI", block, at)
            if tag in _BELOW and tags is _MAIN:
                waiting.append((struct.unpack_from(f"{order}I", block, at + 8)[0], _BELOW[tag]))
            elif tag in tags:
                value = _read_value(block, order, at, kind, length)
                if value is not None:
                    values[tags[tag]] = value
    return values


def _read_value(block: bytes, order: str, at: int, kind: int, count: int) -> ExifValue | None:
    letters = _TYPES.get(kind)
    if letters is None or not 1 <= count <= _MAX_VALUES:
        return None
    size = struct.calcsize(f"{order}{letters}") * count
    start = at + 8 if size <= 4 else struct.unpack_from(f"{order}I", block, at + 8)[0]
    if start + size > len(block):
        return None
    if letters == "s":
        return bytes(block[start : start + size]).split(b"\0")[0].decode("utf-8", "replace").strip()
    numbers = struct.unpack_from(f"{order}{letters * count}", block, start)
    if len(letters) == 2:  # a fraction of 0 is how EXIF states that it does not know
        numbers = tuple(a / b if b else math.nan for a, b in zip(numbers[::2], numbers[1::2], strict=True))
    if not all(math.isfinite(number) for number in numbers):
        return None
    return float(numbers[0]) if count == 1 else tuple(float(number) for number in numbers)
