"""Known cameras: a COLMAP model, text or binary.

Read without COLMAP, whose library ends the process when a file breaks its promises.

Source: COLMAP's documentation, "Output format"; src/colmap/scene/reconstruction_io_{text,binary}.cc.
"""

import logging
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.lens import LENS_MODELS, Lens
from usdfoliage.errors import CaptureError

logger = logging.getLogger(__name__)

_MAX_BYTES = 4 * 2**30  # of a file: a model of a hundred million observations
_MAX_NORM_ERROR = 0.01  # of a quaternion: what two printed digits leave
_MODEL_BY_NUMBER = {model.number: name for name, model in LENS_MODELS.items()}
_SUBFOLDERS = ("", "sparse/0", "sparse", "0")  # where COLMAP and what is built on it leave the model


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedImage:
    """A photograph whose camera and place are known."""

    name: str  # below the folder of images, "/" between folders
    camera_id: int
    cam_from_world: NDArray[np.float64]  # (3, 4), camera axes x right, y down, z forward; in the model's unit
    source: str  # file and line, or byte, that say so


@dataclass(frozen=True, kw_only=True)
class CameraModel:
    """The cameras and poses of a COLMAP model."""

    folder: Path
    lenses: Mapping[int, Lens]  # by camera id
    images: tuple[PosedImage, ...]  # sorted by name, each name once


def find_camera_model(cameras: Path) -> Path:
    """The folder that holds the model: the folder itself or sparse/0 in it.

    Raises:
        CaptureError: There is no model.
    """
    for below in _SUBFOLDERS:
        folder = cameras / below
        if any((folder / f"images{suffix}").is_file() for suffix in (".txt", ".bin")):
            return folder
    raise CaptureError(
        f"{cameras} has no COLMAP model; put cameras.txt and images.txt (or cameras.bin and images.bin) there"
    )


def read_camera_model(folder: Path) -> CameraModel:
    """Read cameras and images of a COLMAP model.

    Each file is read as text (.txt) where that exists, else as binary (.bin). 2-D points are not read; in text their
    lines may be blank, or left out.

    Raises:
        CaptureError: A file is missing, truncated or not what COLMAP writes; a lens model that is not supported; a
            number that is not finite, a quaternion that is no rotation; an image of an unknown camera, one named twice,
            or one whose name leads out of the folder of images.
    """
    path = _existing(folder, "cameras")
    lenses: dict[int, Lens] = {}
    for camera_id, lens, where in _text_lenses(path) if path.suffix == ".txt" else _binary_lenses(path):
        if camera_id in lenses:
            raise CaptureError(f"{where}: camera {camera_id} is there twice; leave one")
        lenses[camera_id] = lens

    path = _existing(folder, "images")
    images: dict[str, PosedImage] = {}
    for image in _text_images(path) if path.suffix == ".txt" else _binary_images(path):
        if image.camera_id not in lenses:
            known = ", ".join(map(str, sorted(lenses)[:10])) or "none"
            raise CaptureError(f"{image.source}: camera {image.camera_id} is unknown; there is {known}")
        if image.name in images:
            raise CaptureError(f"{image.source}: {image.name} is there twice, first at {images[image.name].source}")
        images[image.name] = image
    if not images:
        raise CaptureError(f"{path} has no images; give the poses of the photographs")
    logger.info("%s: %d cameras, %d images", folder, len(lenses), len(images))
    return CameraModel(folder=folder, lenses=lenses, images=tuple(images[name] for name in sorted(images)))


def read_model_points(folder: Path, most: int = 100_000) -> NDArray[np.float64]:
    """The first so many points of a COLMAP model, (N, 3) in its unit; none where it has no points3D.

    Raises:
        CaptureError: The file is truncated or not what COLMAP writes.
    """
    if not any((folder / f"points3D{suffix}").is_file() for suffix in (".txt", ".bin")):
        return np.zeros((0, 3))
    path = _existing(folder, "points3D")
    points = []
    for point in _text_points(path) if path.suffix == ".txt" else _binary_points(path):
        points.append(point)
        if len(points) >= most:
            break
    return np.array(points, np.float64).reshape(-1, 3)


def _existing(folder: Path, stem: str) -> Path:
    for suffix in (".txt", ".bin"):
        path = folder / f"{stem}{suffix}"
        if path.is_file():
            if path.stat().st_size > _MAX_BYTES:
                raise CaptureError(f"{path} has {path.stat().st_size / 2**30:.1f} GiB; at most 4 are read")
            return path
    raise CaptureError(f"{folder} has neither {stem}.txt nor {stem}.bin; copy the whole COLMAP model there")


# What both forms promise.


def _lens(where: str, model: str, width: int, height: int, parameters: Sequence[float]) -> Lens:
    try:
        return Lens(model=model, width_px=width, height_px=height, parameters=tuple(parameters))
    except ValueError as error:
        raise CaptureError(f"{where}: {error}") from error


