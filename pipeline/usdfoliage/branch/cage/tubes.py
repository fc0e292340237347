"""Tubes: the axes that a branch cage is swept along, as arrays over all tubes at once.

A tube is a branch together with the one that goes on from its tip, and so on: a fork at a tip is then one tube that
goes on and others that leave its side. Frames are carried along the axis without turning about it.

Source:
    Our own arrangement; the frames are those of W. Wang et al., Computation of rotation minimizing frames, 2008, which
    on a polyline are the smallest rotations from segment to segment.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.model import Skeleton

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# A branch turns by at most this to go on from its parent's tip; beyond it the tube would fold, and it leaves the side.
GOES_ON_COSINE = 0.17
SAME_POINT = 1e-6  # of the radius: shorter steps have no direction worth keeping


@dataclass(kw_only=True)
class Path:
    """The axis of one tube while it is put together."""

    points_m: Floats  # (n, 3)
    radius_m: Floats  # (n,)
    parent: int  # path that it leaves, -1 for none
    parent_arc_m: float  # where on that path
    pieces: list[tuple[int, float]] = field(default_factory=list)  # branch, arc at which its own arc is 0
    eased: bool = False  # whether it is known to have no bend that is too tight

    def leave_instead(self, short: "Path") -> None:
        """Leave the parent of a short path, which is passed through up to where this one left it."""
        arc_m = arcs_along(short.points_m)
        inside = arc_m < self.parent_arc_m - SAME_POINT * short.radius_m.min()
        prefix = short.points_m[inside]
        added_m = self.parent_arc_m if len(prefix) else 0.0
        self.points_m = np.concatenate([prefix, self.points_m])
        self.radius_m = np.concatenate([np.full(len(prefix), self.radius_m[0]), self.radius_m])
        self.pieces = [(branch, from_m + added_m) for branch, from_m in self.pieces]
        self.parent, self.parent_arc_m = short.parent, short.parent_arc_m
        self.eased = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Tubes:
    """The axes of T tubes, one after another; parents before children. Metres."""

    points_m: Floats  # (V, 3), no two neighbours equal
    radius_m: Floats  # (V,)
    arc_m: Floats  # (V,), from the start of the tube
    direction: Floats  # (V, 3), unit, of the segment that starts there; the last of a tube repeats
    reference: Floats  # (V, 3), unit, normal to direction: where angles about the axis are counted from
    first: Ints  # (T,)
    counts: Ints  # (T,), at least 2
    parent: Ints  # (T,), -1 for none
    parent_arc_m: Floats  # (T,)
    piece_tube: Ints  # (K,), branches along the tubes, in order
    piece_branch: Ints  # (K,)
    piece_from_m: Floats  # (K,), arc of the tube at which the branch's own is 0

    def __len__(self) -> int:
        return len(self.first)

    @property
    def axes(self) -> _native.TubeAxes:
        """The axes as the native functions take them."""
        return _native.TubeAxes(
            points_m=self.points_m,
            radius_m=self.radius_m,
            arc_m=self.arc_m,
            direction=self.direction,
            first=self.first,
            counts=self.counts,
        )

    @cached_property
    def length_m(self) -> Floats:
        """(T,)."""
        return self.arc_m[self.first + self.counts - 1]

    @cached_property
    def stride_m(self) -> float:
        """More than any length: tube * stride + arc puts all tubes on one line."""
        return 2.0 * float(self.length_m.max(initial=1e-300))

    @cached_property
    def key_m(self) -> Floats:
        """(V,) places of the points on that line."""
        return np.repeat(np.arange(len(self)), self.counts) * self.stride_m + self.arc_m

    @cached_property
    def turned_rad(self) -> Floats:
        """(V,) by how much the axes have turned up to each point, all tubes one after another."""
        turns = np.zeros(len(self.arc_m))
        turns[1:] = turning(self.direction[:-1], self.direction[1:])
        turns[self.first] = 0
        return np.cumsum(turns)

    def segment(self, tube: Ints, arc_m: Floats) -> Ints:
        """(N,) first point of the segment at these places."""
        at = np.searchsorted(self.key_m, tube * self.stride_m + arc_m, side="right") - 1
        return np.clip(at, self.first[tube], self.first[tube] + self.counts[tube] - 2)

    def axis(self, tube: Ints, arc_m: Floats) -> tuple[Floats, Floats]:
        """Points (N, 3) and radii (N,) of the axis, constant beyond the ends."""
        places = _native.tube_axis(self.axes, tube, arc_m, threads=0)
        return places.points_m, places.radius_m

    def tangents(self, tube: Ints, arc_m: Floats, reach_m: Floats) -> Floats:
        """(N, 3) unit chords over the axis from reach before a place to reach after it."""
        return _native.tube_tangents(self.axes, tube, arc_m, reach_m=reach_m, threads=0)

    def frames(self, tube: Ints, arc_m: Floats, tangents: Floats) -> tuple[Floats, Floats]:
        """Two unit vectors (N, 3) each, right-handed with the tangents, that do not turn about the axis."""
        frames = _native.tube_frames(self.axes, tube, arc_m, tangents=tangents, reference=self.reference, threads=0)
        return frames.first, frames.second


def rotate_between(from_unit: Floats, to_unit: Floats, vectors: Floats) -> Floats:
    """Turn vectors (N, 3) by the smallest rotation that takes one unit vector to another."""
    axis = np.cross(from_unit, to_unit)
    cosine = np.sum(from_unit * to_unit, axis=1, keepdims=True)
    # 1 / (1 + cos) has no limit for opposite vectors: any half turn will do, and the floor makes one that is bounded.
    along = np.sum(axis * vectors, axis=1, keepdims=True) / np.maximum(1 + cosine, 1e-9)
    turned = cosine * vectors + np.cross(axis, vectors) + along * axis
    opposite = cosine[:, 0] < -1 + 1e-9
    turned[opposite] = vectors[opposite]
    return turned


def turning(from_unit: Floats, to_unit: Floats) -> Floats:
    """(N,) angles between unit vectors, radians."""
    return 2 * np.arcsin(np.clip(np.linalg.norm(to_unit - from_unit, axis=1) / 2, 0, 1))


def find_paths(skeleton: Skeleton) -> tuple[list[Path], dict[int, DropReason]]:
    """The axes of the tubes of a skeleton, parents before children, and why branches have none."""
    points, radius = skeleton.points_m, skeleton.radius_m
    steps_m = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    steps_m[skeleton.first] = 0
    kept = steps_m > SAME_POINT * radius
    kept[skeleton.first] = True
    walked_m = np.cumsum(np.where(kept, steps_m, 0.0))
    arc_m = walked_m - walked_m[skeleton.first[skeleton.curve]]
    last = skeleton.first + skeleton.counts - 1
    parent, leaves = skeleton.parent_curve.copy(), skeleton.parent_vertex.copy()
    lengths = np.add.reduceat(kept, skeleton.first) > 1
    dropped = {int(branch): DropReason.NO_LENGTH for branch in np.flatnonzero(~lengths)}
    for branch in np.flatnonzero(parent >= 0).tolist():
        # Whoever leaves from a branch's first point leaves from that branch's parent.
        while parent[branch] >= 0 and parent[parent[branch]] >= 0 and arc_m[leaves[branch]] == 0:
            leaves[branch] = skeleton.parent_vertex[parent[branch]]
            parent[branch] = skeleton.parent_curve[parent[branch]]
    goes_on = _continuations(skeleton, parent, arc_m, arc_m[last], leaves, lengths, kept)

    paths: list[Path] = []
    path_of = np.full(len(skeleton), -1)
    offset_m = np.zeros(len(skeleton))
    for branch in np.flatnonzero(lengths).tolist():
        own = np.arange(skeleton.first[branch], last[branch] + 1)[kept[skeleton.branch(branch)]]
        above = int(parent[branch])
        if above >= 0 and not lengths[above]:  # a root without length cannot carry anything
            above = -1
        if above >= 0 and goes_on[above] == branch:
            path = paths[path_of[above]]
            path_of[branch] = path_of[above]
            offset_m[branch] = offset_m[above] + arc_m[last[above]]
            _append(path, points[own], radius[own])
        else:
            path_of[branch] = len(paths)
            attached = above >= 0
            arc = float(offset_m[above] + arc_m[leaves[branch]]) if attached else 0.0
            number = int(path_of[above]) if attached else -1
            path = Path(points_m=points[own], radius_m=radius[own], parent=number, parent_arc_m=arc)
            paths.append(path)
        path.pieces.append((int(branch), float(offset_m[branch])))
    return paths, dropped


def pack_paths(paths: list[Path]) -> Tubes:
    """All axes in one set of arrays."""
    counts = np.array([len(path.points_m) for path in paths], np.int64)
    first = np.cumsum(counts) - counts
    points = np.concatenate([path.points_m for path in paths]) if paths else np.zeros((0, 3))
    ends = first + counts - 1
    steps = np.diff(points, axis=0, append=points[-1:])
    steps[ends] = steps[ends - 1]
    size_m = np.linalg.norm(steps, axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(np.where(np.isin(np.arange(len(points)), ends), 0, size_m))[:-1]])
    direction = steps / size_m[:, None]
    pieces = [(number, *piece) for number, path in enumerate(paths) for piece in path.pieces]
    return Tubes(
        points_m=points,
        radius_m=np.concatenate([path.radius_m for path in paths]),
        arc_m=walked_m - np.repeat(walked_m[first], counts),
        direction=direction,
        reference=carry_references(direction, first, counts),
        first=first,
        counts=counts,
        parent=np.array([path.parent for path in paths], np.int64),
        parent_arc_m=np.array([path.parent_arc_m for path in paths]),
        piece_tube=np.array([piece[0] for piece in pieces], np.int64),
        piece_branch=np.array([piece[1] for piece in pieces], np.int64),
        piece_from_m=np.array([piece[2] for piece in pieces]),
    )


def _continuations(
    skeleton: Skeleton,
    parent: NDArray[np.int32],
    arc_m: Floats,
    length_m: Floats,
    leaves: NDArray[np.int32],
    lengths: NDArray[np.bool_],
    kept: NDArray[np.bool_],
) -> Ints:
    """(B,) the branch that goes on from each one's tip, -1 for none: the straightest and thickest."""
    goes_on = np.full(len(skeleton), -1)
    best = np.full(len(skeleton), -np.inf)
    at_tip = (parent >= 0) & lengths & lengths[parent] & (arc_m[leaves] >= length_m[parent])
    for branch in np.flatnonzero(at_tip).tolist():
        above = int(parent[branch])
        own = skeleton.points_m[skeleton.branch(branch)][kept[skeleton.branch(branch)]]
        old = skeleton.points_m[skeleton.branch(above)][kept[skeleton.branch(above)]]
        before, after = old[-1] - old[-2], own[1] - own[0]
        cosine = float(before @ after / (np.linalg.norm(before) * np.linalg.norm(after)))
        thickness = skeleton.radius_m[skeleton.first[branch]] / skeleton.radius_m[leaves[branch]]
        score = cosine + min(float(thickness), 1.0)
        if cosine > GOES_ON_COSINE and score > best[above]:
            best[above], goes_on[above] = score, branch
    return goes_on


