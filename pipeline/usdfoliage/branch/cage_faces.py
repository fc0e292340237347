"""Faces of a branch cage: rows along the tubes, holes where branches leave, caps; and their texture coordinates."""

from dataclasses import dataclass

import numpy as np

from usdfoliage.branch.cage_places import Holes
from usdfoliage.branch.cage_rings import Rings
from usdfoliage.branch.cage_sectors import SIDES, TURN
from usdfoliage.branch.cage_tubes import Floats, Ints, Tubes

# A hole's six vertices, counter-clockwise seen from outside with the parent's tip up, in halves of its size.
HOLE_ACROSS = np.array([-0.5, 0.5, 1.0, 0.5, -0.5, -1.0])
HOLE_ALONG_AXIS = np.array([-1.0, -1.0, 0.0, 1.0, 1.0, 0.0])
# The edge of its block in the same order: ring of the three, and column of the sector's two.
EDGE_RING = np.array([0, 0, 1, 2, 2, 1])
EDGE_COLUMN = np.array([0, 1, 1, 1, 0, 0])
TIP_QUADS = np.array([[0, 1, 2, 3], [0, 3, 4, 5]])
ROOT_QUADS = np.array([[3, 2, 1, 0], [5, 4, 3, 0]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces:
    """Faces over the rings' vertices (ring * 6 + column), then the holes' (hole * 6 + vertex)."""

    faces: Ints  # (F, 4), counter-clockwise from outside
    st_m: Floats  # (S, 2)
    face_st: Ints  # (F, 4)
    curve: Ints  # (F,), branch
    row_face: Ints  # (N, 6), face between a ring and the next at each column, -1 for none
    edge_face: Ints  # (H, 6), between a block's edge and its hole
    loft_face: Ints  # (H, 6), between a hole and the first ring of its branch


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


def build_faces(
    tubes: Tubes, rings: Rings, holes: Holes, places: HolePlaces, child: Ints, reference_m: Floats
) -> Faces:
    """All faces.

    Args:
        tubes: All axes.
        rings: Their rings.
        holes: Where branches leave.
        places: The holes' vertices.
        child: (H,), tube of each hole.
        reference_m: (B,), radius by which angles become lengths, of each branch.
    """
    count = len(rings.tube)
    first_ring = np.full(len(tubes), -1)
    first_ring[rings.tube[rings.first]] = rings.first
    row_curve, row_from = _row_curves(tubes, rings)
    ring_st, row_st, below = _ring_st(rings, row_curve, row_from, reference_m)

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
    row_faces, row_face_st = _row_quads(row, column, row_st, below)
    row_face = np.full((count, SIDES), -1)
    row_face[row, column] = np.arange(len(row))

    # From the edge of each block to its hole.
    number = np.arange(len(holes.block))
    following = (np.arange(SIDES) + 1) % SIDES
    edge_ring = base[:, None] + EDGE_RING
    edge_column = holes.sector[:, None] + EDGE_COLUMN
    edge = edge_ring * SIDES + edge_column % SIDES
    hole = count * SIDES + number[:, None] * SIDES + np.arange(SIDES)
    edge_faces = np.stack([edge, edge[:, following], hole[:, following], hole], axis=-1)
    # The block's rows are one branch, so its upper ring is seen as the row below sees it.
    edge_base = np.where(EDGE_RING == 2, below[base + 1][:, None], row_st[edge_ring])
    edge_st = edge_base + edge_column
    on_parent = len(ring_st) + number[:, None] * SIDES + np.arange(SIDES)
    parent_curve, parent_from = row_curve[base], row_from[base]
    parent_st = np.stack(
        [reference_m[parent_curve][:, None] * places.angle_rad, places.arc_m - parent_from[:, None]], axis=-1
    )
    edge_face_st = np.stack([edge_st, edge_st[:, following], on_parent[:, following], on_parent], axis=-1)

    # From each hole to the first ring of its branch.
    ring = first_ring[child]
    free = ring[:, None] * SIDES + np.arange(SIDES)
    loft_faces = np.stack([hole, hole[:, following], free[:, following], free], axis=-1)
    wrapped = np.concatenate([np.arange(SIDES), [0]])
    angles = rings.angles_rad[ring][:, wrapped] + TURN * (np.arange(SIDES + 1) == SIDES)
    rise = np.einsum("hmk,hk->hm", places.points_m - rings.center_m[ring][:, None], rings.tangent[ring])
    along = (rings.arc_m[ring] - row_from[ring])[:, None] + rise[:, wrapped]
    loft_curve = row_curve[ring]
    child_st = np.stack([reference_m[loft_curve][:, None] * angles, along], axis=-1)
    on_child = len(ring_st) + parent_st.shape[0] * SIDES + number[:, None] * (SIDES + 1) + np.arange(SIDES + 1)
    up = row_st[ring][:, None] + np.arange(SIDES + 1)
    loft_face_st = np.stack([on_child[:, :-1], on_child[:, 1:], up[:, 1:], up[:, :-1]], axis=-1)

    roots = rings.first[tubes.parent[rings.tube[rings.first]] < 0]
    cap_start = len(ring_st) + parent_st.shape[0] * SIDES + child_st.shape[0] * (SIDES + 1)
    capped = np.concatenate([roots, rings.last])
    cap_quads = np.concatenate([np.tile(ROOT_QUADS, (len(roots), 1, 1)), np.tile(TIP_QUADS, (len(rings.last), 1, 1))])
    cap_faces = capped[:, None, None] * SIDES + cap_quads
    cap_face_st = cap_start + np.arange(len(capped))[:, None, None] * SIDES + cap_quads
    flat = np.stack([np.cos(rings.angles_rad[capped]), np.sin(rings.angles_rad[capped])], axis=-1)
    cap_st = rings.radius_m[capped][:, None, None] * flat

    def quads(*parts: Ints) -> Ints:
        return np.concatenate([part.reshape(-1, 4) for part in parts])

    edge_start, loft_start = len(row_faces), len(row_faces) + edge_faces[..., 0].size
    return Faces(
        faces=quads(row_faces, edge_faces, loft_faces, cap_faces),
        st_m=np.concatenate([part.reshape(-1, 2) for part in (ring_st, parent_st, child_st, cap_st)]),
        face_st=quads(row_face_st, edge_face_st, loft_face_st, cap_face_st),
        curve=np.concatenate(
            [
                row_curve[row],
                np.repeat(parent_curve, SIDES),
                np.repeat(loft_curve, SIDES),
                np.repeat(row_curve[capped], 2),
            ]
        ),
        row_face=row_face,
        edge_face=edge_start + np.arange(edge_faces[..., 0].size).reshape(-1, SIDES),
        loft_face=loft_start + np.arange(loft_faces[..., 0].size).reshape(-1, SIDES),
    )


def _row_curves(tubes: Tubes, rings: Rings) -> tuple[Ints, Floats]:
    """Branch of the row above each ring (N,), and the tube's arc at which that branch starts."""
    count = len(rings.tube)
    middle = rings.arc_m.copy()
    inner = np.flatnonzero(np.diff(rings.tube) == 0)
    middle[inner] = (rings.arc_m[inner] + rings.arc_m[inner + 1]) / 2
    # Both rows of a block are one branch, or its holes would lie on two.
    pair = inner[(rings.block[inner] >= 0) & (rings.block[inner] == rings.block[inner + 1])]
    first = pair[(pair == 0) | (rings.block[pair - 1] != rings.block[pair])]
    middle[first] = middle[first + 1] = rings.arc_m[first + 1]
    # A last ring belongs to the row below it.
    last = np.diff(rings.tube, append=-1) != 0
    alone = np.diff(rings.tube, prepend=-1) != 0
    below = np.flatnonzero(last & ~alone)
    middle[below] = middle[below - 1]
    at = np.searchsorted(
        tubes.piece_tube * tubes.stride_m + tubes.piece_from_m, rings.tube * tubes.stride_m + middle, side="right"
    )
    start = np.searchsorted(tubes.piece_tube, rings.tube, side="left")
    piece = np.maximum(at - 1, start)  # a tube may start before its first branch's own arc does
    assert len(piece) == count
    return tubes.piece_branch[piece], tubes.piece_from_m[piece]


def _ring_st(rings: Rings, row_curve: Ints, row_from: Floats, reference_m: Floats) -> tuple[Floats, Ints, Ints]:
    """Texture coordinates of the rings, seven columns each; twice where the branch changes.

    Returns:
        Coordinates (S, 2), and (N,) the first for the row above a ring, and for the far ring of that row.
    """
    wrapped = np.concatenate([np.arange(SIDES), [0]])
    angles = rings.angles_rad[:, wrapped] + TURN * (np.arange(SIDES + 1) == SIDES)

    def coordinates(ring: Ints, curve: Ints, from_m: Floats) -> Floats:
        s = reference_m[curve][:, None] * angles[ring]
        return np.stack([s, np.broadcast_to((rings.arc_m[ring] - from_m)[:, None], s.shape)], axis=-1).reshape(-1, 2)

    count = len(rings.tube)
    own = np.arange(count) * (SIDES + 1)
    far = np.concatenate([own[1:], own[-1:]])
    changes = np.flatnonzero((np.diff(rings.tube) == 0) & (np.diff(row_curve) != 0))
    far[changes] = (count + np.arange(len(changes))) * (SIDES + 1)
    both = [coordinates(np.arange(count), row_curve, row_from)]
    both.append(coordinates(changes + 1, row_curve[changes], row_from[changes]))
    return np.concatenate(both), own, far


def _row_quads(row: Ints, column: Ints, row_st: Ints, below: Ints) -> tuple[Ints, Ints]:
    following = (column + 1) % SIDES
    low, high = row * SIDES, (row + 1) * SIDES
    faces = np.stack([low + column, low + following, high + following, high + column], axis=1)
    near, far = row_st[row], below[row]
    return faces, np.stack([near + column, near + column + 1, far + column + 1, far + column], axis=1)
