"""How few vertices the mesh of a crown needs so that its silhouettes stay what they are. Our own."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.crown_mesh import CrownMesh, build_crown_mesh
from usdfoliage.geometry.picture_agreement import silhouette_iou


@dataclass(frozen=True, kw_only=True)
class MeshSizeSettings:
    """Which sizes are tried, and what a silhouette must keep."""

    sizes: tuple[int, ...] = (17, 25, 33, 41, 49, 57, 65, 97)  # vertices along a cube edge; odd, so that poles are some
    finest: int = 129  # what the others are compared with, and what is taken where none of them is good enough
    min_iou: float = 0.98  # of each silhouette with that of the finest mesh
    views: int = 12
    side_px: int = 400  # of the picture of a silhouette


def choose_mesh_size(radius_m: NDArray[np.floating], settings: MeshSizeSettings = MeshSizeSettings()) -> int:
    """Vertices along a cube edge of the coarsest mesh of a crown whose silhouettes are those of the finest.

    Args:
        radius_m: (6, N, N), metres, positive, borders shared.
        settings: What is compared. No mesh is finer than the map.

    Raises:
        ValueError: As build_crown_mesh.
    """
    finest = min(settings.finest, radius_m.shape[1])
    turns = _spread_turns(settings.views)
    exact = build_crown_mesh(radius_m, np.zeros(3), finest)
    reach_m = float(np.linalg.norm(exact.points_m, axis=1).max())
    wanted = [draw_silhouette(exact, turn, reach_m, settings.side_px) for turn in turns]
    for size in settings.sizes:
        if size >= finest:
            break
        mesh = build_crown_mesh(radius_m, np.zeros(3), size)
        if all(
            silhouette_iou(draw_silhouette(mesh, turn, reach_m, settings.side_px), silhouette) >= settings.min_iou
            for turn, silhouette in zip(turns, wanted, strict=True)
        ):
            return size
    return finest


def draw_silhouette(mesh: CrownMesh, turn: NDArray[np.float64], reach_m: float, side_px: int) -> NDArray[np.bool_]:
    """What a mesh around the origin covers, (side_px, side_px), seen along -z after a turn (3, 3), without perspective.

    Args:
        reach_m: The half of what the picture shows.
    """
    seen = mesh.points_m @ turn.T
    corners = seen[mesh.face_vertices]
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    faces_us = first[:, 0] * second[:, 1] > first[:, 1] * second[:, 0]  # of a closed surface these cover all
    shift, one = 4, 1 << 4  # fractions of a pixel that OpenCV takes
    places = np.rint((seen[:, :2] / reach_m + 1) * (side_px / 2 * one)).astype(np.int32)
    picture = np.zeros((side_px, side_px), np.uint8)
    for quad in places[mesh.face_vertices[faces_us]]:
        cv2.fillConvexPoly(picture, quad, 1, shift=shift)
    return picture > 0


def _spread_turns(count: int) -> list[NDArray[np.float64]]:
    """Turns (3, 3) that bring evenly spread directions of half a sphere to +z: opposite views have one silhouette."""
    turns = []
    for number in range(count):
        height = (number + 0.5) / count
        azimuth = np.pi * (1 + np.sqrt(5)) * number
        flat = np.sqrt(1 - height**2)
        towards = np.array([flat * np.cos(azimuth), height, flat * np.sin(azimuth)])
        right = np.cross([0.0, 1.0, 0.0], towards)
        right /= np.linalg.norm(right)
        turns.append(np.stack([right, np.cross(towards, right), towards]))
    return turns
