"""Places on the axes of branches, and where axes come out of what they spring from."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.branch.distances import place_on_axes
from usdfoliage.branch.model import Skeleton

_STEP = 0.2  # of the parent's radius, between places where a branch may be out
_ONE_RADIUS = 1.3  # times the smallest radius, up to which those of axes count as one
_FEW_STEPS = 8
_STEPS = 40  # a branch along its parent for longer than so many is taken to be out


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """P places on axes."""

    curve: NDArray[np.int32]  # (P,)
    vertex: NDArray[np.int64]  # (P,), index into the skeleton's points, of the segment's first
    share: NDArray[np.float64]  # (P,), of the segment, 0 to 1
    arc_m: NDArray[np.float64]  # (P,), along the branch from its first point

    def __len__(self) -> int:
        return len(self.curve)

    def between(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """What points of the skeleton (V, ...) have, at the places (P, ...)."""
        share = self.share.reshape(-1, *([1] * (values.ndim - 1)))
        start = values[self.vertex]
        return np.asarray(start + share * (values[self.vertex + 1] - start))


def beyond_surface(
    skeleton: Skeleton, points_m: NDArray[np.float64], curve: NDArray[np.integer], radius_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(P,) how far each point is outside a branch of its own, in metres; below 0 inside.

    Args:
        skeleton: Whose axes.
        points_m: (P, 3).
        curve: (P,), the branch of each.
        radius_m: (V,), of the branches at their points.
    """
    return _native.beyond_lines(
        *axis_lines(skeleton),
        places=np.ascontiguousarray(points_m, np.float64),
        line=np.ascontiguousarray(curve, np.int32),
        radius=np.ascontiguousarray(radius_m, np.float64),
        threads=0,
    )


def axis_lines(skeleton: Skeleton) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]:
    """Axes as the native functions take polylines: points (V, 3), first point and number of points of each (B,)."""
    return (
        np.ascontiguousarray(skeleton.points_m, np.float64),
        np.ascontiguousarray(skeleton.first, np.int32),
        np.ascontiguousarray(skeleton.counts, np.int32),
    )


def find_places(skeleton: Skeleton, points_m: NDArray[np.float64], curve: NDArray[np.integer]) -> Places:
    """The place of its branch that is nearest to each point.

    Args:
        skeleton: Whose axes.
        points_m: (P, 3).
        curve: (P,), the branch of each.
    """
    of = np.ascontiguousarray(curve, np.int32)
    vertex, share = _native.nearest_on_lines(
        *axis_lines(skeleton), places=np.ascontiguousarray(points_m, np.float64), line=of, threads=0
    )
    arc_m = skeleton.arcs_m
    return Places(
        curve=of,
        vertex=vertex,
        share=share,
        arc_m=(1 - share) * arc_m[vertex] + share * arc_m[vertex + 1],
    )


def nearest_places(
    skeleton: Skeleton, points_m: NDArray[np.float64], curves: NDArray[np.integer], apart_m: float
) -> Places:
    """The place whose bark is nearest to each point.

    Args:
        skeleton: Whose axes.
        points_m: (P, 3).
        curves: Branches that may be chosen, one at least.
        apart_m: How finely axes are looked at, in metres.
    """
    places = place_on_axes(skeleton, apart_m)
    mine = np.isin(skeleton.curve[places.vertex], curves)
    axis_m, radius_m, vertex = places.points_m[mine], places.radius_m[mine], places.vertex[mine]
    # Among axes of one radius the nearest axis is that of the nearest bark.
    radius_class = np.floor(np.log(radius_m) / np.log(_ONE_RADIUS))
    nearest, from_bark_m = np.zeros(len(points_m), np.int64), np.full(len(points_m), np.inf)
    for number in np.unique(radius_class):
        some = np.flatnonzero(radius_class == number)
        away_m, found = (np.asarray(each) for each in scipy.spatial.cKDTree(axis_m[some]).query(points_m, workers=-1))
        away_m = away_m - radius_m[some[found]]
        nearer = away_m < from_bark_m
        nearest[nearer], from_bark_m[nearer] = some[found[nearer]], away_m[nearer]
    return find_places(skeleton, points_m, skeleton.curve[vertex[nearest]])


