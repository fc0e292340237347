"""Raw files of cameras, all developed in the same way: the camera's daylight white balance, linear, no automatic
brightness.

So exposure and colour of the photographs of a set stay comparable, as those of JPEG files with manual exposure are.
"""

import importlib.util
import json
import logging
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder import raw_worker
from usdfoliage.capture.folder.boxes import list_boxes, read_top_box
from usdfoliage.capture.folder.exif import ExifValue, read_exif, read_exif_part
from usdfoliage.errors import CaptureError
from usdfoliage.files.children import bound_command
from usdfoliage.files.reading import open_regular

logger = logging.getLogger(__name__)

# Suffixes of raw files that LibRaw reads, as cameras write them; .raw and .tif mean too many other things.
RAW_SUFFIXES = frozenset(
    {".3fr", ".arw", ".cr2", ".cr3", ".dng", ".erf", ".fff", ".iiq", ".kdc", ".mef", ".mos", ".mrw", ".nef", ".nrw"}
    | {".orf", ".pef", ".raf", ".rw2", ".rwl", ".sr2", ".srf", ".srw", ".x3f"}
)
_SECONDS = 600  # that one photograph may take
_MAX_HEAD_BYTES = 1 << 26  # EXIF is among the first of a file
_CANON = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")  # the box with Canon's EXIF in a CR3
_CR3_PARTS = {b"CMT1": "main", b"CMT2": "exif", b"CMT4": "gps"}


@dataclass(frozen=True, kw_only=True, eq=False)
class DevelopedRaw:
    """A photograph of a raw file, upright."""

    linear: NDArray[np.uint16]  # (H, W, 3), linear Rec.709, 65535 where the sensor saturates
    orientation: int  # EXIF orientation that was undone


def is_camera_raw(name: str) -> bool:
    """Whether a file is named as cameras name raw files."""
    return PurePosixPath(name).suffix.lower() in RAW_SUFFIXES


def develop_raw(path: Path, max_pixels: int) -> DevelopedRaw:
    """Develop a raw file.

    Args:
        path: The file.
        max_pixels: Refused are sensors with more.

    Raises:
        CaptureError: rawpy is not installed; the file is damaged, too large, or of a kind that LibRaw does not read.
    """
    if importlib.util.find_spec("rawpy") is None:
        raise CaptureError(
            f"{path} is a camera's raw file, and the package rawpy, which reads those, is not installed",
            "install it with 'pip install rawpy', or develop the photographs to TIFF, all with the same settings",
        )
    try:
        done = subprocess.run(
            bound_command([sys.executable, "-P", raw_worker.__file__, str(path), str(max_pixels)]),
            capture_output=True,
            stdin=subprocess.DEVNULL,
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise _unreadable(path, f"it takes more than {_SECONDS} s") from error
    line, _, pixels = done.stdout.partition(b"\n")
    try:
        reported = json.loads(line)
    except ValueError as error:
        logger.info("%s: %s", path, done.stderr.decode(errors="replace"))
        raise _unreadable(path, f"LibRaw ended with code {done.returncode}") from error
    if "too_large" in reported:
        width, height = reported["too_large"]
        raise CaptureError(
            f"{path} states {width}×{height} pixels, {width * height / 1e6:.0f} million; at most "
            f"{max_pixels / 1e6:.0f} million are read"
        )
    if "error" in reported:
        raise _unreadable(path, str(reported["error"]))
    height, width = int(reported["height"]), int(reported["width"])
    if len(pixels) != 6 * width * height:
        raise _unreadable(path, f"LibRaw ended with code {done.returncode}")
    linear = np.frombuffer(pixels, np.uint16).reshape(height, width, 3)
    return DevelopedRaw(linear=linear, orientation=int(reported["orientation"]))


def _unreadable(path: Path, reason: str) -> CaptureError:
    return CaptureError(
        f"{path} is not a raw file that can be read ({reason})",
        "copy it again from the camera; if that does not help, develop it to DNG or TIFF",
    )


def read_raw_exif(path: Path) -> dict[str, ExifValue]:
    """What a raw file states of the camera and the place, by OpenImageIO's names; nothing where it is damaged."""
    try:
        with open_regular(path) as file:
            head = file.read(_MAX_HEAD_BYTES)
        if head[4:8] == b"ftyp":
            return _read_cr3(read_top_box(path, b"moov", _MAX_HEAD_BYTES) or b"")
    except (OSError, ValueError) as error:
        logger.info("%s: %s", path, error)
        return {}
    if head.startswith(b"FUJIFILMCCD-RAW"):  # its EXIF is that of the JPEG in it
        start = head.find(b"Exif\0\0", int.from_bytes(head[84:88], "big"))
        return read_exif(head[start + 6 :]) if start >= 0 else {}
    return read_exif(head)


def _read_cr3(movie: bytes) -> dict[str, ExifValue]:
    values: dict[str, ExifValue] = {}
    for box in list_boxes(movie):
        if box.kind == b"uuid" and movie[box.start : box.start + 16] == _CANON:
            for part in list_boxes(movie, box.start + 16, box.end):
                if part.kind in _CR3_PARTS:
                    values |= read_exif_part(movie[part.start : part.end], _CR3_PARTS[part.kind])
    return values
