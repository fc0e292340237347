"""Pictures of reports: shrunk, coloured, written."""

from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import whole_file
from usdfoliage.geometry.pinhole import Pinhole

Value = TypeVar("Value", bound=np.generic)


def shrink_view(view: View, longest_px: int) -> View:
    """The view with no side of its picture longer than this; depth and mask are those of single pixels."""
    size = shrunk_size(view.depth_m.shape, longest_px)
    if size == view.depth_m.shape:
        return view
    return replace(
        view,
        camera=shrink_camera(view.camera, longest_px, np.eye(4)),
        srgb=shrink_to(view.srgb, longest_px),
        depth_m=pick_pixels(view.depth_m, size),
        mask=None if view.mask is None else pick_pixels(view.mask, size),
    )


def pick_pixels(values: NDArray[Value], size: tuple[int, int]) -> NDArray[Value]:
    """(h, w) of (H, W): the pixels in which the centres of a picture of this size lie."""
    rows, columns = (
        ((np.arange(small) + 0.5) * (large / small)).astype(np.intp)
        for large, small in zip(values.shape, size, strict=True)
    )
    return values[rows[:, None], columns]


def shrink_to(picture: NDArray[np.uint8], longest_px: int) -> NDArray[np.uint8]:
    """The picture with no side longer than this."""
    height, width = shrunk_size(picture.shape[:2], longest_px)
    if (height, width) == picture.shape[:2]:
        return picture
    return np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def shrink_camera(camera: Pinhole, longest_px: int, stage_from_world: NDArray[np.float64]) -> Pinhole:
    """The camera of a shrunk picture, in a frame (4, 4) that is turned and moved against its world."""
    height, width = shrunk_size((camera.height_px, camera.width_px), longest_px)
    world_from_stage = np.linalg.inv(stage_from_world)
    cam_from_stage = camera.cam_from_world[:, :3] @ world_from_stage[:3]
    cam_from_stage[:, 3] += camera.cam_from_world[:, 3]
    return replace(camera.resized(width, height), cam_from_world=cam_from_stage)


def shrunk_size(size: tuple[int, ...], longest_px: int) -> tuple[int, int]:
    """Height and width with no side longer than this."""
    scale = min(1.0, longest_px / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


TURBO, VIRIDIS = cv2.COLORMAP_TURBO, cv2.COLORMAP_VIRIDIS


def color_values(values: NDArray[np.floating], low: float, high: float, colors: int) -> NDArray[np.uint8]:
    """(..., 3), values from low to high in the colours of one of cv2's maps."""
    scaled = np.clip((np.asarray(values, np.float64) - low) / max(high - low, 1e-300), 0, 1)
    return color_table(colors)[np.rint(255 * scaled).astype(np.uint8)]


def color_table(colors: int) -> NDArray[np.uint8]:
    """(256, 3), red, green and blue of one of cv2's maps."""
    return np.ascontiguousarray(cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], colors)[:, 0, ::-1])


def write_picture(path: Path, picture: NDArray[np.uint8], *, jpeg_quality: int = 88) -> str:
    """Write a picture (H, W) or (H, W, 3), red, green, blue; the file appears whole. Returns its name.

    Raises:
        WriteError: It cannot be written.
    """
    quality = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if path.suffix == ".jpg" else []
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR) if picture.ndim == 3 else picture
    good, encoded = cv2.imencode(path.suffix, bgr, quality)
    if not good:
        raise CaptureError(f"the picture {path.name} of the report could not be encoded")
    with whole_file(path) as new:
        new.write_bytes(encoded.tobytes())
    return path.name


def leaf_palette(count: int) -> NDArray[np.uint8]:
    """(count, 3) bright sRGB colours of which neighbours differ."""
    number = np.arange(count)
    hue = (number * (5**0.5 - 1) / 2) % 1
    hsv = np.column_stack([hue * 179, 150 + 50 * (number % 3), 255 - 30 * (number // 3 % 3)])
    rgb = cv2.cvtColor(np.rint(hsv).astype(np.uint8)[None], cv2.COLOR_HSV2RGB)[0] if count else np.zeros((0, 3))
    return np.asarray(rgb, np.uint8).reshape(count, 3)
