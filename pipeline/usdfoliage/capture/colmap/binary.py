"""COLMAP models as binary, little-endian: cameras.bin, images.bin, points3D.bin.

Source: COLMAP's documentation, "Output format"; src/colmap/scene/reconstruction_io_binary.cc.
"""

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from usdfoliage.capture.colmap.posed_image import PosedImage, checked_image, checked_lens
from usdfoliage.capture.lens import LENS_MODELS, Lens
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import open_regular

_MODEL_BY_NUMBER = {model.number: name for name, model in LENS_MODELS.items()}


class _Binary:
    """The bytes of a file, taken from the front; whatever they promise, no more than is there is read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.position = 0
        try:
            with open_regular(path) as file:  # images may be large, and little of them is wanted
                self.data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except ValueError as error:
            raise CaptureError(f"{path} is empty", "copy it again") from error
        except OSError as error:
            raise CaptureError(f"{path} cannot be read: {error.strerror}", "check its permissions") from error

    @property
    def where(self) -> str:
        return f"{self.path}, byte {self.position}"

    def take(self, layout: str) -> tuple[float, ...]:
        start = self.position
        self.skip(struct.calcsize("<" + layout))
        return struct.unpack_from("<" + layout, self.data, start)

    def take_count(self, layout: str = "Q") -> int:
        return int(self.take(layout)[0])

    def take_name(self) -> str:
        end = self.data.find(b"\0", self.position)
        if end < 0:
            raise CaptureError(f"{self.where}: the image name does not end", "copy the file again")
        raw = self.data[self.position : end]
        try:
            name = raw.decode()
        except UnicodeDecodeError as error:
            raise CaptureError(f"{self.where}: the image name {raw[:40]!r} is not UTF-8", "rename it") from error
        self.position = end + 1
        return name

    def skip(self, count: int) -> None:
        if count > len(self.data) - self.position:
            raise CaptureError(
                f"{self.where}: {count} bytes needed, {len(self.data) - self.position} are left; "
                f"the file is truncated or no COLMAP model: copy it again"
            )
        self.position += count


def read_binary_lenses(path: Path) -> Iterator[tuple[int, Lens, str]]:
    file = _Binary(path)
    for _ in range(file.take_count()):
        where = file.where
        camera_id, number, width, height = (int(value) for value in file.take("IiQQ"))
        if number not in _MODEL_BY_NUMBER:
            raise CaptureError(f"{where}: the camera model {number} is not known; known are {', '.join(LENS_MODELS)}")
        model = _MODEL_BY_NUMBER[number]
        parameters = file.take(f"{LENS_MODELS[model].parameters}d")
        yield camera_id, checked_lens(where, model, width, height, parameters), where


def read_binary_images(path: Path) -> Iterator[PosedImage]:
    file = _Binary(path)
    for _ in range(file.take_count()):
        where = file.where
        _, *pose, camera_id = file.take("I7dI")
        name = file.take_name()
        file.skip(24 * file.take_count())  # x, y and point of each 2-D point
        yield checked_image(where, name, int(camera_id), pose[:4], pose[4:])


def read_binary_points(path: Path) -> Iterator[tuple[float, float, float]]:
    file = _Binary(path)
    for _ in range(file.take_count()):
        where = file.where
        _, x, y, z = file.take("Q3d")
        file.skip(3 + 8)  # colour, error
        file.skip(8 * file.take_count())  # the track
        if not np.isfinite((x, y, z)).all():
            raise CaptureError(f"{where}: a point is not finite", "remove it")
        yield x, y, z
