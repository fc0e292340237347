"""Where up is in a world of cameras: by how cameras were turned, by where they stood, by ground and trunk."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.photo_set import PhotoFile
from usdfoliage.capture.poses.result import Registered

Array = NDArray[np.float64]

# What each way of finding up is wrong by even where it is found exactly: lawns slope, rings lean, trunks more.
_LEVEL_RAD, _GROUND_RAD, _RING_RAD, _TRUNK_RAD, _PICTURES_RAD = (math.radians(angle) for angle in (0.5, 2, 2, 6, 12))
_TURNED_RAD = math.radians(40)  # from the pictures' tops, from which on a ring of cameras is believed instead of them
_INWARD = 0.8  # share of a ring's cameras that look inwards
_TOPS_AGREE = 0.5  # mean of the pictures' tops along the ring's axis
_LOOKS_DOWN = 0.09  # mean of where the cameras look along it: 5 degrees
# Where the stored pixels' picture has its top, by EXIF orientation: x right, y down.
_TOP = {1: (0, -1), 2: (0, -1), 3: (0, 1), 4: (0, 1), 5: (-1, 0), 6: (-1, 0), 7: (1, 0), 8: (1, 0)}


class UpDirection(NamedTuple):
    """One way of finding up."""

    method: str
    direction: Array  # (3,), unit, in the reconstruction
    error_rad: float  # estimated


def find_ups(
    registered: Registered,
    poses: Array,
    centers: Array,
    files: Sequence[PhotoFile | None],
    gps: UpDirection | None,
    distance: float,
) -> list[UpDirection]:
    """Every way in which up is found; at least by the pictures' tops.

    Args:
        registered: Cameras and points.
        poses: (N, 3, 4), cam_from_world of its photographs.
        centers: (N, 3), of the cameras.
        files: What the files of the photographs state; None where there is none.
        gps: Up by the positions in the files.
        distance: From the cameras to what they see, in units of the reconstruction.
    """
    tops = np.array([_TOP[file.orientation if file else 1] for file in files], np.float64)
    picture_up = np.einsum("nji,nj->ni", poses[:, :2, :3], tops)
    picture_right = np.einsum("nji,nj->ni", poses[:, :2, :3], np.column_stack([-tops[:, 1], tops[:, 0]]))
    forward = poses[:, 2, :3]
    ups: list[UpDirection] = []

    mean = picture_up.mean(axis=0)
    rough = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 0.1 else picture_up[0]
    inward = _inward_ring(centers, forward, picture_up, registered.points, distance)
    # A robot's camera may stand on its side, or on its head: its pictures' tops are none.
    turned = inward if inward is not None and inward.direction @ rough < math.cos(_TURNED_RAD) else None
    looking_down = np.linalg.norm(mean) < 0.5 and np.linalg.norm(forward.mean(axis=0)) > 0.9
    level = _level(picture_right, -forward.mean(axis=0) if looking_down else rough)
    if turned is not None:
        level = _level(picture_right, turned.direction)
        if level is not None and level.direction @ turned.direction < math.cos(_TURNED_RAD):
            level = None
    if looking_down:  # pictures from above have their tops anywhere
        ups.append(
            UpDirection("photographs", -forward.mean(axis=0) / np.linalg.norm(forward.mean(axis=0)), _PICTURES_RAD)
        )
    else:
        ups.append(UpDirection("photographs", rough, _PICTURES_RAD))
    if level is not None:
        ups.append(level)
    if gps is not None:
        ups.append(gps)
    elevation = _by_elevation(picture_right, forward, files)
    if elevation is not None:
        ups.append(elevation)
    first = min(ups, key=lambda up: up.error_rad).direction if turned is None else turned.direction
    ring = _ring(centers, first) if turned is None else turned
    if ring is not None:
        ups.append(ring)
    ground = _ground(registered.points, centers, first, distance)
    if ground is not None:
        ups.append(ground)
    trunk = _trunk(registered.points, centers, first)
    if trunk is not None:
        ups.append(trunk)
    return ups


def _inward_ring(
    centers: Array, forward: Array, picture_up: Array, points: Array, distance: float
) -> UpDirection | None:
    """The axis of a ring of cameras that look inwards, however their pictures are turned. Our own.

    Which of its two directions is up, the support shows, which the plant and the cameras are above; else the pictures'
    tops, where they agree; else the cameras, which look down on a plant sooner than up. Tops that agree are not
    overruled by a support alone, which may be a ceiling: the cameras must look down on it too.
    """
    plane = _ring_plane(centers)
    if plane is None:
        return None
    axis, error_rad = plane
    towards = centers.mean(axis=0) - centers
    towards = towards - (towards @ axis)[:, None] * axis
    if float(np.mean(np.einsum("ni,ni->n", towards, forward) > 0)) < _INWARD:
        return None
    tops, looks = float((picture_up @ axis).mean()), float((forward @ axis).mean())
    above = _ground(points, centers, axis, distance) is not None
    below = _ground(points, centers, -axis, distance) is not None
    support = int(above) - int(below)  # 0: seen on neither side, or on both
    if abs(tops) > _TOPS_AGREE and not (support * tops < 0 and support * looks < -_LOOKS_DOWN):
        sign = np.sign(tops)
    elif support:
        sign = np.sign(support)
    else:
        sign = np.sign(tops) if abs(tops) > abs(looks) else -np.sign(looks)
    return UpDirection("ring", axis * (sign or 1.0), error_rad)


def _ring_plane(centers: Array) -> tuple[Array, float] | None:
    """The normal of the plane of a ring of cameras, and its error; None of a line, or of places at all heights."""
    if len(centers) < 6:
        return None
    values, vectors = np.linalg.eigh(np.cov(centers.T))
    thick, narrow, wide = np.sqrt(np.maximum(values, 0))
    if narrow < 0.5 * wide or thick > 0.3 * narrow:
        return None
    return vectors[:, 0], math.atan(thick / (narrow * math.sqrt(len(centers)))) + _RING_RAD


def _level(picture_right: Array, towards: Array) -> UpDirection | None:
    """Up across all pictures' lower edges: cameras are turned and tipped, but seldom rolled.

    Source: R. Szeliski, Image Alignment and Stitching, 2006, section 2.3.2.
    """
    if len(picture_right) < 3:
        return None
    values, vectors = np.linalg.eigh(picture_right.T @ picture_right / len(picture_right))
    roll, turned = np.sqrt(max(values[0], 0)), np.sqrt(max(values[1], 0))
    if turned < 3 * roll or turned < 0.05:
        return None  # all look in one direction, and so their roll is unknown
    up = vectors[:, 0] * (1 if vectors[:, 0] @ towards >= 0 else -1)
    return UpDirection("level", up, math.atan(roll / (turned * math.sqrt(len(picture_right)))) + _LEVEL_RAD)


def _by_elevation(picture_right: Array, forward: Array, files: Sequence[PhotoFile | None]) -> UpDirection | None:
    """Up by the angle above the horizon that the photographs' EXIF states."""
    known = [number for number, file in enumerate(files) if file is not None and file.elevation_deg is not None]
    if len(known) < 3:
        return None
    angles = np.radians([file.elevation_deg for file in files if file is not None and file.elevation_deg is not None])
    matrix = np.concatenate([forward[known], picture_right[known]])
    side = np.concatenate([np.sin(angles), np.zeros(len(known))])
    up, _, rank, _ = np.linalg.lstsq(matrix, side, rcond=1e-3)
    if rank < 3 or not 0.7 < np.linalg.norm(up) < 1.4:
        return None
    residual = float(np.sqrt(np.mean(np.square(matrix @ up - side))))
    return UpDirection("elevation", up / np.linalg.norm(up), residual / math.sqrt(len(known)) + _LEVEL_RAD)