def places_at(skeleton: Skeleton, curve: NDArray[np.integer], arc_m: NDArray[np.float64]) -> Places:
    """Places (P,) at lengths along branches (P,); beyond an end, the end."""
    arcs = skeleton.arcs_m
    arc_m = np.clip(arc_m, 0, skeleton.lengths_m[curve])
    stride = 2 * max(float(arcs.max(initial=0)), 1e-300)  # lays all branches on one line
    key = skeleton.curve * stride + arcs
    vertex = np.searchsorted(key, np.asarray(curve, np.int64) * stride + arc_m, side="right") - 1
    first = skeleton.first[curve].astype(np.int64)
    vertex = np.clip(vertex, first, first + skeleton.counts[curve] - 2)
    step_m = arcs[vertex + 1] - arcs[vertex]
    share = np.divide(arc_m - arcs[vertex], step_m, out=np.zeros_like(arc_m), where=step_m > 0)
    return Places(curve=np.asarray(curve, np.int32), vertex=vertex, share=np.clip(share, 0, 1), arc_m=arc_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class Exits:
    """Where B branches come out of the surface of the one that they spring from."""

    curve: NDArray[np.int32]  # (B,), that one, a branch below each; -1 for a root
    parent_arc_m: NDArray[np.float64]  # (B,), along that one
    arc_m: NDArray[np.float64]  # (B,), along each itself; 0 for a root


def axis_exits(skeleton: Skeleton, only: NDArray[np.bool_] | None = None) -> Exits:
    """Where axes come out of the round surfaces of their parents.

    One that does not come out, or runs inside for long, is taken to be out at once where that ends.

    Args:
        skeleton: B branches.
        only: (B,), those that are looked at; the others are out at their first points.
    """
    arc_m, parent_arc_m = np.zeros(len(skeleton)), np.zeros(len(skeleton))
    child = np.flatnonzero((skeleton.parent_curve >= 0) & (True if only is None else only))
    for steps in (_FEW_STEPS, _STEPS):  # nearly all are out after a few
        if not len(child):
            break
        arc_m[child], parent_arc_m[child], found = _walk_out(skeleton, child, steps)
        child = child[~found]
    return Exits(curve=skeleton.parent_curve, parent_arc_m=parent_arc_m, arc_m=arc_m)


def _walk_out(
    skeleton: Skeleton, child: NDArray[np.int64], steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Arcs of branches (C,) and of their parents where they come out, and whether they do within so many steps."""
    parent_m = skeleton.radius_m[skeleton.parent_vertex[child]]
    walked_m = np.minimum(_STEP * parent_m[:, None] * np.arange(steps + 1), skeleton.lengths_m[child][:, None])
    on_child = places_at(skeleton, np.repeat(child, steps + 1), walked_m.reshape(-1))
    points_m = on_child.between(skeleton.points_m)
    on_parent = find_places(skeleton, points_m, np.repeat(skeleton.parent_curve[child], steps + 1))
    away_m = np.linalg.norm(points_m - on_parent.between(skeleton.points_m), axis=1)
    beyond_m = (away_m - on_parent.between(skeleton.radius_m)).reshape(len(child), -1)
    outside = beyond_m > 0
    found = outside[:, 1:].any(axis=1)
    outside[:, -1] = True
    at = np.maximum(outside.argmax(axis=1), 1)
    row = np.arange(len(child))
    before_m, after_m = beyond_m[row, at - 1], beyond_m[row, at]
    crosses = (before_m <= 0) & (after_m > 0)
    share = np.where(crosses, before_m / np.where(crosses, before_m - after_m, 1), 1)
    arcs = (
        samples_m[row, at - 1] + share * (samples_m[row, at] - samples_m[row, at - 1])
        for samples_m in (walked_m, on_parent.arc_m.reshape(len(child), -1))
    )
    return *arcs, found
