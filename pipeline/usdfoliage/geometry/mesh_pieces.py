"""The pieces that a closed mesh is in, and how far they stand off each other."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from usdfoliage import _native


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshPieces:
    """Faces that share corners are one piece. Metres."""

    of_point: NDArray[np.int32]  # (P,), piece of each point, from 0 on; a point without a face is one of its own
    rooted: NDArray[np.bool_]  # (K,), whether a root is in it
    gap_m: NDArray[np.float64]  # (K,), to the others; 0 where it runs into one, or is rooted

    def afloat(self, nearest_m: float) -> NDArray[np.int64]:
        """Pieces without a root that stand off all others by more than nearest_m."""
        return np.flatnonzero(~self.rooted & (self.gap_m > nearest_m))


def find_pieces(
    points_m: NDArray[np.float64], faces: NDArray[np.integer], roots_m: NDArray[np.float64], near_enough_m: float = 0.0
) -> MeshPieces:
    """Find the pieces of a mesh, and how far those without a root are from all others.

    Args:
        points_m: (P, 3), all finite.
        faces: (F, 3) or (F, 4), counter-clockwise from outside.
        roots_m: (R, 3), places of roots; each is in the piece whose point is nearest.
        near_enough_m: A distance below it is not measured exactly.
    """
    of_point, count = label_pieces(len(points_m), faces)
    used = np.zeros(len(points_m), bool)
    used[faces] = True
    rooted = np.zeros(count, bool)
    rooted[of_point[~used]] = True  # no surface, so nothing that could be afloat
    back = np.flatnonzero(used)
    if len(back) and len(roots_m):
        rooted[of_point[back[np.asarray(scipy.spatial.cKDTree(points_m[back]).query(roots_m)[1])]]] = True
    gap_m = np.zeros(count)
    asked = np.flatnonzero(~rooted)
    gap_m[asked] = measure_gaps(points_m, faces, of_point, asked, near_enough_m)
    return MeshPieces(of_point=of_point, rooted=rooted, gap_m=gap_m)


def label_pieces(points: int, faces: NDArray[np.integer]) -> tuple[NDArray[np.int32], int]:
    """(P,) the piece of each of so many points, from 0 on, and how many pieces there are."""
    ends = _edges(faces)
    links = scipy.sparse.coo_array((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape=(points, points))
    count, of_point = scipy.sparse.csgraph.connected_components(links, directed=False)
    return of_point.astype(np.int32), int(count)


def measure_gaps(
    points_m: NDArray[np.float64],
    faces: NDArray[np.integer],
    of_point: NDArray[np.int32],
    asked: NDArray[np.integer],
    near_enough_m: float = 0.0,
    *,
    through: bool = True,
) -> NDArray[np.float64]:
    """(Q,) how far pieces are from all others.

    Args:
        points_m: (P, 3), all finite.
        faces: (F, 3) or (F, 4).
        of_point: (P,), as label_pieces has them; those of one face are one.
        asked: (Q,), ascending.
        near_enough_m: A distance below it is not measured exactly.
        through: Whether it is 0 where an edge goes through a face of another piece.
    """
    if not len(asked):
        return np.zeros(0)
    wanted = np.zeros(int(of_point.max()) + 1, bool)
    wanted[asked] = True
    corners = np.asarray(faces, np.int32)
    ends = _edges(corners[wanted[of_point[corners[:, 0]]]])
    edges = ends[ends[:, 0] < ends[:, 1]]  # the other face of an edge has it the other way round
    edges = edges[np.argsort(of_point[edges[:, 0]], kind="stable")]
    first = np.searchsorted(of_point[edges[:, 0]], np.append(asked, len(wanted))).astype(np.int64)
    triangles = [corners[:, [0, 1, 2]]] + ([corners[:, [0, 2, 3]]] if corners.shape[1] == 4 else [])
    return _native.piece_gaps(
        np.ascontiguousarray(points_m, np.float64),
        np.ascontiguousarray(np.concatenate(triangles)),
        of_point,
        asked_edges=np.ascontiguousarray(edges, np.int32),
        asked_first=first,
        asked_pieces=np.asarray(asked, np.int32),
        near_enough=near_enough_m,
        through=through,
        threads=0,
    )


def _edges(faces: NDArray[np.integer]) -> NDArray[np.integer]:
    """(E, 2), round every face."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
