"""Which pairs of quads cross each other, as two triangles each."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage_tubes import Floats, Ints

BATCH = 400_000  # pairs at once, so that temporaries stay small


def crossing_quads(points: Floats, faces: Ints, pairs: Ints) -> NDArray[np.bool_]:
    """Which pairs (N, 2) of faces (F, 4) cross; those that share a vertex do not count.

    Quads are split along their first diagonal. Triangles that only touch, or lie in one plane, do not cross.
    """
    crossing = np.zeros(len(pairs), bool)
    for start in range(0, len(pairs), BATCH):
        block = pairs[start : start + BATCH]
        one, two = faces[block[:, 0]], faces[block[:, 1]]
        shared = np.zeros(len(block), bool)
        for corner in range(4):
            for other in range(4):
                shared |= one[:, corner] == two[:, other]
        left = np.flatnonzero(~shared)
        for a_face, b_face in ((one, two), (two, one)):
            near = ~_on_one_side(points[a_face[left]], points[b_face[left]])
            left = left[near]
        a, b = points[one[left]], points[two[left]]
        hit = np.zeros(len(left), bool)
        for first in ((0, 1, 2), (0, 2, 3)):
            for second in ((0, 1, 2), (0, 2, 3)):
                hit |= _triangles_cross(a[:, first], b[:, second])
        crossing[start + left[hit]] = True
    return crossing


def boxes(points: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """Lowest and highest coordinates (F, 3) each of faces (F, 4)."""
    low = high = points[faces[:, 0]]
    for corner in range(1, 4):
        there = points[faces[:, corner]]
        low, high = np.minimum(low, there), np.maximum(high, there)
    return low, high


def _on_one_side(a: Floats, b: Floats) -> NDArray[np.bool_]:
    """Whether quads b lie on one side of both triangles of quads a."""
    result = np.ones(len(a), bool)
    for corners in ((0, 1, 2), (0, 2, 3)):
        origin = a[:, corners[0]]
        normal = np.cross(a[:, corners[1]] - origin, a[:, corners[2]] - origin)
        above = below = np.ones(len(a), bool)
        for corner in range(4):
            height = np.einsum("nc,nc->n", b[:, corner] - origin, normal)
            above, below = above & (height > 0), below & (height < 0)
        result &= above | below
    return result


def _triangles_cross(a: Floats, b: Floats) -> NDArray[np.bool_]:
    """Whether an edge of one triangle (N, 3, 3) goes through the other."""
    result = np.zeros(len(a), bool)
    for one, two in ((a, b), (b, a)):
        for k in range(3):
            result |= _edge_through(one[:, k], one[:, (k + 1) % 3], two)
    return result


def _edge_through(start: Floats, end: Floats, triangle: Floats) -> NDArray[np.bool_]:
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    before = np.sum((start - triangle[:, 0]) * normal, axis=1)
    after = np.sum((end - triangle[:, 0]) * normal, axis=1)
    sides = before * after < 0
    along = end - start
    # Signs of the volumes that the edge makes with the triangle's edges.
    inside = outside = sides
    for k in range(3):
        spanned = np.cross(triangle[:, k] - start, triangle[:, (k + 1) % 3] - start)
        volume = np.einsum("nc,nc->n", spanned, along)
        inside, outside = inside & (volume > 0), outside & (volume < 0)
    return inside | outside