def _ring(centers: Array, towards: Array) -> UpDirection | None:
    """The axis of a ring of cameras around the plant."""
    plane = _ring_plane(centers)
    if plane is None:
        return None
    normal, error_rad = plane
    axis = normal * (1 if normal @ towards >= 0 else -1)
    if axis @ towards < math.cos(math.radians(30)):
        return None  # a ring over the top
    return UpDirection("ring", axis, error_rad)


def _ground(points: Array, centers: Array, towards: Array, distance: float) -> UpDirection | None:
    """The normal of a plane that many points lie on and nearly none below, the cameras above.

    Source: M. Fischler, R. Bolles, Random sample consensus, 1981; with our own conditions on the sides of the plane.
    """
    near = np.median(points, axis=0) if len(points) else np.zeros(3)
    points = points[np.linalg.norm(points - near, axis=1) < 3 * distance]
    if len(points) < 50:
        return None
    low = points[points @ towards <= np.quantile(points @ towards, 0.6)]
    within = 0.01 * distance
    rng = np.random.default_rng(0)  # any: the best of many tries is the same plane
    best: NDArray[np.bool_] | None = None
    for _ in range(400):
        a, b, c = low[rng.choice(len(low), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-12 * distance**2:
            continue
        normal = normal / length * (1 if normal @ towards >= 0 else -1)
        if normal @ towards < math.cos(math.radians(25)):
            continue
        on = np.abs((low - a) @ normal) < within
        if best is None or on.sum() > best.sum():
            best = on
    if best is None or best.sum() < max(30, 0.1 * len(points)):
        return None
    for _ in range(3):
        middle = low[best].mean(axis=0)
        _, sizes, vt = np.linalg.svd(low[best] - middle, full_matrices=False)
        normal = vt[2] * (1 if vt[2] @ towards >= 0 else -1)
        best = np.abs((low - middle) @ normal) < within
        if best.sum() < 30:
            return None
    below = float(np.mean((points - middle) @ normal < -5 * within))
    spread = sizes[1] / math.sqrt(float(best.sum()))
    if below > 0.05 or spread < 0.05 * distance or float(np.mean((centers - middle) @ normal > 0)) < 0.9:
        return None
    thickness = sizes[2] / math.sqrt(float(best.sum()))
    error = math.atan(thickness / spread / math.sqrt(max(best.sum() / 10, 1))) + _GROUND_RAD
    return UpDirection("ground", normal, error)


def _trunk(points: Array, centers: Array, towards: Array) -> UpDirection | None:
    """The direction of a thin upright column of points amid the cameras."""
    if len(points) < 50 or len(centers) < 6:
        return None
    right = np.linalg.svd(np.eye(3) - np.outer(towards, towards))[0][:, :2]
    flat, around = points @ right, centers @ right
    radius = float(np.median(np.linalg.norm(around - around.mean(axis=0), axis=1)))
    inner = np.linalg.norm(flat - around.mean(axis=0), axis=1) < 0.5 * radius
    if inner.sum() < 50 or radius == 0:
        return None
    heights = points[inner] @ towards
    low = points[inner][heights < np.quantile(heights, 0.4)]
    column = low[np.linalg.norm((low - np.median(low, axis=0)) @ right, axis=1) < 0.05 * radius]
    if len(column) < 30:
        return None
    _, sizes, vt = np.linalg.svd(column - column.mean(axis=0), full_matrices=False)
    if sizes[0] < 4 * sizes[1] or abs(vt[0] @ towards) < math.cos(math.radians(25)):
        return None
    axis = vt[0] * (1 if vt[0] @ towards >= 0 else -1)
    return UpDirection("trunk", axis, math.atan(sizes[1] / sizes[0] / math.sqrt(len(column) / 10)) + _TRUNK_RAD)
