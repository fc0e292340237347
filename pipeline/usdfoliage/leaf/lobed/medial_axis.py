"""The medial axis of an outline, without the branches that only its noise has.

Source:
    L. Mündermann et al., Modeling lobed leaves, section 3.2, by the Voronoi diagram of points of the boundary. What is
    kept by how far it protrudes is our own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import Voronoi, cKDTree

from usdfoliage.geometry.lines import are_inside, polygon_area

Floats = NDArray[np.float64]

_SINUS_PX = 4.0  # from the axis, that a base is at least for a limb of its own
_NEIGHBORS = 3  # samples of the boundary so near each other make no branch


@dataclass(frozen=True, kw_only=True)
class MedialAxisSettings:
    """Which branches are kept."""

    protrusion: float = 0.05  # beyond the disc they leave, as a part of the root of the leaf's area
    relative: float = 0.2  # and of the radius of that disc

    def __post_init__(self) -> None:
        if not (self.protrusion > 0 and self.relative >= 0):
            raise ValueError("protrusion must be above 0, and relative not below 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class MedialAxis:
    """A tree of places, each the middle of the largest disc around it that lies in the outline."""

    places: Floats  # (N, 2)
    radius: Floats  # (N,), of the disc
    neighbors: tuple[tuple[int, ...], ...]  # of each place, in the tree

    def tips(self) -> NDArray[np.int64]:
        """Places with one neighbour."""
        return np.flatnonzero([len(each) == 1 for each in self.neighbors])


def find_medial_axis(
    outline: Floats, base: Floats | None = None, settings: MedialAxisSettings = MedialAxisSettings()
) -> MedialAxis:
    """The significant part of the medial axis of an outline, always with the branch to its base.

    Args:
        outline: (K, 2), closed, densely and evenly sampled.
        base: (2,), the end of a limb that is kept however little it protrudes; None for no such limb.
        settings: What is significant.

    Raises:
        ValueError: The outline encloses no place.
    """
    places, edges = _voronoi_inside(outline)
    if not len(edges):
        raise ValueError("the outline encloses nothing")
    length = np.maximum(np.linalg.norm(places[edges[:, 0]] - places[edges[:, 1]], axis=1), 1e-12)
    tree = minimum_spanning_tree(coo_matrix((length, (edges[:, 0], edges[:, 1])), shape=(len(places),) * 2))
    radius = np.asarray(cKDTree(outline).query(places)[0], np.float64)
    root = int(np.argmax(radius))
    order, before = breadth_first_order(tree, root, directed=False)
    step = np.zeros(len(places))
    step[order[1:]] = np.linalg.norm(places[order[1:]] - places[before[order[1:]]], axis=1)
    reach = radius.copy()  # the farthest that discs beyond a place reach, along the tree
    for place in order[:0:-1].tolist():
        parent = before[place]
        reach[parent] = max(reach[parent], reach[place] + step[place])
    enough = settings.protrusion * np.sqrt(abs(polygon_area(outline)))
    kept = np.zeros(len(places), bool)
    kept[root] = True
    for place in order[1:].tolist():
        parent = before[place]
        beyond = reach[place] + step[place] - radius[parent]
        kept[place] = kept[parent] and beyond >= enough + settings.relative * radius[parent] * (enough > 0)
    nearest = root
    if base is not None:
        nearest = place = int(order[np.argmin(((places[order] - base) ** 2).sum(axis=1))])
        while place != root:
            kept[place] = True
            place = int(before[place])
    number = np.cumsum(kept) - 1
    neighbors: list[list[int]] = [[] for _ in range(int(kept.sum()))]
    for place in order[1:].tolist():
        if kept[place]:
            one, other = int(number[place]), int(number[before[place]])
            neighbors[one].append(other)
            neighbors[other].append(one)
    axis = MedialAxis(places=places[kept], radius=radius[kept], neighbors=tuple(map(tuple, neighbors)))
    return axis if base is None else _reach_base(axis, int(number[nearest]), base)


def _reach_base(axis: MedialAxis, nearest: int, base: Floats) -> MedialAxis:
    """An axis with a straight limb to the base, if that lies in a sinus, into which no medial axis goes."""
    from_axis = base - axis.places[nearest]
    gap, radius = float(np.linalg.norm(from_axis)), float(axis.radius[nearest])
    if gap < max(_SINUS_PX, radius / 2):
        return axis
    steps = max(4, int(gap))
    part = np.arange(1, steps + 1) / steps * 0.8  # the rest is left to what makes tips longer
    first = len(axis.places)
    neighbors = [*axis.neighbors, *((first + step - 1, first + step + 1) for step in range(steps))]
    neighbors[nearest] = (*axis.neighbors[nearest], first)
    neighbors[first] = (nearest, first + 1)
    neighbors[-1] = (first + steps - 2,)
    return MedialAxis(
        places=np.concatenate([axis.places, axis.places[nearest] + part[:, None] * from_axis]),
        radius=np.concatenate([axis.radius, radius * (1 - part)]),
        neighbors=tuple(neighbors),
    )


def _voronoi_inside(outline: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Vertices (N, 2) of the Voronoi diagram of an outline's points that are inside, and its edges (E, 2) there."""
    diagram = Voronoi(outline)
    ends, sites = np.array(diagram.ridge_vertices), np.asarray(diagram.ridge_points)
    apart = np.abs(sites[:, 0] - sites[:, 1])
    apart = np.minimum(apart, len(outline) - apart)
    inside = are_inside(outline, diagram.vertices)
    good = (ends >= 0).all(axis=1) & (apart >= _NEIGHBORS)
    good[good] = inside[ends[good]].all(axis=1)
    used, edges = np.unique(ends[good], return_inverse=True)
    return diagram.vertices[used], edges.reshape(-1, 2)
