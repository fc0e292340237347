"""Which of a capture's cameras a plant is compared from, and where a camera of ours stands to see all of it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.pinhole import Pinhole

FILLED = 0.92  # of a picture's half, that a plant takes at most
SEEN = 0.5  # of a box's corners, that a camera must have in its picture


def choose_cameras(cameras: Sequence[Pinhole], box_m: NDArray[np.float64], max_count: int) -> list[int]:
    """Cameras that look at a box from directions as different as can be, in the order of their numbers.

    The first is the one in whose picture the box is largest; each further one is farthest, by angle, from all before
    (farthest-first traversal, T. Gonzalez 1985). Cameras that see less than half of the box's corners serve only where
    too few see more.

    Args:
        cameras: In the box's frame.
        box_m: (2, 3), its lowest and highest corner.
        max_count: How many to choose.
    """
    if max_count < 1 or not cameras:
        return []
    corners_m = box_corners(box_m)
    shares, sizes = zip(*(_measure_seen(camera, corners_m) for camera in cameras), strict=True)
    seeing = [number for number, share in enumerate(shares) if share >= SEEN]
    if len(seeing) < max_count:
        seeing = sorted(sorted(range(len(cameras)), key=lambda number: -shares[number])[:max_count])
    away = np.array([cameras[number].position_m for number in seeing]) - box_m.mean(axis=0)
    directions = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
    chosen = [int(np.argmax([sizes[number] for number in seeing]))]
    nearest = directions @ directions[chosen[0]]  # cosine of the angle to the nearest chosen one
    while len(chosen) < min(max_count, len(seeing)):
        nearest[chosen] = np.inf
        chosen.append(int(np.argmin(np.round(nearest, 9))))  # rounded: of two equal ones the first, on any machine
        nearest = np.maximum(nearest, directions @ directions[chosen[-1]])
    return sorted(seeing[place] for place in chosen)


def frame_box(
    box_m: NDArray[np.float64],
    azimuth_rad: float,
    elevation_rad: float,
    size_px: tuple[int, int],
    field_rad: float = np.radians(30.0),
) -> Pinhole:
    """A camera that looks at the middle of a box, Y up, from just so far that all of it is in the picture.

    Args:
        box_m: (2, 3), its lowest and highest corner.
        azimuth_rad: Where the camera stands: 0 before the front, +Z, growing towards +X.
        elevation_rad: Above the horizon, less than a quarter turn.
        size_px: Width and height.
        field_rad: That the shorter side of the picture takes in.
    """
    width_px, height_px = size_px
    focal_px = min(size_px) / 2 / np.tan(field_rad / 2)
    towards = np.array(
        [
            np.sin(azimuth_rad) * np.cos(elevation_rad),
            np.sin(elevation_rad),
            np.cos(azimuth_rad) * np.cos(elevation_rad),
        ]
    )
    right = np.array([np.cos(azimuth_rad), 0.0, -np.sin(azimuth_rad)])
    rotation = np.stack([right, -np.cross(towards, right), -towards])  # of x right, y down, z forward
    middle_m = box_m.mean(axis=0)
    in_camera = (box_corners(box_m) - middle_m) @ rotation.T
    reach = np.array([width_px, height_px]) / 2 * FILLED / focal_px
    distance_m = max(float((np.abs(in_camera[:, :2]) / reach - in_camera[:, 2:]).max()), 1e-3)
    translation = np.array([0, 0, distance_m]) - rotation @ middle_m
    return Pinhole(
        width_px=width_px,
        height_px=height_px,
        focal_px=(float(focal_px), float(focal_px)),
        center_px=(width_px / 2, height_px / 2),
        cam_from_world=np.column_stack([rotation, translation]),
    )


def box_corners(box_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(8, 3) of (2, 3)."""
    low, high = box_m
    return np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(8, 3)


def _measure_seen(camera: Pinhole, corners_m: NDArray[np.float64]) -> tuple[float, float]:
    """Share of the corners that a camera has in its picture, and share of its picture that they span."""
    places, depth_m = camera.project(corners_m)
    size = np.array([camera.width_px, camera.height_px], np.float64)
    with np.errstate(invalid="ignore"):
        seen = np.all((places >= 0) & (places <= size), axis=1) & (depth_m > 0)
    if not seen.any():
        return 0.0, 0.0
    inside = np.clip(places[depth_m > 0], 0, size)
    return float(seen.mean()), float(np.prod((inside.max(axis=0) - inside.min(axis=0)) / size))
