"""Texture coordinates of the faces of a branch cage, and the branches that they are of."""

from dataclasses import dataclass

import numpy as np

from usdfoliage.branch.cage.faces import EDGE_COLUMN, EDGE_RING, NEXT_SIDE, Faces, HolePlaces
from usdfoliage.branch.cage.holes import Holes
from usdfoliage.branch.cage.rings import Rings
from usdfoliage.branch.cage.sectors import SIDES, TURN
from usdfoliage.branch.cage.tubes import Floats, Ints, Tubes


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """What belongs to each of F faces."""

    st_m: Floats  # (S, 2), metres
    face_st: Ints  # (F, 4), index of st_m at each corner
    curve: Ints  # (F,), branch


def lay_out_faces(
    tubes: Tubes, rings: Rings, holes: Holes, places: HolePlaces, faces: Faces, reference_m: Floats
) -> Layout:
    """Branches and texture coordinates of all faces.

    Args:
        tubes: All axes.
        rings: Their rings.
        holes: Where branches leave.
        places: The holes' vertices.
        faces: Over them.
        reference_m: (B,), radius by which angles become lengths, of each branch.
    """
    row_curve, row_from = _row_curves(tubes, rings)
    ring_st, row_st, below = _ring_st(rings, row_curve, row_from, reference_m)
    column = faces.column
    near, far = row_st[faces.row], below[faces.row]
    row_face_st = np.stack([near + column, near + column + 1, far + column + 1, far + column], axis=1)

    number = np.arange(len(holes.block))
    base = faces.base
    # The block's rows are one branch, so its upper ring is seen as the row below sees it.
    edge_base = np.where(EDGE_RING == 2, below[base + 1][:, None], row_st[base[:, None] + EDGE_RING])
    edge_st = edge_base + holes.sector[:, None] + EDGE_COLUMN
    on_parent = len(ring_st) + number[:, None] * SIDES + np.arange(SIDES)
    parent_curve, parent_from = row_curve[base], row_from[base]
    parent_st = np.stack(
        [reference_m[parent_curve][:, None] * places.angle_rad, places.arc_m - parent_from[:, None]], axis=-1
    )
    edge_face_st = np.stack([edge_st, edge_st[:, NEXT_SIDE], on_parent[:, NEXT_SIDE], on_parent], axis=-1)

    ring = faces.free_ring
    wrapped = np.concatenate([np.arange(SIDES), [0]])
    angles = rings.angles_rad[ring][:, wrapped] + TURN * (np.arange(SIDES + 1) == SIDES)
    rise = np.einsum("hmk,hk->hm", places.points_m - rings.center_m[ring][:, None], rings.tangent[ring])
    along = (rings.arc_m[ring] - row_from[ring])[:, None] + rise[:, wrapped]
    loft_curve = row_curve[ring]
    child_st = np.stack([reference_m[loft_curve][:, None] * angles, along], axis=-1)
    on_child = len(ring_st) + parent_st.shape[0] * SIDES + number[:, None] * (SIDES + 1) + np.arange(SIDES + 1)
    up = row_st[ring][:, None] + np.arange(SIDES + 1)
    loft_face_st = np.stack([on_child[:, :-1], on_child[:, 1:], up[:, 1:], up[:, :-1]], axis=-1)

    capped = faces.capped
    cap_start = len(ring_st) + parent_st.shape[0] * SIDES + child_st.shape[0] * (SIDES + 1)
    cap_face_st = cap_start + np.arange(len(capped))[:, None, None] * SIDES + faces.cap_quads
    flat = np.stack([np.cos(rings.angles_rad[capped]), np.sin(rings.angles_rad[capped])], axis=-1)
    cap_st = rings.radius_m[capped][:, None, None] * flat
    by_part = [row_curve[faces.row], np.repeat(parent_curve, SIDES), np.repeat(loft_curve, SIDES)]
    corners = [part.reshape(-1, 4) for part in (row_face_st, edge_face_st, loft_face_st, cap_face_st)]
    return Layout(
        st_m=np.concatenate([part.reshape(-1, 2) for part in (ring_st, parent_st, child_st, cap_st)]),
        face_st=np.concatenate(corners),
        curve=np.concatenate([*by_part, np.repeat(row_curve[capped], 2)]),
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
