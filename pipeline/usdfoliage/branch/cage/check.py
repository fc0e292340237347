"""Whether a cage is what a subdivision surface needs: closed, oriented, manifold, not crossing itself at forks."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.branch.cage.tubes import Floats, Ints


@dataclass(frozen=True, kw_only=True)
class CageCheck:
    """What is wrong with a cage: all counts but components are 0 where nothing is."""

    open_edges: int  # that do not have two faces in opposite directions
    split_vertices: int  # whose faces are not one fan
    unused_vertices: int
    degenerate_faces: int  # that name a vertex twice, or have no area
    inverted_components: int  # whose volume is not above 0
    components: int
    fork_crossings: int  # pairs of faces near one fork that cross and share no vertex

    @property
    def clean(self) -> bool:
        """Whether nothing is wrong."""
        return not (
            self.open_edges
            or self.split_vertices
            or self.unused_vertices
            or self.degenerate_faces
            or self.inverted_components
            or self.fork_crossings
        )


def check_mesh(
    points: Floats, faces: NDArray[np.integer], fork_faces: NDArray[np.integer], fork_counts: NDArray[np.integer]
) -> CageCheck:
    """Check a mesh of quads.

    Args:
        points: (P, 3).
        faces: (F, 4).
        fork_faces: (K,) faces near each fork, one fork after another.
        fork_counts: (J,) how many of them each fork has.
    """
    quads = faces.astype(np.int64)
    count = len(points)
    start, end = quads.reshape(-1), np.roll(quads, -1, axis=1).reshape(-1)
    forward, backward = np.sort(start * count + end), np.sort(end * count + start)
    alone = ~np.isin(forward, backward)
    twice = np.zeros(len(forward), bool)
    twice[1:] = np.diff(forward) == 0
    repeated = (np.diff(np.sort(quads, axis=1), axis=1) == 0).any(axis=1)
    diagonals = np.cross(points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]])
    flat = ~(np.linalg.norm(diagonals, axis=1) > 0)
    links = scipy.sparse.csr_array((np.ones(len(start)), (start, end)), shape=(count, count))
    used = np.bincount(start, minlength=count) > 0
    components, of = scipy.sparse.csgraph.connected_components(links, directed=False)
    volume = np.bincount(of[quads[:, 0]], weights=_volumes(points, quads), minlength=components)
    real = np.bincount(of[used], minlength=components) > 0
    return CageCheck(
        open_edges=int((alone | twice).sum()),
        split_vertices=_split_vertices(quads, count),
        unused_vertices=int((~used).sum()),
        degenerate_faces=int((repeated | flat).sum()),
        inverted_components=int((volume[real] <= 0).sum()),
        components=int(real.sum()),
        fork_crossings=len(find_fork_crossings(points, quads, fork_faces, fork_counts)),
    )


def find_fork_crossings(
    points: Floats, faces: NDArray[np.integer], fork_faces: NDArray[np.integer], fork_counts: NDArray[np.integer]
) -> Ints:
    """(N, 2) places in fork_faces whose faces cross, each pair of faces once; the lower place first.

    Quads are two triangles along their first diagonal. Those that share a vertex do not count, nor do triangles that
    only touch, or lie in one plane.

    Args:
        points: (P, 3).
        faces: (F, 4).
        fork_faces: (K,) faces near each fork, one fork after another.
        fork_counts: (J,) how many of them each fork has.
    """
    first = np.concatenate([[0], np.cumsum(fork_counts, dtype=np.int64)])
    return _native.find_fork_crossings(
        np.ascontiguousarray(points, np.float64),
        np.ascontiguousarray(faces, np.int64),
        fork_faces=np.ascontiguousarray(fork_faces, np.int64),
        fork_first=first,
        threads=0,
    )


def _volumes(points: Floats, quads: Ints) -> Floats:
    """(F,) share of each face, as two triangles, in the volume."""
    a, b, c, d = (points[quads[:, k]] for k in range(4))
    return (np.sum(np.cross(a, b) * c, axis=1) + np.sum(np.cross(a, c) * d, axis=1)) / 6


def _split_vertices(quads: Ints, count: int) -> int:
    """Vertices whose corners are not all linked through edges: as many as there are fans beyond the first."""
    corner = np.arange(quads.size).reshape(-1, 4)
    start, end = quads, np.roll(quads, -1, axis=1)
    # Corners of one vertex in two faces are linked by the edge that leaves the one and comes back in the other.
    leaving = np.argsort((start * count + end).reshape(-1), kind="stable")
    key = (start * count + end).reshape(-1)[leaving]
    back = (end * count + start).reshape(-1)
    at = np.clip(np.searchsorted(key, back), 0, len(key) - 1)
    partner = leaving[at]
    matched = key[at] == back
    face, slot = np.divmod(partner, 4)
    mine, other = corner.reshape(-1)[matched], (face * 4 + (slot + 1) % 4)[matched]
    links = scipy.sparse.csr_array((np.ones(len(mine)), (mine, other)), shape=(quads.size, quads.size))
    fans, _ = scipy.sparse.csgraph.connected_components(links, directed=False)
    return int(fans - len(np.unique(quads)))
