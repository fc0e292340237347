"""A low hull around a crown: few triangles that hold all of a radius cubemap and are close to it.

The thesis draws the relief of a crown from an icosahedron around the ball of its largest radius (Argudo, section 5.1,
figure 5.2); a hull that is fitted has fewer fragments beside the crown. The fit is our own: with u = 1 / radius at each
vertex, that a triangle holds a point of the crown is linear in u, so that the hull is a linear program.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import coo_matrix

from usdfoliage.geometry.cubemap import face_directions

_COARSE = 32  # texels along an edge of the map that the program has; the result is checked with all
_BLOCK = 1 << 14  # directions at a time
_FARTHEST = 1.6  # of the largest radius, that a vertex is away
_MARGIN = 1.002  # of a radius, by which the hull is outside it


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownHull:
    """A closed mesh of triangles, seen counter-clockwise from outside."""

    points_m: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int32]  # (F, 3)
    normals: NDArray[np.float64]  # (V, 3), unit


def fit_crown_hull(radius_m: NDArray[np.floating], center_m: NDArray[np.floating], divisions: int = 1) -> CrownHull:
    """The closest hull of an icosahedron's directions that holds a crown.

    Args:
        radius_m: (6, N, N), positive, borders shared; metres.
        center_m: (3,).
        divisions: How often the triangles of the icosahedron are divided in four; 0 gives 20, 1 gives 80.
    """
    direction, faces = divided_icosahedron(divisions)
    size = radius_m.shape[1]
    texels = face_directions(size).reshape(-1, 3)
    texels = texels / np.linalg.norm(texels, axis=1, keepdims=True)
    needed_m = _MARGIN * np.asarray(radius_m, np.float64).reshape(-1)
    face, share = _in_triangles(texels, direction, faces)
    chosen = _largest(needed_m, size)
    rows = np.repeat(np.arange(len(chosen)), 3)
    columns = faces[face[chosen]].reshape(-1)
    matrix: Any = coo_matrix((share[chosen].reshape(-1), (rows, columns)), (len(chosen), len(direction))).tocsr()
    solved = linprog(
        -np.ones(len(direction)),
        A_ub=matrix,
        b_ub=1 / needed_m[chosen],
        bounds=(1 / (_FARTHEST * needed_m.max()), None),  # no vertex goes far away for the sake of its neighbours
        method="highs",
    )
    inverse = np.full(len(direction), 1 / needed_m.max()) if solved.x is None else solved.x
    # Where the program did not look, the hull is made larger by what is missing.
    sum_ = (share * inverse[faces[face]]).sum(axis=1)
    inverse = inverse / max(1.0, float((sum_ * needed_m).max()))
    return CrownHull(
        points_m=direction / inverse[:, None] + np.asarray(center_m, np.float64), faces=faces, normals=direction
    )


def divided_icosahedron(divisions: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """(V, 3) unit vectors, and (F, 3) triangles seen counter-clockwise from outside."""
    golden = (1 + np.sqrt(5)) / 2
    points = np.array(
        [(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)]
        + [(s, t * golden, 0) for s in (-1, 1) for t in (-1, 1)]
        + [(t * golden, 0, s) for s in (-1, 1) for t in (-1, 1)],
        np.float64,
    )
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    edge = np.sort(np.linalg.norm(points[:, None] - points, axis=2), axis=1)[0, 1]
    near = np.abs(np.linalg.norm(points[:, None] - points, axis=2) - edge) < 1e-6
    faces = [
        (a, b, c)
        for a in range(12)
        for b in range(a + 1, 12)
        for c in range(b + 1, 12)
        if near[a, b] and near[b, c] and near[a, c]
    ]
    triangles = np.array(
        [(a, b, c) if np.linalg.det(points[[a, b, c]]) > 0 else (a, c, b) for a, b, c in faces], np.int64
    )
    for _ in range(divisions):
        edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, number = np.unique(edges, axis=0, return_inverse=True)
        middle = points[unique].mean(axis=1)
        a, b, c = triangles.T
        ab, bc, ca = (len(points) + number.reshape(-1, 3)).T
        points = np.concatenate([points, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        triangles = np.stack([np.stack(part, axis=-1) for part in parts], axis=1).reshape(-1, 3)
    return points, triangles.astype(np.int32)


def _in_triangles(
    directions: NDArray[np.float64], corners: NDArray[np.float64], faces: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(D,) the triangle that each direction (D, 3) goes through, and (D, 3) the shares of its corners."""
    inverse = np.linalg.inv(np.swapaxes(corners[faces], 1, 2)).reshape(-1, 3)
    face, share = [], []
    for start in range(0, len(directions), _BLOCK):
        shares = (inverse @ directions[start : start + _BLOCK].T).reshape(len(faces), 3, -1)
        best = np.argmax(shares.min(axis=1), axis=0)
        face.append(best)
        share.append(np.take_along_axis(shares, best[None, None], axis=0)[0].T)
    return np.concatenate(face), np.maximum(np.concatenate(share), 0.0)


def _largest(needed_m: NDArray[np.float64], size: int) -> NDArray[np.int64]:
    """Texels of a cubemap: the largest of each square of several."""
    step = max(1, size // _COARSE)
    row, column = np.divmod(np.arange(size * size), size)
    square = (row // step) * size + column // step
    square = (np.arange(6)[:, None] * size * size + square).reshape(-1)
    order = np.lexsort([-needed_m, square])
    first = np.diff(square[order], prepend=-1) != 0
    return np.sort(order[first])
