"""What a COLMAP model states of images and cameras, checked, whichever form it is written in."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.lens import Lens
from usdfoliage.errors import CaptureError

_MAX_TRANSLATION = 1e9  # units: beyond it a pixel is lost in the rounding of places
_MAX_NORM_ERROR = 0.01  # of a quaternion: what two printed digits leave


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedImage:
    """A photograph whose camera and place are known."""

    name: str  # below the folder of images, "/" between folders
    camera_id: int
    cam_from_world: NDArray[np.float64]  # (3, 4), camera axes x right, y down, z forward; in the model's unit
    source: str  # file and line, or byte, of it


def checked_lens(where: str, model: str, width: int, height: int, parameters: Sequence[float]) -> Lens:
    """The lens that a file states.

    Raises:
        CaptureError: There is no such lens; the message begins with where.
    """
    try:
        return Lens(model=model, width_px=width, height_px=height, parameters=tuple(parameters))
    except ValueError as error:
        raise CaptureError(f"{where}: {error}") from error


def checked_image(
    where: str, name: str, camera_id: int, quaternion: Sequence[float], translation: Sequence[float]
) -> PosedImage:
    """The image that a file states, by a quaternion w, x, y, z and a translation from the world to the camera.

    Raises:
        CaptureError: The pose is none, or the name leads out of the folder of images; the message begins with where.
    """
    if not all(math.isfinite(number) for number in (*quaternion, *translation)):
        raise CaptureError(f"{where}: the pose of {name!r} is not finite", "remove the image or pose it again")
    if max(map(abs, translation)) > _MAX_TRANSLATION:
        raise CaptureError(
            f"{where}: {name!r} is {max(map(abs, translation)):g} units away; at most {_MAX_TRANSLATION:g} can be used"
        )
    norm = math.hypot(*quaternion)
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
    if (
        not name
        or any(ord(letter) < 32 or ord(letter) == 127 for letter in name)
        or (".." in parts or "" in parts or re.match(r"[A-Za-z]:", name))
    ):
        raise CaptureError(f"{where}: the image name {name!r} must be relative and stay inside the folder of images")
    return PurePosixPath(name).as_posix()
