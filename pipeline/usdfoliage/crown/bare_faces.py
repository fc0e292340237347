"""Which faces of a plant's branches stand out of its crown, so that they are seen where only the crown is drawn."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from usdfoliage.geometry.cubemap import sample_cubemap

SUNK = 0.15  # of the crown's radius: how deep what stands out goes on into it, where it ends unseen


def find_bare_faces(
    points_m: NDArray[np.floating],
    face_counts: NDArray[np.integer],
    face_vertices: NDArray[np.integer],
    radius_m: NDArray[np.floating],
    center_m: NDArray[np.floating],
    sunk: float = SUNK,
) -> NDArray[np.bool_]:
    """The faces that stand out of the crown, and those through which they reach into it.

    Args:
        points_m: (P, 3), in the crown's frame.
        face_counts: (F,), vertices of each face, at least 1 each.
        face_vertices: (sum of face_counts,), indices of points_m.
        radius_m: (6, N, N), the crown's distance from its centre (usdfoliage.crown.model.CrownModel).
        center_m: (3,), its centre.
        sunk: In [0, 1), depth below the crown's surface, as a share of its radius there, at which they end.

    Returns:
        (F,), True for a face that is seen.

    Raises:
        ValueError: sunk is out of its range.
    """
    if not 0 <= sunk < 1:
        raise ValueError(f"sunk must be in [0, 1), not {sunk}")
    if not len(face_counts):
        return np.zeros(0, bool)
    offset_m = np.asarray(points_m, np.float64) - center_m
    away_m = np.linalg.norm(offset_m, axis=1)
    toward = np.where(away_m[:, None] > 0, offset_m, (0.0, 1.0, 0.0))
    surface_m = sample_cubemap(radius_m, toward)
    first = np.concatenate([[0], np.cumsum(face_counts)[:-1]])
    outside = np.logical_or.reduceat((away_m > surface_m)[face_vertices], first)
    shallow = np.logical_or.reduceat((away_m > (1 - sunk) * surface_m)[face_vertices], first)
    # A branch that runs below the surface and nowhere through it stays out of sight.
    face = np.repeat(np.arange(len(face_counts)), face_counts)
    linked = shallow[face]
    shape = (len(face_counts), len(points_m))
    touches = coo_array((np.ones(int(linked.sum()), np.int8), (face[linked], face_vertices[linked])), shape=shape)
    parts = connected_components(_as_graph(touches), directed=False)[1][: len(face_counts)]
    return np.asarray(shallow & np.isin(parts, parts[outside]))


def _as_graph(touches: coo_array) -> coo_array:
    """Faces and the vertices that they touch as nodes of one graph, faces first."""
    faces, vertices = touches.shape
    row, column = touches.coords
    return coo_array((touches.data, (row, column + faces)), shape=(faces + vertices, faces + vertices))
