"""Catmull–Clark surfaces without creases, divided into quads."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage._native import refine_catmull_clark

MAX_LEVELS = 3  # that choose_levels chooses


def refine_smooth(
    points: NDArray[np.float64], faces: NDArray[np.integer], levels: int
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Points on the limit surface of a closed mesh of quads, and the quads between them.

    Args:
        points: (P, 3).
        faces: (F, 4).
        levels: How often every face is divided in four; 0: the points are the limits of the mesh's own.

    Returns:
        Points (Q, 3) and faces (F * 4 ** levels, 4); those of one face follow each other.
    """
    none = np.zeros(0, np.int32)
    refined = refine_catmull_clark(
        np.ascontiguousarray(points, np.float64),
        np.full(len(faces), 4, np.int32),
        np.ascontiguousarray(faces, np.int32).ravel(),
        crease_edges=none.reshape(0, 2),
        crease_sharpness=none.astype(np.float32),
        corner_vertices=none,
        corner_sharpness=none.astype(np.float32),
        levels=levels,
        limit=True,
    )
    return refined.points, refined.faces.reshape(-1, 4)


def choose_levels(faces: int, max_faces: int) -> int:
    """So many levels, 1 or more, that there are at most so many faces where that can be."""
    levels = 1
    while levels < MAX_LEVELS and faces * 4 ** (levels + 1) <= max_faces:
        levels += 1
    return levels
