"""Fair branches, with no more vertices than they need, and without sharp bends.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 5.3: nodes between edges of
like direction and radius collapse, and where branches bend by more than 20 degrees the section is subdivided by a
Hermite curve; here by more than 10, so that no bend is seen close up. Before that branches become smoothing splines;
which nodes collapse is decided by how far the branch would move, and by how much it turns: ours.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.fairing import fair_branches

_REACH = 0.5  # of the shorter edge, that a bend is rounded over
_STRAIGHT = 1e-6  # radians
_ROUNDED = 3  # vertices that take the place of one


@dataclass(frozen=True, kw_only=True)
class RefinementSettings:
    """When nodes collapse, and when bends are rounded."""

    stiffness: float = 0.4  # of branches, for them to be fair: weight of a second difference of vertices
    max_shifted: float = 0.5  # of the radius, that a vertex is moved for its branch to be fair
    pieces: int = 8  # of an edge, that a fair branch is drawn with before its nodes collapse
    shortest: float = 0.04  # internodes, that such a piece is long at least,
    shortest_radii: float = 0.1  # and of its radius
    max_turn_deg: float = 5.0  # that a branch turns along an edge
    longest: float = 8.0  # internodes, that an edge is about long at most, however straight: where wind bends a branch,
    longest_radii: float = 8.0  # and where a hand takes hold of it; or this of its radius, if that is more
    max_moved: float = 0.05  # of the radius, by which a branch may move where a node goes
    min_moved: float = 0.04  # internodes, that it may move however thin it is
    radius_change: float = 0.05  # of the radius
    sharpest_deg: float = 10.0  # bend that stays as it is

    def __post_init__(self) -> None:
        if not (self.max_moved >= 0 and self.min_moved >= 0 and self.radius_change >= 0):
            raise ValueError(f"what a branch may move and change must not be below 0, not {self}")
        if not (self.stiffness >= 0 and self.max_shifted > 0 and self.pieces >= 1):
            raise ValueError(f"stiffness must not be below 0, max_shifted above 0, pieces at least 1, not {self}")
        if not (self.longest > 0 and self.longest_radii >= 0):
            raise ValueError(f"longest must be above 0, longest_radii not below, not {self}")
        if not self.max_turn_deg > 0:
            raise ValueError(f"max_turn_deg must be above 0, not {self.max_turn_deg:g}")
        if not 0 < self.sharpest_deg <= 180:
            raise ValueError(f"sharpest_deg must be in (0, 180], not {self.sharpest_deg:g}")


def refine_branches(
    skeleton: Skeleton,
    internode_m: float,
    noise_m: float = 0.0,
    settings: RefinementSettings = RefinementSettings(),
    stays: NDArray[np.bool_] | None = None,
) -> Skeleton:
    """Fair branches with no more vertices than they need.

    Args:
        skeleton: As it was traced or grown.
        internode_m: Of the plant.
        noise_m: How far the points that it was traced through are off the bark; vertices may be moved by as much.
        settings: How.
        stays: (V,), vertices that are not moved, and stay where their branch bends; none without it.
    """
    fair, found = _draw_fair(skeleton, internode_m, noise_m, settings, stays)
    fixed = np.zeros(len(fair.points_m), bool)
    if stays is not None:
        fixed[found] = stays
    kept = _nodes_needed(fair, internode_m, settings, fixed)
    return round_bends(fair.only_vertices(kept) if len(fair) else fair, settings, fixed[kept])


def draw_fair(
    skeleton: Skeleton,
    internode_m: float,
    noise_m: float,
    settings: RefinementSettings = RefinementSettings(),
    stays: NDArray[np.bool_] | None = None,
) -> Skeleton:
    """Branches as smooth curves near their vertices, with several vertices in place of each edge."""
    return _draw_fair(skeleton, internode_m, noise_m, settings, stays)[0]


def _draw_fair(
    skeleton: Skeleton,
    internode_m: float,
    noise_m: float,
    settings: RefinementSettings,
    stays: NDArray[np.bool_] | None,
) -> tuple[Skeleton, NDArray[np.int64]]:
    """The smooth curves, and (V,) the vertices in them that were there before."""
    if not len(skeleton) or settings.stiffness == 0:
        return skeleton, np.arange(len(skeleton.points_m))
    shortest_m = np.maximum(settings.shortest * internode_m, settings.shortest_radii * skeleton.radius_m)
    piece_m = np.linalg.norm(skeleton.edges_m, axis=1) / settings.pieces
    fine, found = split_edges(skeleton, np.maximum(piece_m, shortest_m))
    weight = np.zeros(len(fine.points_m))
    weight[found] = 1
    if stays is not None:
        pieces = np.diff(found, prepend=-1)
        weight[np.repeat(stays, pieces)] = np.inf
    max_moved_m = np.maximum(settings.max_shifted * fine.radius_m, noise_m)
    # The third power of lengths makes the stiffness that of second differences of the vertices that were found, if
    # these were evenly along their branch.
    edge_m = (skeleton.lengths_m / (skeleton.counts - 1))[fine.curve]
    step_m = np.linalg.norm(fine.edges_m, axis=1)
    step_m = np.maximum(0.5 * (step_m + np.roll(step_m, -1)), 0.5 * np.minimum(shortest_m.min(), edge_m))
    stiffness = settings.stiffness * np.maximum(edge_m / np.maximum(step_m, 1e-12), 1) ** 3
    return fair_branches(fine, weight, stiffness, max_moved_m), found


def collapse_nodes(
    skeleton: Skeleton, internode_m: float, settings: RefinementSettings = RefinementSettings()
) -> Skeleton:
    """Without vertices that neither bend nor thin their branch; ends, and where others spring from, stay."""
    fixed = np.zeros(len(skeleton.points_m), bool)
    return skeleton.only_vertices(_nodes_needed(skeleton, internode_m, settings, fixed)) if len(skeleton) else skeleton


def _nodes_needed(
    skeleton: Skeleton, internode_m: float, settings: RefinementSettings, fixed: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(V,) vertices without which branches would be others; those that are fixed (V,) are where they bend."""
    count = len(skeleton.points_m)
    if not count:
        return fixed
    allowed_m = np.maximum(settings.max_moved * skeleton.radius_m, settings.min_moved * internode_m)
    allowed_m = np.maximum(allowed_m, 1e-12)  # where nothing may move, what lies on a line goes still
    kept = np.zeros(count, bool)
    kept[skeleton.parent_vertex[skeleton.parent_vertex >= 0]] = True
    kept[skeleton.first] = kept[skeleton.first + skeleton.counts - 1] = True
    # An edge stands for a piece of the curve that turns little.
    turns = turns_rad(skeleton)
    kept |= fixed & (turns > _STRAIGHT)
    kept |= _begins_piece(skeleton, turns / np.radians(settings.max_turn_deg))
    longest_m = np.maximum(settings.longest * internode_m, settings.longest_radii * skeleton.radius_m)
    kept |= _begins_piece(skeleton, np.linalg.norm(skeleton.edges_m, axis=1) / longest_m)
    # As D. Douglas and T. Peucker, 1973, with the radius as a further coordinate, of all edges at once.
    while True:
        anchors = np.flatnonzero(kept)
        span = np.cumsum(kept) - 1
        span[anchors[-1]] -= count > 1
        inner = np.flatnonzero(~kept)
        if not len(inner):
            break
        span = span[inner]
        first, last = anchors[span], anchors[span + 1]
        along_m, from_first_m = skeleton.points_m[last] - skeleton.points_m[first], skeleton.points_m[inner]
        from_first_m = from_first_m - skeleton.points_m[first]
        square = np.einsum("nc,nc->n", along_m, along_m)
        share = np.clip(np.einsum("nc,nc->n", from_first_m, along_m) / np.where(square > 0, square, 1), 0, 1)
        moved = np.linalg.norm(from_first_m - share[:, None] * along_m, axis=1) / allowed_m[inner]
        straight_m = (1 - share) * skeleton.radius_m[first] + share * skeleton.radius_m[last]
        radius_m = skeleton.radius_m[inner]
        worst = np.maximum(moved, np.abs(radius_m - straight_m) / (settings.radius_change * radius_m + 1e-12))
        begins = np.flatnonzero(np.diff(span, prepend=-1))
        largest = np.repeat(np.maximum.reduceat(worst, begins), np.diff(begins, append=len(span)))
        found = inner[(worst == largest) & (worst > 1)]
        if not len(found):
            break
        kept[found] = True
    return kept