def _append(path: Path, points: Floats, radius: Floats) -> None:
    """Go on with another branch's points; its own thickness begins a radius beyond the tip."""
    step = points[1] - points[0]
    share = min(0.5, float(path.radius_m[-1] / np.linalg.norm(step)))
    path.points_m = np.concatenate([path.points_m, points[:1] + share * step, points[1:]])
    path.radius_m = np.concatenate([path.radius_m, [radius[0] + share * (radius[1] - radius[0])], radius[1:]])


def arcs_along(points: Floats) -> Floats:
    """(N,) length of a polyline (N, 3) up to each point."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def carry_references(direction: Floats, first: Ints, counts: Ints) -> Floats:
    """(V, 3), a unit normal carried along every polyline at once, one segment a step.

    Args:
        direction: (V, 3), unit vectors of the segments that begin at the points.
        first: (T,), first point of each polyline.
        counts: (T,), points of each polyline.
    """
    reference = np.empty_like(direction)
    farthest = np.argmin(np.abs(direction[first]), axis=1)  # the coordinate axis that is farthest from the direction
    start = np.eye(3)[farthest]
    start -= np.sum(start * direction[first], axis=1, keepdims=True) * direction[first]
    reference[first] = start / np.linalg.norm(start, axis=1, keepdims=True)
    _native.carry_references(direction, first, counts, reference=reference, threads=0)
    return reference
