"""A skeleton with no more vertices than its branches need, and without sharp bends.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 5.3: nodes between edges of
like direction and radius collapse, and where branches bend by more than 20 degrees the section is subdivided by a
Hermite curve. Which nodes collapse is decided by how far the branch would move: ours.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton

_REACH = 0.5  # of the shorter edge, that a bend is rounded over
_ROUNDED = 3  # vertices that take the place of one


@dataclass(frozen=True, kw_only=True)
class RefinementSettings:
    """When nodes collapse, and when bends are rounded."""

    max_moved: float = 0.05  # of the radius, by which a branch may move where a node goes
    min_moved: float = 0.04  # internodes, that it may move however thin it is
    radius_change: float = 0.05  # of the radius
    sharpest_deg: float = 20.0  # bend that stays as it is

    def __post_init__(self) -> None:
        if not (self.max_moved >= 0 and self.min_moved >= 0 and self.radius_change >= 0):
            raise ValueError(f"what a branch may move and change must not be below 0, not {self}")
        if not 0 < self.sharpest_deg <= 180:
            raise ValueError(f"sharpest_deg must be in (0, 180], not {self.sharpest_deg:g}")


def collapse_nodes(
    skeleton: Skeleton, internode_m: float, settings: RefinementSettings = RefinementSettings()
) -> Skeleton:
    """Without vertices that neither bend nor thin their branch; ends, and where others spring from, stay."""
    stays = np.zeros(len(skeleton.points_m), bool)
    stays[skeleton.parent_vertex[skeleton.parent_vertex >= 0]] = True
    kept = stays.copy()
    if not len(skeleton):
        return skeleton
    allowed_m = np.maximum(settings.max_moved * skeleton.radius_m, settings.min_moved * internode_m)
    allowed_m = np.maximum(allowed_m, 1e-12)  # where nothing may move, what lies on a line goes still
    for number in range(len(skeleton)):
        part = skeleton.branch(number)
        anchors = np.flatnonzero(stays[part])
        ends = np.unique(np.concatenate([[0], anchors, [part.stop - part.start - 1]]))
        spans = list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))
        points_m, radius_m = skeleton.points_m[part], skeleton.radius_m[part]
        kept[part.start + ends] = True
        # As D. Douglas and T. Peucker, 1973, with the radius as a further coordinate.
        while spans:
            first, last = spans.pop()
            if last - first < 2:
                continue
            inner = slice(first + 1, last)
            along_m = points_m[last] - points_m[first]
            square = float(along_m @ along_m)
            from_first = points_m[inner] - points_m[first]
            share = np.clip(from_first @ along_m / square, 0, 1) if square > 0 else np.zeros(last - first - 1)
            moved = np.linalg.norm(from_first - share[:, None] * along_m, axis=1) / allowed_m[part][inner]
            straight_m = (1 - share) * radius_m[first] + share * radius_m[last]
            thinned = np.abs(radius_m[inner] - straight_m) / (settings.radius_change * radius_m[inner] + 1e-12)
            worst = np.maximum(moved, thinned)
            at = int(np.argmax(worst))
            if worst[at] > 1:
                kept[part.start + first + 1 + at] = True
                spans += [(first, first + 1 + at), (first + 1 + at, last)]
    return skeleton.only_vertices(kept)


def split_edges(skeleton: Skeleton, longest_m: NDArray[np.float64]) -> Skeleton:
    """With vertices evenly on each edge that is longer than that of the vertex (V,) where it ends."""
    step_m = np.diff(skeleton.points_m, axis=0, prepend=skeleton.points_m[:1])
    step_m[skeleton.first] = 0
    pieces = np.maximum(1, np.ceil(np.linalg.norm(step_m, axis=1) / longest_m - 1e-9)).astype(np.int64)
    of = np.repeat(np.arange(len(pieces)), pieces)
    end = np.cumsum(pieces) - 1
    back = ((end[of] - np.arange(len(of))) / pieces[of])[:, None]  # share of the edge, from its end
    thinner_m = np.diff(skeleton.radius_m, prepend=skeleton.radius_m[:1])
    thinner_m[skeleton.first] = 0
    leaves_from = skeleton.parent_vertex
    return replace(
        skeleton,
        points_m=skeleton.points_m[of] - back * step_m[of],
        radius_m=skeleton.radius_m[of] - back[:, 0] * thinner_m[of],
        counts=np.add.reduceat(pieces, skeleton.first).astype(np.int32),
        parent_vertex=np.where(leaves_from < 0, -1, end[leaves_from]).astype(np.int32),
    )


def round_bends(skeleton: Skeleton, settings: RefinementSettings = RefinementSettings()) -> Skeleton:
    """Sharp bends as Hermite curves from the middle of one edge to that of the next, through the vertex' side of both.

    A vertex that others spring from stays where it is, and so does its bend.
    """
    if not len(skeleton):
        return skeleton
    count = len(skeleton.points_m)
    inner = np.ones(count, bool)
    inner[skeleton.first] = False
    inner[skeleton.first + skeleton.counts - 1] = False
    inner[skeleton.parent_vertex[skeleton.parent_vertex >= 0]] = False
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
