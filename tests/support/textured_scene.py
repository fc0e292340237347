"""Photographs of a corner covered with noise, from cameras that are known."""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.lens import Lens

from tests.support.captures import look_at

LENS = Lens(model="SIMPLE_PINHOLE", width_px=320, height_px=240, parameters=(300.0, 160.0, 120.0))
TEXTURE_PX = 512
EXTENT = 2.0  # a texture's side, in the scene's unit


def arc(count: int, span_rad: float = 1.0) -> dict[str, NDArray[np.float64]]:
    """Poses on an arc that look into the corner, by the names of their photographs."""
    poses = {}
    for number, angle in enumerate(np.linspace(-span_rad / 2, span_rad / 2, count)):
        direction = np.array([np.cos(angle + np.pi / 4), 0.55, np.sin(angle + np.pi / 4)])
        poses[f"{number:02d}.png"] = look_at(2.6 * direction, (0.55, 0.45, 0.55))
    return poses


def render(pose: NDArray[np.float64], seed: int = 0, lens: Lens = LENS) -> NDArray[np.uint8]:
    """(H, W), the planes x = 0, y = 0 and z = 0, each with its own noise."""
    rng = np.random.default_rng(seed)
    noises = []
    for _ in range(3):
        noise = sum(
            cv2.resize(rng.normal(0, 1, (TEXTURE_PX // step,) * 2), (TEXTURE_PX,) * 2, interpolation=cv2.INTER_CUBIC)
            for step in (4, 8, 16, 32)
        )
        noises.append(np.asarray(128 + 28 * noise, np.float32))
    camera = lens.pinhole(pose)
    rays = camera.rays() @ pose[:, :3]
    place = camera.position_m
    nearest = np.full(rays.shape[:2], np.inf)
    picture = np.full(rays.shape[:2], 90, np.float32)
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = -place[axis] / rays[..., axis]
        hit = place + along[..., None] * rays
        u, v = (hit[..., other] * (TEXTURE_PX / EXTENT) for other in others)
        visible = (along > 0) & (along < nearest) & (np.minimum(u, v) > 0) & (np.maximum(u, v) < TEXTURE_PX - 1)
        value = cv2.remap(noises[axis], u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
        nearest[visible], picture[visible] = along[visible], value[visible]
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def write_photos(
    folder: Path, poses: Mapping[str, NDArray[np.float64]], seed: int = 0, lens: Lens = LENS
) -> dict[str, NDArray[np.uint8]]:
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {name: render(pose, seed, lens) for name, pose in poses.items()}
    for name, picture in pictures.items():
        assert cv2.imwrite(str(folder / name), picture)
    return pictures
