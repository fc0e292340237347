"""Which points of a cloud are neighbours: a graph that is one piece, along which branches are followed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

_LOOKS = (16, 64, 256)  # neighbours among which a piece looks for a point of another one; then among all


@dataclass(frozen=True, kw_only=True)
class CloudGraphSettings:
    """Which points are linked."""

    neighbors: int = 10
    threads: int = 0  # 0: one per core

    def __post_init__(self) -> None:
        if self.neighbors < 1:
            raise ValueError(f"neighbors must be at least 1, not {self.neighbors}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CloudGraph:
    """Points linked with those near them."""

    lengths_m: csr_array  # (N, N), symmetric, nothing where there is no link
    pieces: int  # that there were before gaps were bridged


def link_points(points_m: NDArray[np.float64], settings: CloudGraphSettings = CloudGraphSettings()) -> CloudGraph:
    """Link every point with its nearest ones, and what is then in pieces by the shortest bridges between them.

    Args:
        points_m: (N, 3).
        settings: How many neighbours.

    Raises:
        ValueError: Fewer than two points.
    """
    count = len(points_m)
    if count < 2:
        raise ValueError(f"a graph takes two points, not {count}")
    tree = cKDTree(points_m)
    near = min(settings.neighbors, count - 1)
    away_m, others = (np.asarray(each) for each in tree.query(points_m, k=near + 1, workers=settings.threads or -1))
    rows = np.repeat(np.arange(count), near + 1)
    graph = _linked(rows, others.ravel(), away_m.ravel(), count)
    first_pieces = 0
    while True:
        pieces, piece_of = connected_components(graph, directed=False)
        first_pieces = first_pieces or pieces
        if pieces == 1:
            return CloudGraph(lengths_m=graph, pieces=first_pieces)
        start, end, length_m = _bridges(points_m, tree, piece_of, pieces, settings.threads)
        graph = csr_array(graph.maximum(_linked(start, end, length_m, count)))


def _linked(
    rows: NDArray[np.integer], columns: NDArray[np.integer], lengths_m: NDArray[np.float64], count: int
) -> csr_array:
    """Both ways, without links of a point to itself; no link comes twice."""
    true = rows != columns
    # What lies on each other is linked as well: a length of nothing would be no link.
    held = coo_array((np.maximum(lengths_m[true], 1e-9), (rows[true], columns[true])), shape=(count, count)).tocsr()
    return csr_array(held.maximum(held.T))


def _bridges(
    points_m: NDArray[np.float64], tree: cKDTree, piece_of: NDArray[np.integer], pieces: int, threads: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """From each piece but the largest a short link to another one, as Boruvka joins trees: start, end, length.

    It is the shortest but for pieces that see another one among a few neighbours and a nearer one only among many.
    """
    looking = np.flatnonzero(piece_of != np.argmax(np.bincount(piece_of)))
    found: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []
    nearest_m = np.full(pieces, np.inf)
    for near in _LOOKS:
        found_there = tree.query(points_m[looking], k=min(near, len(points_m)), workers=threads or -1)
        away_m, others = (np.asarray(each) for each in found_there)
        foreign = piece_of[others] != piece_of[looking][:, None]
        first = np.argmax(foreign, axis=1)
        rows = np.flatnonzero(foreign[np.arange(len(looking)), first])
        start, end, length_m = looking[rows], others[rows, first[rows]], away_m[rows, first[rows]]
        found.append((start, end, length_m))
        np.minimum.at(nearest_m, piece_of[start], length_m)
        # A point that saw its own piece alone may have a nearer one only within what it has not looked at yet.
        blind = np.ones(len(looking), bool)
        blind[rows] = False
        bound_m = np.where(np.isinf(nearest_m) | (near < _LOOKS[1]), nearest_m, 0)  # the widest look is slow
        looking = looking[blind & (away_m[:, -1] < bound_m[piece_of[looking]])]
        if not len(looking):
            break
    for piece in np.unique(piece_of[looking]):
        if np.isfinite(nearest_m[piece]):
            continue  # the best that the nearest few hundred know: large pieces that all but touch
        own, outside = np.flatnonzero(piece_of == piece), np.flatnonzero(piece_of != piece)
        found_there = cKDTree(points_m[outside]).query(points_m[own], workers=threads or -1)
        away_m, other = (np.asarray(each) for each in found_there)
        best = int(np.argmin(away_m))
        found.append((own[best : best + 1], outside[other[best : best + 1]], away_m[best : best + 1]))
    start, end, length_m = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.lexsort((end, start, length_m, piece_of[start]))
    ordered = piece_of[start[order]]
    chosen = order[np.concatenate([[True], ordered[1:] != ordered[:-1]])]
    return start[chosen], end[chosen], length_m[chosen]
