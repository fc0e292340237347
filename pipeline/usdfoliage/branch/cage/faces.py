"""Faces of a branch cage: rows along the tubes, the faces of each fork (its hole and the first rows), caps."""

from dataclasses import dataclass

import numpy as np

from usdfoliage.branch.cage.holes import Holes
from usdfoliage.branch.cage.rings import Rings
from usdfoliage.branch.cage.sectors import SIDES
from usdfoliage.branch.cage.tubes import Floats, Ints, Tubes

# A hole's six vertices, counter-clockwise seen from outside with the parent's tip up, in halves of its size.
HOLE_ACROSS = np.array([-0.5, 0.5, 1.0, 0.5, -0.5, -1.0])
HOLE_ALONG_AXIS = np.array([-1.0, -1.0, 0.0, 1.0, 1.0, 0.0])
# The edge of its block in the same order: ring of the three, and column of the sector's two.
EDGE_RING = np.array([0, 0, 1, 2, 2, 1])
EDGE_COLUMN = np.array([0, 1, 1, 1, 0, 0])
TIP_QUADS = np.array([[0, 1, 2, 3], [0, 3, 4, 5]])
ROOT_QUADS = np.array([[3, 2, 1, 0], [5, 4, 3, 0]])
NEXT_SIDE = (np.arange(SIDES) + 1) % SIDES


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces:
    """Faces over the rings' vertices (ring * 6 + column), then the holes' (hole * 6 + vertex)."""

    faces: Ints  # (F, 4), counter-clockwise from outside
    row_face: Ints  # (N, 6), face between a ring and the next at each column, -1 for none
    edge_face: Ints  # (H, 6), between a block's edge and its hole
    loft_face: Ints  # (H, 6), between a hole and the first ring of its branch
    row: Ints  # (R,), ring of each face of the rows, which come first
    column: Ints  # (R,)
    base: Ints  # (H,), first ring of each hole's block
    free_ring: Ints  # (H,), first ring of its branch
    capped: Ints  # (E,), rings that are closed
    cap_quads: Ints  # (E, 2, 4), columns


@dataclass(frozen=True, kw_only=True, eq=False)
class HolePlaces:
    """The holes' vertices on the parents' tubes."""

    points_m: Floats  # (H, 6, 3)
    arc_m: Floats  # (H, 6), on the parent
    angle_rad: Floats  # (H, 6), on the turn of the block's columns


def place_hole_vertices(tubes: Tubes, holes: Holes) -> HolePlaces:
    """The six vertices of each hole, on the round parent."""
    tube = np.repeat(holes.block_tube[holes.block], SIDES)
    arc = (holes.arc_m[:, None] + HOLE_ALONG_AXIS * holes.half_along_m[:, None]).reshape(-1)
    center, radius = tubes.axis(tube, arc)
    across = (HOLE_ACROSS * holes.half_across_m[:, None]).reshape(-1)
    angle = np.repeat(holes.azimuth_rad, SIDES) + np.arcsin(np.clip(across / radius, -0.97, 0.97))
    tangent = tubes.tangents(tube, arc, radius)
    first, second = tubes.frames(tube, arc, tangent)
    out = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    points = center + 1.08 * radius[:, None] * out
    shape = (len(holes.arc_m), SIDES)
    return HolePlaces(points_m=points.reshape(*shape, 3), arc_m=arc.reshape(shape), angle_rad=angle.reshape(shape))


def build_faces(tubes: Tubes, rings: Rings, holes: Holes, child: Ints) -> Faces:
    """All faces.

    Args:
        tubes: All axes.
        rings: Their rings.
        holes: Where branches leave.
        child: (H,), tube of each hole.
    """
    count = len(rings.tube)
    first_ring = np.full(len(tubes), -1)
    first_ring[rings.tube[rings.first]] = rings.first

    # Rows along the tubes, without what the holes take away.
    has_row = np.zeros(count, bool)
    has_row[:-1] = np.diff(rings.tube) == 0
    solid = np.repeat(has_row[:, None], SIDES, axis=1)
    block_ring = np.full(len(holes.block_tube), -1)
    in_block = np.flatnonzero(rings.block >= 0)
    block_ring[rings.block[in_block[::-1]]] = in_block[::-1]  # the first of the three
    base = block_ring[holes.block]
    solid[base, holes.sector] = False
    solid[base + 1, holes.sector] = False
    row, column = np.nonzero(solid)
    low, following = row * SIDES, NEXT_SIDE[column]
    row_faces = np.stack([low + column, low + following, low + SIDES + following, low + SIDES + column], axis=1)
    row_face = np.full((count, SIDES), -1)
    row_face[row, column] = np.arange(len(row))

    # From the edge of each block to its hole.
    number = np.arange(len(holes.block))
    edge = (base[:, None] + EDGE_RING) * SIDES + (holes.sector[:, None] + EDGE_COLUMN) % SIDES
    hole = count * SIDES + number[:, None] * SIDES + np.arange(SIDES)
    edge_faces = np.stack([edge, edge[:, NEXT_SIDE], hole[:, NEXT_SIDE], hole], axis=-1)

    # From each hole to the first ring of its branch.
    free_ring = first_ring[child]
    free = free_ring[:, None] * SIDES + np.arange(SIDES)
    loft_faces = np.stack([hole, hole[:, NEXT_SIDE], free[:, NEXT_SIDE], free], axis=-1)

    roots = rings.first[tubes.parent[rings.tube[rings.first]] < 0]
    capped = np.concatenate([roots, rings.last])
    cap_quads = np.concatenate([np.tile(ROOT_QUADS, (len(roots), 1, 1)), np.tile(TIP_QUADS, (len(rings.last), 1, 1))])
    cap_faces = capped[:, None, None] * SIDES + cap_quads

    edge_start, loft_start = len(row_faces), len(row_faces) + edge_faces[..., 0].size
    return Faces(
        faces=_quads(row_faces, edge_faces, loft_faces, cap_faces),
        row_face=row_face,
        edge_face=edge_start + np.arange(edge_faces[..., 0].size).reshape(-1, SIDES),
        loft_face=loft_start + np.arange(loft_faces[..., 0].size).reshape(-1, SIDES),
        row=row,
        column=column,
        base=base,
        free_ring=free_ring,
        capped=capped,
        cap_quads=cap_quads,
    )


def _quads(*parts: Ints) -> Ints:
    return np.concatenate([part.reshape(-1, 4) for part in parts])
