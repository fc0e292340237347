"""Cross-sections of a plant: what of its cloud is equally far from the root, along the plant, and hangs together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.geometry.point_cells import cell_means

_STEM = 0.25  # of its length, that a link on a stem costs: less than the many short ones of a branch beside it


@dataclass(frozen=True, kw_only=True, eq=False)
class Paths:
    """From every point one path to a root, along the graph."""

    before: NDArray[np.int32]  # (N,), the point before it on that path, -1 for a root
    root: NDArray[np.int32]  # (N,), which of the roots it leads to


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionTree:
    """Cross-sections as nodes of a tree, or of as many as there are roots."""

    center_m: NDArray[np.float64]  # (S, 3), mean of the points
    points: NDArray[np.int32]  # (S,), how many there are
    parent: NDArray[np.int32]  # (S,), -1 for a root
    section: NDArray[np.int32]  # (N,), that each point is in

    def __len__(self) -> int:
        return len(self.parent)

    def take(self, kept: NDArray[np.bool_]) -> "SectionTree":
        """Those that are kept (S,), with parents that are kept too, and their points alone, in their order."""
        number = np.cumsum(kept, dtype=np.int32) - 1
        parent = self.parent[kept]
        return SectionTree(
            center_m=self.center_m[kept],
            points=self.points[kept],
            parent=np.where(parent < 0, -1, number[parent]).astype(np.int32),
            section=number[self.section[kept[self.section]]],
        )


def find_paths(
    lengths_m: csr_array,
    roots: NDArray[np.integer],
    of_root: NDArray[np.integer],
    power: float = 1.0,
    straight: NDArray[np.bool_] | None = None,
) -> Paths:
    """The cheapest path from every point to a root, where a link costs a power of its length.

    With 1 paths are the shortest and leap from point to point; above it they keep to where points are close together,
    and so to the branch that they are on, but wander on the surface of a thick stem.

    Args:
        lengths_m: (N, N), symmetric, of a graph in which every point is linked with a root.
        roots: (R,), points at which paths end.
        of_root: (R,), root that each of them is of, numbered from 0.
        power: 1 or more.
        straight: (N,), points of thick stems: links between them cost their length alone, and a share of that.
    """
    median_m = float(np.median(lengths_m.data))
    cost = np.power(lengths_m.data / median_m, power)
    if straight is not None:
        links = lengths_m.tocoo()
        plain = straight[links.row] & straight[links.col]
        cost[plain] = _STEM * lengths_m.data[plain] / median_m
    _, before, source = dijkstra(
        csr_array((cost, lengths_m.indices, lengths_m.indptr), shape=lengths_m.shape),
        directed=False,
        indices=roots,
        min_only=True,
        return_predecessors=True,
    )
    number = np.full(lengths_m.shape[0], -1, np.int32)
    number[roots] = of_root
    return Paths(before=np.where(before < 0, -1, before).astype(np.int32), root=number[source])


def cut_sections(
    points_m: NDArray[np.float64],
    lengths_m: csr_array,
    paths: Paths,
    thickness_m: NDArray[np.floating] | float,
) -> SectionTree:
    """Cut the plant into slices along its ways, and these where they do not hang together.

    Slices of branches that touch are one until the branches part. A section's parent is the one into which most of the
    ways of its points lead; as they are cut, that is of a slice nearer to the root.

    Args:
        points_m: (N, 3).
        lengths_m: (N, N), symmetric: what hangs together.
        paths: To the roots.
        thickness_m: Of a slice along the ways, at each point (N,) or everywhere.

    Source:
        A. Verroust and F. Lazarus, Extracting skeletal curves from 3D scattered data, 2000; H. Xu et al., Knowledge and
        heuristic-based modeling of laser-scanned trees, 2007, section 4. Slices of unequal thickness: ours.
    """
    count = len(points_m)
    thick_m = np.broadcast_to(np.asarray(thickness_m, np.float64), count)
    above = np.maximum(paths.before, 0)
    passed = step_lengths(points_m, paths.before) / (0.5 * (thick_m + thick_m[above]))
    slice_of = np.floor(RootedTree(paths.before).sum_below(passed)).astype(np.int64)
    links = lengths_m.tocoo()
    level = (slice_of[links.row] == slice_of[links.col]) & (paths.root[links.row] == paths.root[links.col])
    # All that a root's ways end at is one section, the foot of its stem.
    ends = np.flatnonzero(paths.before < 0)
    first_end = np.zeros(int(paths.root[ends].max()) + 1, np.int64)
    first_end[paths.root[ends][::-1]] = ends[::-1]
    rows = np.concatenate([links.row[level], ends])
    columns = np.concatenate([links.col[level], first_end[paths.root[ends]]])
    within = coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(count, count))
    sections, section = connected_components(within, directed=False)
    counts = np.bincount(section)
    center_m = cell_means(points_m, section)
    own, other = section, section[above]
    leaves = (paths.before >= 0) & (own != other)
    votes = coo_array((np.ones(int(leaves.sum())), (own[leaves], other[leaves])), shape=(sections, sections)).tocsr()
    parent = np.where(np.diff(votes.indptr) > 0, np.asarray(votes.argmax(axis=1)).ravel(), -1)
    parent[section[paths.before < 0]] = -1
    return SectionTree(
        center_m=center_m,
        points=counts.astype(np.int32),
        parent=parent.astype(np.int32),
        section=section.astype(np.int32),
    )
