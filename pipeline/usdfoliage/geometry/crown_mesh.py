"""A watertight mesh of a crown, from its radius cubemap."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.cubemap import face_directions, sample_cubemap, texel_identity


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownMesh:
    """A closed surface of quads around a centre; counter-clockwise seen from outside.

    With n vertices along a cube edge there are 6 (n − 1)² + 2 vertices and 6 (n − 1)² quads.
    """

    points_m: NDArray[np.float32]  # (V, 3)
    face_vertices: NDArray[np.int32]  # (F, 4), indices of points_m
    st: NDArray[np.float32]  # (6 n², 2), on the strip of six faces, t upwards
    face_st: NDArray[np.int32]  # (F, 4), indices of st, corner by corner as face_vertices


def build_crown_mesh(radius_m: NDArray[np.floating], center_m: NDArray[np.floating], size: int) -> CrownMesh:
    """The surface center + radius · direction, on a grid of size² vertices a cube face.

    Neighbouring faces share the vertices of their border, so the surface has no seam. Texture coordinates are those of
    the map's texel centres in the N × 6N image: s = (column + ½) / N, t = 1 − (face N + row + ½) / 6N; they differ
    between faces, hence an index of their own.

    Args:
        radius_m: (6, N, N), metres, positive, borders shared (usdfoliage.geometry.cubemap).
        center_m: (3,), metres, in the frame of the result.
        size: vertices along a cube edge, 2 or more; the map is sampled where the grid is coarser than it.

    Raises:
        ValueError: A shape or the size is wrong, or a radius is not positive.
    """
    if radius_m.ndim != 3 or radius_m.shape[0] != 6 or radius_m.shape[1] != radius_m.shape[2]:
        raise ValueError(f"radius_m must be (6, N, N), not {radius_m.shape}")
    if np.shape(center_m) != (3,):
        raise ValueError(f"center_m must be (3,), not {np.shape(center_m)}")
    if not np.all(np.isfinite(radius_m)) or radius_m.min() <= 0:
        raise ValueError("every radius must be finite and positive")
    directions = face_directions(size)  # refuses a size below 2

    identity = texel_identity(size)
    # Numbered in the order in which faces first show them, so the first copy of each gives the vertex.
    _, first = np.unique(identity, return_index=True)
    vertex_directions = directions.reshape(-1, 3)[first]
    radii = sample_cubemap(radius_m, vertex_directions)
    points_m = np.asarray(center_m, np.float64) + radii[:, None] * vertex_directions

    corners = np.arange(6 * size * size, dtype=np.int32).reshape(6, size, size)
    # Right, then down, as the face is drawn from the centre: counter-clockwise from outside.
    face_st = np.stack(
        [corners[:, :-1, :-1], corners[:, :-1, 1:], corners[:, 1:, 1:], corners[:, 1:, :-1]], axis=-1
    ).reshape(-1, 4)
    face_vertices = identity.reshape(-1)[face_st].astype(np.int32)
    return CrownMesh(
        points_m=points_m.astype(np.float32),
        face_vertices=face_vertices,
        st=_strip_coordinates(size, radius_m.shape[1]).astype(np.float32),
        face_st=face_st,
    )


def _strip_coordinates(size: int, map_size: int) -> NDArray[np.float64]:
    """(6 size², 2) coordinates, in the N × 6N image of a map of map_size, of a grid of size² vertices a face."""
    texel = np.linspace(0.0, map_size - 1.0, size)
    face, row, column = np.meshgrid(np.arange(6), texel, texel, indexing="ij")
    s = (column + 0.5) / map_size
    t = 1.0 - (face * map_size + row + 0.5) / (6 * map_size)
    return np.stack([s, t], axis=-1).reshape(-1, 2)
