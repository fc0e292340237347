"""Known cameras: a COLMAP model, text or binary.

Read without COLMAP, whose library ends the process when a file breaks its promises.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.colmap.binary import read_binary_images, read_binary_lenses, read_binary_points
from usdfoliage.capture.colmap.posed_image import PosedImage
from usdfoliage.capture.colmap.text import read_text_images, read_text_lenses, read_text_points
from usdfoliage.capture.lens import Lens
from usdfoliage.errors import CaptureError

logger = logging.getLogger(__name__)

_MAX_BYTES = 4 * 2**30  # of a file: a model of a hundred million observations
_MAX_PLACE = 1e12  # of a point: one at infinity, that no picture places
_SUBFOLDERS = ("", "sparse/0", "sparse", "0")  # where COLMAP and what is built on it leave the model


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
        f"{cameras} has no COLMAP model", "put cameras.txt and images.txt (or cameras.bin and images.bin) there"
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
    for camera_id, lens, where in read_text_lenses(path) if path.suffix == ".txt" else read_binary_lenses(path):
        if camera_id in lenses:
            raise CaptureError(f"{where}: camera {camera_id} is there twice", "leave one")
        lenses[camera_id] = lens

    path = _existing(folder, "images")
    images: dict[str, PosedImage] = {}
    for image in read_text_images(path) if path.suffix == ".txt" else read_binary_images(path):
        if image.camera_id not in lenses:
            known = ", ".join(map(str, sorted(lenses)[:10])) or "none"
            raise CaptureError(f"{image.source}: camera {image.camera_id} is unknown; there is {known}")
        if image.name in images:
            raise CaptureError(f"{image.source}: {image.name} is there twice, first at {images[image.name].source}")
        images[image.name] = image
    if not images:
        raise CaptureError(f"{path} has no images", "give the poses of the photographs")
    logger.info("%s: %d cameras, %d images", folder, len(lenses), len(images))
    return CameraModel(folder=folder, lenses=lenses, images=tuple(images[name] for name in sorted(images)))


def read_model_points(folder: Path, max_points: int = 100_000) -> NDArray[np.float64]:
    """The first so many points of a COLMAP model, (N, 3) in its unit; none where it has no points3D.

    Raises:
        CaptureError: The file is truncated or not what COLMAP writes.
    """
    if not any((folder / f"points3D{suffix}").is_file() for suffix in (".txt", ".bin")):
        return np.zeros((0, 3))
    path = _existing(folder, "points3D")
    points = []
    for point in read_text_points(path) if path.suffix == ".txt" else read_binary_points(path):
        points.append(point)
        if len(points) >= max_points:
            break
    found = np.array(points, np.float64).reshape(-1, 3)
    return np.asarray(found[(np.abs(found) < _MAX_PLACE).all(axis=1)])


def _existing(folder: Path, stem: str) -> Path:
    for suffix in (".txt", ".bin"):
        path = folder / f"{stem}{suffix}"
        if path.is_file():
            if path.stat().st_size > _MAX_BYTES:
                raise CaptureError(f"{path} has {path.stat().st_size / 2**30:.1f} GiB; at most 4 are read")
            return path
    raise CaptureError(f"{folder} has neither {stem}.txt nor {stem}.bin", "copy the whole COLMAP model there")
