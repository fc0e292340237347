"""COLMAP models as text: cameras.txt, images.txt, points3D.txt.

Source: COLMAP's documentation, "Output format"; src/colmap/scene/reconstruction_io_text.cc.
"""

import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from usdfoliage.capture.colmap.posed_image import PosedImage, checked_image, checked_lens
from usdfoliage.capture.lens import Lens
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import open_regular


def _text_lines(path: Path) -> Iterator[tuple[str, str]]:
    """Where a line is (file:line) and the line; blank ones too, comments not."""
    try:
        with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig") as file:
            for number, line in enumerate(file, 1):
                if not line.startswith("#"):
                    yield f"{path}:{number}", line.strip()
    except UnicodeDecodeError as error:
        raise CaptureError(f"{path} is not text in UTF-8", "name a binary model .bin") from error
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error


def read_text_lenses(path: Path) -> Iterator[tuple[int, Lens, str]]:
    for where, line in _text_lines(path):
        fields = line.split()
        if not fields:
            continue
        if len(fields) < 4:
            raise CaptureError(f"{where}: {len(fields)} fields; a camera has id, model, width, height, parameters")
        numbers = _floats(where, fields[4:])
        size = _whole(where, fields[2]), _whole(where, fields[3])
        yield _whole(where, fields[0]), checked_lens(where, fields[1], *size, numbers), where


def read_text_images(path: Path) -> Iterator[PosedImage]:
    expects_points = False
    for where, line in _text_lines(path):
        fields = line.split(maxsplit=9)
        if expects_points:
            expects_points = False
            if not fields or _is_points_line(fields):
                continue  # else the lines of points were left out
        if not fields:
            continue
        if len(fields) < 10:
            raise CaptureError(
                f"{where}: {len(fields)} fields; an image has id, quaternion (4), translation (3), camera id, name"
            )
        _whole(where, fields[0])
        pose = _floats(where, fields[1:8])
        yield checked_image(where, fields[9], _whole(where, fields[8]), pose[:4], pose[4:])
        expects_points = True


def _is_points_line(fields: Sequence[str]) -> bool:
    """Whether a line split nine times is x, y, id, … and not an image, whose name is no number."""
    try:
        for field in (*fields[:9], *" ".join(fields[9:]).split(maxsplit=3)[:3]):
            float(field)
    except ValueError:
        return False
    return True


def read_text_points(path: Path) -> Iterator[tuple[float, float, float]]:
    for where, line in _text_lines(path):
        fields = line.split(maxsplit=4)
        if not fields:
            continue
        if len(fields) < 4:
            raise CaptureError(f"{where}: {len(fields)} fields; a point has id, x, y, z, …")
        x, y, z = _floats(where, fields[1:4])
        yield x, y, z


def _whole(where: str, field: str) -> int:
    try:
        value = int(field)
    except ValueError as error:
        raise CaptureError(f"{where}: {field[:40]!r} must be a whole number") from error
    if not 0 <= value < 2**32:
        raise CaptureError(f"{where}: {field[:40]} must be in 0 to 2³² - 1")
    return value


def _floats(where: str, fields: Sequence[str]) -> list[float]:
    values = []
    for field in fields:
        try:
            value = float(field)
        except ValueError as error:
            raise CaptureError(
                f"{where}: {field[:40]!r} must be a number", "write the model again with the program that made it"
            ) from error
        if not np.isfinite(value):
            raise CaptureError(
                f"{where}: {field[:40]} must be finite", "leave that photograph or point out, or estimate the poses"
            )
        values.append(value)
    return values
