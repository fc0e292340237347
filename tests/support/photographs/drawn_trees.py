"""A tree drawn over a sky, whose leaves and branches are known."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.sketch.strokes import Strokes, TreeStrokes, strokes_beside, write_strokes

SKY, LEAF, BARK, GRASS = (190, 210, 240), (60, 120, 40), (90, 70, 55), (130, 150, 70)


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnTree:
    """A picture (H, W, 3), the strokes over it, and the truth."""

    srgb: NDArray[np.uint8]
    strokes: TreeStrokes
    leaves: NDArray[np.bool_]  # (H, W)
    branches: tuple[NDArray[np.float64], ...]  # polylines in pixels; the trunk first


def draw_leafy(width: int = 300, height: int = 400, seed: int = 0) -> DrawnTree:
    """A round crown of leaves on a stem, before a sky, over grass."""
    rng = np.random.default_rng(seed)
    picture = _background(width, height)
    trunk = np.array([[0.5, 0.95], [0.5, 0.4]]) * [width, height]
    cv2.line(picture, *(tuple(map(int, each)) for each in trunk), BARK, max(4, width // 25))
    leaves = np.zeros((height, width), np.uint8)
    middle, radius = (width // 2, int(0.38 * height)), int(0.32 * width)
    cv2.circle(leaves, middle, radius, 1, -1)
    shade = rng.uniform(0.7, 1.3, (height, width, 1))
    picture = np.where(leaves[..., None] > 0, np.clip(np.array(LEAF) * shade, 0, 255), picture).astype(np.uint8)
    picture = _noisy(picture, rng)
    angle = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    crown = np.array(middle) + 1.1 * radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    stroke = np.array([[0.5, 0.95], [0.5, 0.7], [0.5, 0.5]]) * [width, height]
    return DrawnTree(
        srgb=picture,
        strokes=TreeStrokes(crown_px=crown, branches_px=(stroke,)),
        leaves=leaves > 0,
        branches=(trunk,),
    )


def draw_bare(width: int = 400, height: int = 500, seed: int = 0) -> DrawnTree:
    """A trunk that forks thrice, without leaves."""
    rng = np.random.default_rng(seed)
    picture = _background(width, height)
    size = np.array([width, height])
    lines = [
        (np.array([[0.5, 0.95], [0.5, 0.5], [0.52, 0.12]]), 14, 4),
        (np.array([[0.5, 0.55], [0.3, 0.4], [0.2, 0.2]]), 7, 3),
        (np.array([[0.505, 0.45], [0.7, 0.35], [0.8, 0.18]]), 6, 3),
        (np.array([[0.3, 0.4], [0.15, 0.42]]), 4, 2),
    ]
    for line, thick, thin in lines:
        points = line * size
        for k in range(len(points) - 1):
            wide = round(thick + (thin - thick) * k / max(len(points) - 2, 1))
            one, two = (tuple(map(int, np.round(each))) for each in points[k : k + 2])
            cv2.line(picture, one, two, BARK, wide, cv2.LINE_AA)
    crown = np.array([[0.5, 0.62], [0.1, 0.5], [0.12, 0.15], [0.5, 0.05], [0.88, 0.12], [0.85, 0.5]]) * size
    return DrawnTree(
        srgb=_noisy(picture, rng),
        strokes=TreeStrokes(crown_px=crown, branches_px=(np.array([[0.5, 0.95], [0.5, 0.6]]) * size,)),
        leaves=np.zeros((height, width), bool),
        branches=tuple(line * size for line, _, _ in lines),
    )


def _background(width: int, height: int) -> NDArray[np.uint8]:
    picture = np.empty((height, width, 3), np.uint8)
    picture[:] = SKY
    picture[int(0.9 * height) :] = GRASS
    return picture


def _noisy(picture: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    return np.clip(picture + rng.normal(0, 4, picture.shape), 0, 255).astype(np.uint8)


def write_photograph(folder: Path, tree: DrawnTree, name: str, trees: int = 1) -> tuple[Path, Path]:
    """The picture as name.png and the strokes beside it, so many times; returns both files."""
    photo = folder / f"{name}.png"
    cv2.imwrite(str(photo), tree.srgb[..., ::-1])
    height, width = tree.srgb.shape[:2]
    strokes = strokes_beside(photo)
    write_strokes(strokes, Strokes(image=photo.name, width_px=width, height_px=height, trees=(tree.strokes,) * trees))
    return photo, strokes
