"""Photographs of a scene that is known exactly: textured leaves over a textured ground, for tests of whole runs."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.lens import Lens
from usdfoliage.geometry.pinhole import Pinhole

from tests.support.captures import look_at, write_text_model

LENS = Lens(model="PINHOLE", width_px=128, height_px=96, parameters=(120.0, 120.0, 64.0, 48.0))
_FINER = 2  # pictures are drawn so many times finer, and reduced

# Rounds of few pixels, for runs of a second.
FAST = """
[depth]
max_side_px = 128
sources = 3
rounds = [{ level = 1, iterations = 2, coherent = false }, { level = 0, iterations = 1, coherent = true }]

[depth.matching]
best_sources = 2
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaf:
    """A flat ellipse, textured."""

    center_m: NDArray[np.float64]  # (3,)
    along: NDArray[np.float64]  # (3,), from the centre to the apex
    across: NDArray[np.float64]  # (3,), from the centre to the edge, square to along
    texture: NDArray[np.uint8]  # (H, W, 3)


def scene(count: int = 5, seed: int = 0) -> list[Leaf]:
    """The ground, z = 0, first; then leaves over it."""
    rng = np.random.default_rng(seed)
    ground = Leaf(
        center_m=np.zeros(3),
        along=np.array([0.0, 4.0, 0.0]),
        across=np.array([4.0, 0.0, 0.0]),
        texture=_texture(rng, 800, (120, 100, 70)),
    )
    leaves = [ground]
    for number in range(count):
        angle = 2 * np.pi * number / count
        along = np.array([np.cos(2 * angle), np.sin(2 * angle), rng.uniform(-0.4, 0.4)])
        along /= np.linalg.norm(along)
        across = np.cross([0.0, 0.0, 1.0], along)
        leaves.append(
            Leaf(
                center_m=np.array([0.55 * np.cos(angle), 0.4 * np.sin(angle), rng.uniform(0.2, 0.5)]),
                along=0.33 * along,
                across=0.2 * across / np.linalg.norm(across),
                texture=_texture(rng, 64, (60, 140, 40)),
            )
        )
    return leaves


def poses(count: int = 5) -> dict[str, NDArray[np.float64]]:
    """Cameras above the scene, by the names of their photographs."""
    angles = np.linspace(-0.3, 0.3, count)
    places = [(2.2 * np.sin(a), 0.25 * (-1) ** k, 2.2 * np.cos(a)) for k, a in enumerate(angles)]
    return {f"leaf {k}.png": look_at(place, (0, 0, 0.2), up=(0, 1, 0)) for k, place in enumerate(places)}


def draw(leaves: list[Leaf], camera: Pinhole) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]:
    """The photograph (H, W, 3), red first, its depth (H, W), and which leaf each pixel shows, from 0 for the ground."""
    rays = camera.rays() @ camera.cam_from_world[:, :3]
    depth = np.full(rays.shape[:2], np.inf)
    color = np.zeros((*rays.shape[:2], 3), np.uint8)
    leaf_ids = np.full(rays.shape[:2], -1, np.int32)
    for number, leaf in enumerate(leaves):
        normal = np.cross(leaf.along, leaf.across)
        distance = (leaf.center_m - camera.position_m) @ normal / (rays @ normal)
        local = camera.position_m + rays * distance[..., None] - leaf.center_m
        u = local @ leaf.across / (leaf.across @ leaf.across)
        v = local @ leaf.along / (leaf.along @ leaf.along)
        height, width = leaf.texture.shape[:2]
        inside = (distance > 0) & (distance < depth) & (np.maximum(abs(u), abs(v)) < 1)
        if number:
            inside &= u**2 + v**2 < 1
        x, y = ((u + 1) / 2 * width - 0.5).astype(np.float32), ((v + 1) / 2 * height - 0.5).astype(np.float32)
        seen = cv2.remap(leaf.texture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        color[inside], depth[inside], leaf_ids[inside] = seen[inside], distance[inside], number
    return color, np.where(np.isfinite(depth), depth, 0).astype(np.float32), leaf_ids


def write_photos(
    images: Path, names: Mapping[str, NDArray[np.float64]] | None = None, lens: Lens = LENS
) -> dict[str, NDArray[np.float64]]:
    """Photographs of the scene into a folder; their poses by name."""
    names = poses() if names is None else names
    images.mkdir(parents=True, exist_ok=True)
    leaves = scene()
    for name, pose in names.items():
        fine = Pinhole(
            width_px=lens.width_px * _FINER,
            height_px=lens.height_px * _FINER,
            focal_px=(lens.focal_px[0] * _FINER, lens.focal_px[1] * _FINER),
            center_px=(lens.center_px[0] * _FINER, lens.center_px[1] * _FINER),
            cam_from_world=pose,
        )
        picture = cv2.resize(draw(leaves, fine)[0], (lens.width_px, lens.height_px), interpolation=cv2.INTER_AREA)
        assert cv2.imwrite(str(images / name), picture[..., ::-1])
    return dict(names)


def write_posed_photos(folder: Path, settings: str = 'up_axis = "Z"\n') -> dict[str, NDArray[np.float64]]:
    """A capture of images/, cameras/ without points, capture.toml, and fast.toml for quick runs."""
    made = write_photos(folder / "images")
    write_text_model(folder / "cameras", made, [LENS], np.zeros((0, 3)))
    if settings:
        (folder / "capture.toml").write_text(settings)
    (folder / "fast.toml").write_text(FAST)
    return made


def _texture(rng: np.random.Generator, side: int, color: tuple[int, int, int]) -> NDArray[np.uint8]:
    """Noise of several sizes around a colour."""
    noise = np.zeros((side, side, 1), np.float32)
    for coarse in (1, 2, 4, 8):
        cells = rng.normal(size=(side // coarse, side // coarse)).astype(np.float32)
        noise[..., 0] += cv2.resize(cells, (side, side), interpolation=cv2.INTER_CUBIC) * 16
    return np.clip(np.array(color) + noise, 0, 255).astype(np.uint8)
