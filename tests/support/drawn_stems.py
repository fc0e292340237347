"""Photographs of tubes and leaves, drawn plainly from posed cameras: each bit is filled with one colour."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole

_FINER = 4  # pixels of what is drawn for one of the photograph, along each side
WALL = (205, 208, 214)
STEM = (70, 110, 60)
LEAF = (95, 150, 70)


def camera_at(
    position_m: Sequence[float], target_m: Sequence[float], focal_px: float = 500, size: int = 320
) -> Pinhole:
    """A camera that looks at a place, upright in a world with Y up."""
    position = np.array(position_m, np.float64)
    forward = np.array(target_m, np.float64) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward])
    return Pinhole(
        width_px=size,
        height_px=size,
        focal_px=(focal_px, focal_px),
        center_px=(size / 2, size / 2),
        cam_from_world=np.column_stack([turn, -turn @ position]),
    )


def ring_of_cameras(count: int, height_m: Sequence[float] = (0.25, 0.45), distance_m: float = 0.6) -> list[Pinhole]:
    """Cameras all around, at heights in turn, that look at a plant of 0.3 m."""
    return [
        camera_at(
            (distance_m * np.cos(turn), height_m[number % len(height_m)], distance_m * np.sin(turn)), (0, 0.15, 0)
        )
        for number, turn in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False))
    ]


def draw_view(
    camera: Pinhole,
    tubes: Sequence[tuple[NDArray[np.float64], float]] = (),
    leaves: Sequence[NDArray[np.float64]] = (),
    *,
    with_depth: bool = True,
) -> View:
    """What a camera sees of tubes, each an axis (N, 3) and a radius, and of flat leaves, each a border (N, 3).

    The nearest is drawn last. Depth is that of leaves alone: tubes are what depth loses.
    """
    fine = camera.resized(_FINER * camera.width_px, _FINER * camera.height_px)
    picture = np.full((fine.height_px, fine.width_px, 3), WALL, np.uint8)
    depth_m = np.zeros((fine.height_px, fine.width_px), np.float32)
    bits: list[tuple[float, NDArray[np.float64], float, tuple[int, int, int]]] = []
    for axis_m, radius_m in tubes:
        _, away_m = camera.project(axis_m)
        bits += [
            (float(away_m[at : at + 2].mean()), axis_m[at : at + 2], radius_m, STEM) for at in range(len(axis_m) - 1)
        ]
    for number, border_m in enumerate(leaves):
        shade = 0.7 + 0.1 * (number % 5)
        bits.append(
            (float(camera.project(border_m)[1].mean()), border_m, 0.0, tuple(int(shade * each) for each in LEAF))  # type: ignore[arg-type]
        )
    for away_m, points_m, radius_m, color in sorted(bits, key=lambda bit: -bit[0]):
        places = np.rint(fine.project(points_m)[0] * 16).astype(np.int32)
        if radius_m > 0:
            wide = max(1, round(2 * radius_m * fine.focal_px[0] / away_m))
            cv2.line(picture, places[0].tolist(), places[1].tolist(), color, wide, cv2.LINE_8, 4)
            continue
        cv2.fillPoly(picture, [places], color, cv2.LINE_8, 4)
        cv2.fillPoly(depth_m, [places], away_m, cv2.LINE_8, 4)
    small = cv2.resize(picture, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)
    middle = depth_m[_FINER // 2 :: _FINER, _FINER // 2 :: _FINER] if with_depth else None
    shape = (camera.height_px, camera.width_px)
    return View(
        name="drawn",
        camera=camera,
        srgb=np.ascontiguousarray(small),
        depth_m=np.zeros(shape, np.float32) if middle is None else np.ascontiguousarray(middle),
    )