def _image(
    where: str, name: str, camera_id: int, quaternion: Sequence[float], translation: Sequence[float]
) -> PosedImage:
    if not np.isfinite([*quaternion, *translation]).all():
        raise CaptureError(f"{where}: the pose of {name!r} is not finite; remove the image or pose it again")
    norm = float(np.linalg.norm(quaternion))
    if not abs(norm - 1) <= _MAX_NORM_ERROR:
        raise CaptureError(f"{where}: the quaternion of {name!r} has length {norm:g}; it must be 1")
    w, x, y, z = (float(value) / norm for value in quaternion)
    cam_from_world = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), translation[0]],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), translation[1]],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), translation[2]],
        ]
    )
    return PosedImage(name=_image_name(where, name), camera_id=camera_id, cam_from_world=cam_from_world, source=where)


def _image_name(where: str, name: str) -> str:
    """The name, which must lead to a file below the folder of images."""
    parts = re.split(r"[/\\]", name)
    if not name.isprintable() or not name or ".." in parts or "" in parts or re.match(r"[A-Za-z]:", name):
        raise CaptureError(f"{where}: the image name {name!r} must be relative and stay inside the folder of images")
    return PurePosixPath(name).as_posix()


# Text.


def _text_lines(path: Path) -> Iterator[tuple[str, str]]:
    """Where a line is (file:line) and the line; blank ones too, comments not."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            for number, line in enumerate(file, 1):
                if not line.startswith("#"):
                    yield f"{path}:{number}", line.strip()
    except UnicodeDecodeError as error:
        raise CaptureError(f"{path} is not text in UTF-8; name a binary model .bin") from error
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}; check its permissions") from error


def _text_lenses(path: Path) -> Iterator[tuple[int, Lens, str]]:
    for where, line in _text_lines(path):
        fields = line.split()
        if not fields:
            continue
        if len(fields) < 4:
            raise CaptureError(f"{where}: {len(fields)} fields; a camera has id, model, width, height, parameters")
        numbers = _floats(where, fields[4:])
        size = _whole(where, fields[2]), _whole(where, fields[3])
        yield _whole(where, fields[0]), _lens(where, fields[1], *size, numbers), where


def _text_images(path: Path) -> Iterator[PosedImage]:
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
        yield _image(where, fields[9], _whole(where, fields[8]), pose[:4], pose[4:])
        expects_points = True


def _is_points_line(fields: Sequence[str]) -> bool:
    """Whether a line split nine times is x, y, id, … and not an image, whose name is no number."""
    try:
        for field in " ".join(fields).split()[:12]:
            float(field)
    except ValueError:
        return False
    return True


def _text_points(path: Path) -> Iterator[tuple[float, float, float]]:
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
            raise CaptureError(f"{where}: {field[:40]!r} must be a number") from error
        if not np.isfinite(value):
            raise CaptureError(f"{where}: {field[:40]} must be finite")
        values.append(value)
    return values


# Binary, little-endian.


class _Binary:
    """The bytes of a file, taken from the front; whatever they promise, no more than is there is read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.position = 0
        try:
            self.data = path.read_bytes()
        except OSError as error:
            raise CaptureError(f"{path} cannot be read: {error.strerror}; check its permissions") from error

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
            raise CaptureError(f"{self.where}: the image name does not end; copy the file again")
        raw = self.data[self.position : end]
        try:
            name = raw.decode()
        except UnicodeDecodeError as error:
            raise CaptureError(f"{self.where}: the image name {raw[:40]!r} is not UTF-8; rename it") from error
        self.position = end + 1
        return name

    def skip(self, count: int) -> None:
        if count > len(self.data) - self.position:
            raise CaptureError(
                f"{self.where}: {count} bytes needed, {len(self.data) - self.position} are left; "
                f"the file is truncated or no COLMAP model: copy it again"
            )
        self.position += count


def _binary_lenses(path: Path) -> Iterator[tuple[int, Lens, str]]:
    file = _Binary(path)
    for _ in range(file.take_count()):
        where = file.where
        camera_id, number, width, height = (int(value) for value in file.take("IiQQ"))
        if number not in _MODEL_BY_NUMBER:
            raise CaptureError(f"{where}: the camera model {number} is not known; known are {', '.join(LENS_MODELS)}")
        model = _MODEL_BY_NUMBER[number]
        parameters = file.take(f"{LENS_MODELS[model].parameters}d")
        yield camera_id, _lens(where, model, width, height, parameters), where


def _binary_images(path: Path) -> Iterator[PosedImage]:
    file = _Binary(path)
    for _ in range(file.take_count()):
        where = file.where
        _, *pose, camera_id = file.take("I7dI")
        name = file.take_name()
        file.skip(24 * file.take_count())  # x, y and point of each 2-D point
        yield _image(where, name, int(camera_id), pose[:4], pose[4:])


def _binary_points(path: Path) -> Iterator[tuple[float, float, float]]:
    file = _Binary(path)
    for _ in range(file.take_count()):
        where = file.where
        _, x, y, z = file.take("Q3d")
        file.skip(3 + 8)  # colour, error
        file.skip(8 * file.take_count())  # the track
        if not np.isfinite((x, y, z)).all():
            raise CaptureError(f"{where}: a point is not finite; remove it")
        yield x, y, z
