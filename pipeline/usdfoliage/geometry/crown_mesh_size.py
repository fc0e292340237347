"""How few vertices the mesh of a crown needs so that its silhouettes stay what they are. Our own."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.crown_cage import FARTHEST, MIN_SIZE, build_crown_cage, crown_limit
from usdfoliage.geometry.crown_mesh import build_crown_mesh
from usdfoliage.geometry.picture_agreement import silhouette_iou


@dataclass(frozen=True, kw_only=True)
class MeshSizeSettings:
    """Which sizes are tried, and what a silhouette must keep."""

    # Vertices along a cube edge; odd, so that poles are some.
    sizes: tuple[int, ...] = (9, 13, 17, 21, 25, 29, 33, 37, 41, 49, 57)
    finest: int = 129  # what the others are compared with, and what is taken where no surface is good enough
    min_iou: float = 0.99  # of each silhouette of the surface with that of the finest mesh
    min_cage_iou: float = 0.97  # the same of the cage, which is drawn in place of the surface here and there
    views: int = 12
    side_px: int = 600  # of the picture of a silhouette


def choose_mesh_size(radius_m: NDArray[np.floating], settings: MeshSizeSettings = MeshSizeSettings()) -> int:
    """Vertices along a cube edge of the coarsest cage of a crown whose silhouettes are those of the finest surface.

    That is asked of the limit surface, and a little less of the cage, which applications draw that do not subdivide:
    Blender by default, and usdview at low complexity. Where no cage is near enough, the finest of the sizes is taken
    whose surface is; where none is, the finest, or the nearest of a map that is no finer.

    Args:
        radius_m: (6, N, N), metres, positive, borders shared.
        settings: What is compared. No cage is finer than the map.

    Raises:
        ValueError: As build_crown_mesh.
    """
    finest = max(min(settings.finest, radius_m.shape[1]), MIN_SIZE)
    turns = spread_turns(settings.views)
    exact = build_crown_mesh(radius_m, np.zeros(3), finest)
    reach_m = (1 + FARTHEST) * float(np.linalg.norm(exact.points_m, axis=1).max())  # of any cage
    wanted = [draw_silhouette(exact.points_m, exact.face_vertices, turn, reach_m, settings.side_px) for turn in turns]

    def worst_iou(points_m: NDArray[np.floating], quads: NDArray[np.int32], enough: float) -> float:
        """The lowest of all silhouettes, or the first that is below what is enough."""
        worst = 1.0
        for turn, silhouette in zip(turns, wanted, strict=True):
            drawn = draw_silhouette(points_m, quads, turn, reach_m, settings.side_px)
            worst = min(worst, silhouette_iou(drawn, silhouette))
            if worst < enough:
                break
        return worst

    cages = {size: build_crown_cage(radius_m, np.zeros(3), size) for size in settings.sizes if size < finest}
    for size, cage in cages.items():
        if worst_iou(cage.points_m, cage.face_vertices, settings.min_cage_iou) < settings.min_cage_iou:
            continue
        if worst_iou(*crown_limit(cage, 1), settings.min_iou) >= settings.min_iou:
            return size
    best, best_iou = finest, -1.0
    for size, cage in reversed(cages.items()):
        iou = worst_iou(*crown_limit(cage, 1), best_iou)
        if iou >= settings.min_iou:
            return size
        if iou > best_iou:
            best, best_iou = size, iou
    # The mesh of a coarse map has edges that the crown has not: the smooth surface that is nearest is as true.
    return best if finest == radius_m.shape[1] else finest


def draw_silhouette(
    points_m: NDArray[np.floating],
    quads: NDArray[np.int32],
    turn: NDArray[np.float64],
    reach_m: float,
    side_px: int,
) -> NDArray[np.bool_]:
    """What a closed mesh around the origin covers, (side_px, side_px), seen along -z after a turn, without perspective.

    Args:
        points_m: (V, 3).
        quads: (F, 4), counter-clockwise seen from outside.
        turn: (3, 3).
        reach_m: The half of what the picture shows.
    """
    seen = points_m @ turn.T
    corners = seen[quads]
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    faces_us = first[:, 0] * second[:, 1] > first[:, 1] * second[:, 0]  # of a closed surface these cover all
    shift, one = 4, 1 << 4  # fractions of a pixel that OpenCV takes
    places = np.rint((seen[:, :2] / reach_m + 1) * (side_px / 2 * one)).astype(np.int32)
    picture = np.zeros((side_px, side_px), np.uint8)
    for quad in places[quads[faces_us]]:
        cv2.fillConvexPoly(picture, quad, 1, shift=shift)
    return picture > 0


def spread_turns(count: int) -> list[NDArray[np.float64]]:
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
