"""Cubemaps as OpenEXR stores them: six faces, +X −X +Y −Y +Z −Z, sampled from edge to edge.

A cubemap is an array (6, N, N) or (6, N, N, C); row 0 is the top of a face. Texel (row, column) of a face looks along
``normal + right · (2 column/(N−1) − 1) + up · (1 − 2 row/(N−1))``: border texels lie on the edges of the cube and are
shared by the neighbouring faces. Faces are drawn as seen from the centre, so that towards the viewer of the +Z face x
runs to the left (mirrored against OpenGL's cubemaps). Stacked from top to bottom the faces are OpenEXR's ENVMAP_CUBE.

Source: OpenEXR, ImfEnvmap.h and ImfEnvmap.cpp.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

FACES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")

# (normal, right, up) of each face, in the order of FACES.
FACE_AXES: NDArray[np.float64] = np.array(
    [
        [(1, 0, 0), (0, 0, 1), (0, 1, 0)],
        [(-1, 0, 0), (0, 0, -1), (0, 1, 0)],
        [(0, 1, 0), (1, 0, 0), (0, 0, 1)],
        [(0, -1, 0), (1, 0, 0), (0, 0, -1)],
        [(0, 0, 1), (-1, 0, 0), (0, 1, 0)],
        [(0, 0, -1), (1, 0, 0), (0, 1, 0)],
    ],
    dtype=np.float64,
)
FACE_AXES.setflags(write=False)


def face_directions(size: int) -> NDArray[np.float64]:
    """Unit directions of all texels, (6, size, size, 3).

    Raises:
        ValueError: size is below 2; a face needs two borders.
    """
    if size < 2:
        raise ValueError(f"a cube face needs at least 2 texels a side, not {size}")
    across = np.linspace(-1.0, 1.0, size)
    normal, right, up = (FACE_AXES[:, k, None, None, :] for k in range(3))
    directions = normal + across[None, None, :, None] * right - across[None, :, None, None] * up
    return np.asarray(directions / np.linalg.norm(directions, axis=-1, keepdims=True))


def face_coordinates(
    directions: NDArray[np.floating], size: int
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Face, row and column (in texels, fractional) that directions look at.

    Args:
        directions: (..., 3), any length but zero. Ties between axes go to X, then Y, as in OpenEXR.
        size: texels a side.

    Returns:
        face, row, column, each of shape (...).
    """
    d = np.asarray(directions, dtype=np.float64)
    x, y, z = np.moveaxis(np.abs(d), -1, 0)
    axis = np.where((x >= y) & (x >= z), 0, np.where(y >= z, 1, 2))
    major = np.take_along_axis(d, axis[..., None], axis=-1)[..., 0]
    face = 2 * axis + (major < 0)
    right = np.einsum("...k,...k->...", d, FACE_AXES[face, 1]) / np.abs(major)
    up = np.einsum("...k,...k->...", d, FACE_AXES[face, 2]) / np.abs(major)
    half = (size - 1) / 2
    return face, (1 - up) * half, (1 + right) * half


def sample_cubemap(cubemap: NDArray[np.floating], directions: NDArray[np.floating]) -> NDArray[np.float64]:
    """Bilinear look-up of a cubemap (6, N, N[, C]) along directions (..., 3); the result is (...[, C])."""
    size = cubemap.shape[1]
    face, row, column = face_coordinates(directions, size)
    top = np.clip(np.floor(row), 0, size - 2).astype(np.intp)
    left = np.clip(np.floor(column), 0, size - 2).astype(np.intp)
    extra = (1,) * (cubemap.ndim - 3)
    down = np.clip(row - top, 0, 1).reshape(*row.shape, *extra)
    along = np.clip(column - left, 0, 1).reshape(*row.shape, *extra)
    upper = cubemap[face, top, left] * (1 - along) + cubemap[face, top, left + 1] * along
    lower = cubemap[face, top + 1, left] * (1 - along) + cubemap[face, top + 1, left + 1] * along
    return np.asarray(upper * (1 - down) + lower * down, dtype=np.float64)


@lru_cache(maxsize=4)
def texel_identity(size: int) -> NDArray[np.int64]:
    """Number every distinct texel: (6, size, size) integers, equal where border texels are one direction.

    There are 6 (size − 1)² + 2 of them, numbered in the order in which the faces first show them.
    """
    texel = np.arange(6 * size * size).reshape(6, size, size)
    border = np.ones((6, size, size), bool)
    border[:, 1:-1, 1:-1] = False
    # Points of the cube's surface are multiples of 2/(size−1): exact as integers.
    directions = face_directions(size)[border]
    on_cube = directions / np.abs(directions).max(axis=-1, keepdims=True)
    lattice = np.rint((on_cube + 1) * (size - 1) / 2).astype(np.int64)
    key = (lattice[:, 0] * size + lattice[:, 1]) * size + lattice[:, 2]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    first_texel = texel.copy()  # the first texel that looks this way
    first_texel[border] = texel[border][first][inverse.ravel()]
    is_first = first_texel == texel
    rank = np.cumsum(is_first.ravel()) - 1
    identity = rank[first_texel]
    identity.setflags(write=False)  # one array serves every caller
    return identity


def share_borders(cubemap: NDArray[np.floating]) -> NDArray[np.floating]:
    """The same cubemap with each shared border texel set to the mean of its two or three copies."""
    size = cubemap.shape[1]
    identity = texel_identity(size).ravel()
    values = cubemap.reshape(6 * size * size, -1).astype(np.float64)
    count = np.bincount(identity)
    mean = np.stack([np.bincount(identity, values[:, c]) / count for c in range(values.shape[1])], axis=-1)
    shared = count[identity] > 1
    out = cubemap.reshape(6 * size * size, -1).copy()
    out[shared] = mean[identity[shared]].astype(cubemap.dtype)
    return out.reshape(cubemap.shape)
