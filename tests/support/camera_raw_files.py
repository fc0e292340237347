"""Raw files of a camera, as small as they can be: DNG with a Bayer pattern, written as TIFF."""

import struct
from pathlib import Path

import numpy as np

BYTE, ASCII, SHORT, LONG, RATIONAL, SRATIONAL = 1, 2, 3, 4, 5, 10
_SIZES = {BYTE: 1, ASCII: 1, SHORT: 2, LONG: 4, RATIONAL: 8, SRATIONAL: 8}
_XYZ_TO_REC709 = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.969266, 1.8760108, 0.041556], [0.0556434, -0.2040259, 1.0572252]]
)


def write_dng(
    path: Path,
    linear: np.ndarray,
    *,
    orientation: int = 1,
    neutral: tuple[float, float, float] = (1.0, 1.0, 1.0),
    white: int = 60000,
    focal_35mm: int = 0,
) -> Path:
    """A raw file whose camera sees linear Rec.709, without a black level.

    Args:
        path: Where.
        linear: (H, W, 3) as stored, 1 where the sensor saturates; H and W even.
        orientation: Of EXIF.
        neutral: What the camera took for white.
        white: Level of saturation.
        focal_35mm: Of EXIF, in millimetres; 0 for none.
    """
    height, width = linear.shape[:2]
    mosaic = np.zeros((height, width))
    for row, column, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        mosaic[row::2, column::2] = linear[row::2, column::2, channel]
    pixels = np.rint(np.clip(mosaic, 0, 1) * white).astype("<u2").tobytes()
    matrix = [round(value * 10000) for value in _XYZ_TO_REC709.ravel()]
    entries = {
        254: (LONG, [0]),
        256: (LONG, [width]),
        257: (LONG, [height]),
        258: (SHORT, [16]),
        259: (SHORT, [1]),
        262: (SHORT, [32803]),
        271: (ASCII, b"Foliage\0"),
        272: (ASCII, b"One\0"),
        273: (LONG, ["pixels"]),
        274: (SHORT, [orientation]),
        277: (SHORT, [1]),
        278: (LONG, [height]),
        279: (LONG, [len(pixels)]),
        284: (SHORT, [1]),
        33421: (SHORT, [2, 2]),
        33422: (BYTE, bytes([0, 1, 1, 2])),
        34665: (LONG, ["exif"]),
        50706: (BYTE, bytes([1, 4, 0, 0])),
        50707: (BYTE, bytes([1, 1, 0, 0])),
        50708: (ASCII, b"Foliage One\0"),
        50714: (LONG, [0]),
        50717: (LONG, [white]),
        50721: (SRATIONAL, [each for value in matrix for each in (value, 10000)]),
        50728: (RATIONAL, [each for value in neutral for each in (round(value * 10000), 10000)]),
        50778: (SHORT, [21]),  # D65
    }
    exif = {41989: (SHORT, [focal_35mm])} if focal_35mm else {37386: (RATIONAL, [0, 1])}
    start = 8
    exif_at = start + _folder_bytes(entries)
    pixels_at = exif_at + _folder_bytes(exif)
    head = struct.pack("<2sHI", b"II", 42, start)
    places = {"pixels": pixels_at, "exif": exif_at}
    path.write_bytes(head + _folder(entries, start, places) + _folder(exif, exif_at, places) + pixels)
    return path


def _values(kind: int, values: object, places: dict[str, int]) -> bytes:
    if isinstance(values, bytes):
        return values
    numbers = [places[value] if isinstance(value, str) else value for value in values]
    letters = {SHORT: "H", LONG: "I", RATIONAL: "I", SRATIONAL: "i"}[kind]
    return struct.pack(f"<{len(numbers)}{letters}", *numbers)


def _folder_bytes(entries: dict) -> int:
    """Of a folder ("IFD"), with what does not fit into its entries."""
    return len(_folder(entries, 0, {"pixels": 0, "exif": 0}))


def _folder(entries: dict, start: int, places: dict[str, int]) -> bytes:
    table, beside = struct.pack("<H", len(entries)), b""
    beside_at = start + 2 + 12 * len(entries) + 4
    for tag, (kind, values) in sorted(entries.items()):
        data = _values(kind, values, places)
        count = len(data) // _SIZES[kind]
        if len(data) <= 4:
            table += struct.pack("<HHI", tag, kind, count) + data.ljust(4, b"\0")
        else:
            table += struct.pack("<HHII", tag, kind, count, beside_at + len(beside))
            beside += data + b"\0" * (len(data) % 2)
    return table + bytes(4) + beside
