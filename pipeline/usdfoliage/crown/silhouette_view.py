"""A crown as a camera sees it: its silhouette, and how far its surface is."""

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.crown_mesh import build_crown_mesh
from usdfoliage.geometry.pinhole import Pinhole

_MESH = 49  # vertices along a cube's edge: a silhouette of some hundred pixels shows no more
_BITS = 4
_FINER = 3


def draw_silhouette(
    radius_m: NDArray[np.floating], center_m: NDArray[np.floating], camera: Pinhole
) -> NDArray[np.bool_]:
    """(H, W), where a camera outside the crown sees it.

    Args:
        radius_m: (6, N, N), the crown's radius cubemap.
        center_m: (3,), in the camera's world.
        camera: Any; nothing is drawn of what is behind it.
    """
    mesh = build_crown_mesh(radius_m, center_m, min(_MESH, radius_m.shape[1]))
    place, depth_m = camera.project(mesh.points_m.astype(np.float64))
    quads = mesh.face_vertices[(depth_m > 0)[mesh.face_vertices].all(axis=1)]
    # OpenCV fills every pixel that an edge touches: drawn finer, that is less.
    fixed = np.rint((_FINER * np.clip(place, -1e4, 1e4)[quads] - 0.5) * (1 << _BITS)).astype(np.int32)
    drawn = np.zeros((_FINER * camera.height_px, _FINER * camera.width_px), np.uint8)
    for quad in fixed:
        cv2.fillConvexPoly(drawn, quad, 255, shift=_BITS)
    return np.asarray(cv2.resize(drawn, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA) > 127)


def nearest_depth(places_px: NDArray[np.float64], depth_m: NDArray[np.float64], camera: Pinhole) -> NDArray[np.float64]:
    """(H, W) smallest depth of the points seen in each pixel; infinite where there are none.

    Args:
        places_px: (N, 2), as camera.project gives them.
        depth_m: (N,).
        camera: Whose pixels are coarse enough that none of a surface is missed.
    """
    nearest = np.full(camera.height_px * camera.width_px, np.inf)
    inside = (depth_m > 0) & (places_px >= 0).all(axis=1)
    inside &= (places_px[:, 0] < camera.width_px) & (places_px[:, 1] < camera.height_px)
    column, row = places_px[inside].astype(np.intp).T
    np.minimum.at(nearest, row * camera.width_px + column, depth_m[inside])
    return nearest.reshape(camera.height_px, camera.width_px)
