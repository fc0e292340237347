"""Which points of a cloud are neighbours: a graph that is one piece, along which branches are followed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from usdfoliage import _native
from usdfoliage.branch.tracing.gap_links import link_across_gaps


@dataclass(frozen=True, kw_only=True)
class CloudGraphSettings:
    """Which points are linked."""

    neighbors: int = 10
    across_gaps: int = 20_000  # points that are linked across gaps, of a larger cloud; fewer than 5 for none
    threads: int = 0  # 0: one per core

    def __post_init__(self) -> None:
        if self.neighbors < 1 or self.across_gaps < 0 or self.threads < 0:
            raise ValueError(f"neighbors must be at least 1, across_gaps and threads not below 0, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CloudGraph:
    """Points linked with those near them."""

    lengths_m: csr_array  # (N, N), symmetric, nothing where there is no link
    bridged_m: csr_array  # (N, N), the same, and links across gaps: where ways may go, not what hangs together
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
    threads = settings.threads or -1
    away_m, others = (np.asarray(each) for each in tree.query(points_m, k=near + 1, workers=threads))
    rows = np.repeat(np.arange(count), near + 1)
    graph = _linked(rows, others.ravel(), away_m.ravel(), count)
    pieces, piece_of = connected_components(graph, directed=False)
    if pieces > 1:
        whole_m = np.ascontiguousarray(points_m, np.float64)
        start, end = _native.bridge_pieces(whole_m, piece_of.astype(np.int32), int(pieces)).T
        length_m = np.linalg.norm(points_m[start] - points_m[end], axis=1)
        graph = csr_array(graph.maximum(_linked(start, end, length_m, count)))
    start, end = link_across_gaps(points_m, tree, settings.across_gaps, threads).T
    across = _linked(start, end, np.linalg.norm(points_m[start] - points_m[end], axis=1), count)
    return CloudGraph(lengths_m=graph, bridged_m=csr_array(graph.maximum(across)), pieces=int(pieces))


def _linked(
    rows: NDArray[np.integer], columns: NDArray[np.integer], lengths_m: NDArray[np.float64], count: int
) -> csr_array:
    """Both ways, without links of a point to itself; no link comes twice."""
    true = rows != columns
    # What lies on each other is linked as well: a length of nothing would be no link.
    links = coo_array((np.maximum(lengths_m[true], 1e-9), (rows[true], columns[true])), shape=(count, count)).tocsr()
    return csr_array(links.maximum(links.T))