def _begins_piece(skeleton: Skeleton, shares: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(V,) vertices at which a further whole one is reached of the shares (V,) that are summed along each branch."""
    summed = np.cumsum(shares)
    piece = np.floor(summed - summed[skeleton.first][skeleton.curve])
    begins = np.zeros(len(piece), bool)
    begins[1:] = (piece[1:] > piece[:-1]) & (skeleton.curve[1:] == skeleton.curve[:-1])
    return begins


def turns_rad(skeleton: Skeleton) -> NDArray[np.float64]:
    """(V,) angle between the edge that ends at a vertex and the one that begins there, 0 at the ends of a branch.

    Of vertices at one place the last one has the turn.
    """
    after_m = np.roll(skeleton.edges_m, -1, axis=0)
    has_edge = np.asarray(skeleton.edges_m.any(axis=1))
    ends = np.where(has_edge, np.arange(len(has_edge)), skeleton.first[skeleton.curve])
    before_m = skeleton.edges_m[np.maximum.accumulate(ends)]
    across = np.linalg.norm(np.cross(before_m, after_m), axis=1)
    return np.asarray(np.arctan2(across, np.einsum("vc,vc->v", before_m, after_m)))


def split_edges(skeleton: Skeleton, longest_m: NDArray[np.float64]) -> tuple[Skeleton, NDArray[np.int64]]:
    """With vertices evenly on each edge that is longer than that of the vertex (V,) where it ends.

    Returns:
        The branches, and (V,) the vertices in them that were there before.
    """
    step_m = skeleton.edges_m
    pieces = np.maximum(1, np.ceil(np.linalg.norm(step_m, axis=1) / longest_m - 1e-9)).astype(np.int64)
    of = np.repeat(np.arange(len(pieces)), pieces)
    end = np.cumsum(pieces) - 1
    back = ((end[of] - np.arange(len(of))) / pieces[of])[:, None]  # share of the edge, from its end
    thinner_m = np.diff(skeleton.radius_m, prepend=skeleton.radius_m[:1])
    thinner_m[skeleton.first] = 0
    leaves_from = skeleton.parent_vertex
    split = replace(
        skeleton,
        points_m=skeleton.points_m[of] - back * step_m[of],
        radius_m=skeleton.radius_m[of] - back[:, 0] * thinner_m[of],
        counts=np.add.reduceat(pieces, skeleton.first).astype(np.int32),
        parent_vertex=np.where(leaves_from < 0, -1, end[leaves_from]).astype(np.int32),
    )
    return split, end


def round_bends(
    skeleton: Skeleton,
    settings: RefinementSettings = RefinementSettings(),
    stays: NDArray[np.bool_] | None = None,
) -> Skeleton:
    """Sharp bends as Hermite curves from the middle of one edge to that of the next, through the vertex' side of both.

    A vertex that others spring from, or that stays (V,), is where it was, and so is its bend.
    """
    if not len(skeleton):
        return skeleton
    count = len(skeleton.points_m)
    inner = np.ones(count, bool)
    inner[skeleton.first] = False
    inner[skeleton.first + skeleton.counts - 1] = False
    inner[skeleton.parent_vertex[skeleton.parent_vertex >= 0]] = False
    if stays is not None:
        inner &= ~stays
    at = np.flatnonzero(inner)
    before_m, after_m = (
        skeleton.points_m[at] - skeleton.points_m[at - 1],
        skeleton.points_m[at + 1] - skeleton.points_m[at],
    )
    lengths_m = np.linalg.norm(before_m, axis=1), np.linalg.norm(after_m, axis=1)
    usable = (lengths_m[0] > 0) & (lengths_m[1] > 0)
    cosine = np.einsum("nc,nc->n", before_m, after_m) / np.where(usable, lengths_m[0] * lengths_m[1], 1)
    sharp = usable & (cosine < np.cos(np.radians(settings.sharpest_deg)))
    at, before_m, after_m = at[sharp], before_m[sharp], after_m[sharp]
    reach_m = _REACH * np.minimum(lengths_m[0], lengths_m[1])[sharp, None]
    into = before_m / lengths_m[0][sharp, None]
    out = after_m / lengths_m[1][sharp, None]
    start_m, end_m = skeleton.points_m[at] - reach_m * into, skeleton.points_m[at] + reach_m * out
    pull_m = 2 * reach_m  # tangents as long as the path round the corner
    repeats = np.ones(count, np.int64)
    repeats[at] = _ROUNDED
    points_m, radius_m = np.repeat(skeleton.points_m, repeats, axis=0), np.repeat(skeleton.radius_m, repeats)
    new_first = np.concatenate([[0], np.cumsum(repeats)])[:-1]
    for step in range(_ROUNDED):
        t = step / (_ROUNDED - 1)
        on_curve = (
            (2 * t**3 - 3 * t**2 + 1) * start_m
            + (t**3 - 2 * t**2 + t) * pull_m * into
            + (3 * t**2 - 2 * t**3) * end_m
            + (t**3 - t**2) * pull_m * out
        )
        points_m[new_first[at] + step] = on_curve
    leaves_from = skeleton.parent_vertex
    rounded = replace(
        skeleton,
        points_m=points_m,
        radius_m=radius_m,
        counts=np.add.reduceat(repeats, skeleton.first).astype(np.int32),
        parent_vertex=np.where(leaves_from < 0, -1, new_first[leaves_from]).astype(np.int32),
    )
    # Of bends next to each other one ends where the next begins.
    kept = np.ones(len(points_m), bool)
    begins = new_first[at]
    gap_m = np.linalg.norm(points_m[begins] - points_m[begins - 1], axis=1)
    kept[begins] = gap_m > 1e-6 * reach_m[:, 0]
    return rounded.only_vertices(kept)
