"""Branches that cannot be joined to their parent without crossing it, as plants of their own that begin beside it.

A limb that is left out would take all that it carries with it. It begins where it is clear of what it springs from.
The method is our own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.distances import sample_axes
from usdfoliage.branch.model import Skeleton

_STEP = 0.25  # of the radius of what is walked along
_GAP = 0.1  # of a branch's radius, between it and what it springs from
_MIN_LENGTH = 3.0  # radii, that a piece must be long
_NEAREST = 8  # places on the axes below that are looked at
_AT_FIRST = 64  # places along a branch that are looked at before all the others


@dataclass(frozen=True, kw_only=True, eq=False)
class LoosePieces:
    """Branches as plants of their own."""

    skeleton: Skeleton
    curve: NDArray[np.int32]  # (B,), the branch that each one is in the skeleton that they are from


def cut_loose(skeleton: Skeleton, lost: NDArray[np.bool_], joined: NDArray[np.bool_]) -> LoosePieces | None:
    """What can be saved of branches that are lost; None where nothing can.

    Args:
        skeleton: All branches.
        lost: (B,), that could not be joined to what they spring from, with all that they carry.
        joined: (B,), that are in the surface.
    """
    parts: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    curve: list[int] = []
    parent_curve: list[int] = []
    parent_vertex: list[int] = []
    number = np.full(len(skeleton), -1)  # of a branch among the pieces
    begin = np.zeros(len(skeleton), np.int64)  # first of its own vertices that is left, and where that is put
    place = np.zeros(len(skeleton), np.int64)
    total = 0
    for branch in np.flatnonzero(lost).tolist():  # parents first
        part = skeleton.branch(branch)
        points_m, radius_m = skeleton.points_m[part], skeleton.radius_m[part]
        above, leaves = int(skeleton.parent_curve[branch]), int(skeleton.parent_vertex[branch])
        has_piece = above >= 0 and number[above] >= 0
        if has_piece and leaves - skeleton.first[above] >= begin[above]:
            parent_curve.append(int(number[above]))
            parent_vertex.append(int(place[above] + leaves - skeleton.first[above] - begin[above]))
            kept = 0
        else:
            start = _first_clear(skeleton, branch, joined | (number >= 0))
            if start is None:
                continue
            kept, share = start
            first_m = (1 - share) * points_m[kept] + share * points_m[kept + 1]
            first_radius_m = (1 - share) * radius_m[kept] + share * radius_m[kept + 1]
            points_m = np.concatenate([first_m[None], points_m[kept + 1 :]])
            radius_m = np.concatenate([[first_radius_m], radius_m[kept + 1 :]])
            parent_curve.append(-1)
            parent_vertex.append(-1)
        number[branch] = len(curve)
        # Of a piece that begins between two vertices the first one is new, and nothing springs from it.
        begin[branch] = kept + 1 if parent_curve[-1] < 0 else 0
        place[branch] = total + (1 if parent_curve[-1] < 0 else 0)
        curve.append(branch)
        parts.append((points_m, radius_m))
        total += len(points_m)
    if not curve:
        return None
    order = np.zeros(len(curve), np.int32)
    for index, parent in enumerate(parent_curve):
        order[index] = 0 if parent < 0 else order[parent] + 1
    return LoosePieces(
        skeleton=Skeleton(
            points_m=np.concatenate([points_m for points_m, _ in parts]),
            radius_m=np.concatenate([radius_m for _, radius_m in parts]),
            counts=np.array([len(points_m) for points_m, _ in parts], np.int32),
            parent_curve=np.array(parent_curve, np.int32),
            parent_vertex=np.array(parent_vertex, np.int32),
            order=order,
        ),
        curve=np.array(curve, np.int32),
    )


def _first_clear(skeleton: Skeleton, branch: int, standing: NDArray[np.bool_]) -> tuple[int, float] | None:
    """The edge of a branch, and the share along it, from where on it is clear of all that stands below it."""
    below: list[int] = []
    parent = int(skeleton.parent_curve[branch])
    while parent >= 0:
        if standing[parent]:
            below.append(parent)
        parent = int(skeleton.parent_curve[parent])
    points_m, radius_m = skeleton.points_m[skeleton.branch(branch)], skeleton.radius_m[skeleton.branch(branch)]
    if not below:
        return 0, 0.0
    steps_m = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    path_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    if path_m[-1] == 0:
        return None
    step_m = _STEP * float(radius_m.mean())
    walked_m = np.arange(0, path_m[-1], step_m)
    edge = np.clip(np.searchsorted(path_m, walked_m, side="right") - 1, 0, len(steps_m) - 1)
    share = (walked_m - path_m[edge]) / np.maximum(steps_m[edge], 1e-300)
    at_m = points_m[edge] + share[:, None] * (points_m[edge + 1] - points_m[edge])
    own_m = radius_m[edge] + share * (radius_m[edge + 1] - radius_m[edge])
    along = (points_m[edge + 1] - points_m[edge]) / np.maximum(steps_m[edge], 1e-300)[:, None]
    walked_m = np.append(walked_m, path_m[-1])
    upto = _AT_FIRST
    while True:  # few are not clear soon
        upto = min(upto, len(at_m))
        near = _segments_near(skeleton, below, at_m[:upto], step_m)
        clear = _is_clear(near, at_m[:upto], own_m[:upto], along[:upto], step_m)
        # Where it stays clear for a while: a limb that comes near what is below once more is not cut there.
        blocked = np.concatenate([np.flatnonzero(~clear), [upto]])
        free = np.concatenate([[0], blocked[:-1] + 1])
        long = np.flatnonzero(walked_m[blocked] - walked_m[free] >= _MIN_LENGTH * np.append(own_m, own_m[-1])[free])
        if len(long):
            first = int(free[long[0]])
            return int(edge[first]), float(min(share[first], 0.99))
        if upto == len(at_m):
            return None
        upto *= 4


def _is_clear(
    below: Skeleton,
    at_m: NDArray[np.float64],
    own_m: NDArray[np.float64],
    along: NDArray[np.float64],
    step_m: float,
) -> NDArray[np.bool_]:
    """(N,) whether places (N, 3) of a branch, with radii (N,) and directions (N, 3), are clear of what is below it."""
    axis_m, axis_radius_m, direction = sample_axes(below, step_m)
    near = min(_NEAREST, len(axis_m))
    found = np.asarray(cKDTree(axis_m).query(at_m, k=list(range(1, near + 1)))[1])
    clear = np.ones(len(at_m), bool)
    for nearest in found.T:
        away = at_m - axis_m[nearest]
        away -= np.einsum("nc,nc->n", away, direction[nearest])[:, None] * direction[nearest]
        away_m = np.linalg.norm(away, axis=1)
        # The ring at the start stands across the branch: of one that leans it comes nearer than the axis.
        leaning = np.abs(np.einsum("nc,nc->n", away, along)) / np.maximum(away_m, 1e-300)
        reach_m = own_m * (np.sqrt(np.maximum(0, 1 - leaning**2)) + _GAP)
        clear &= away_m - axis_radius_m[nearest] >= reach_m
    return clear


def _segments_near(skeleton: Skeleton, branches: list[int], at_m: NDArray[np.float64], step_m: float) -> Skeleton:
    """The segments of some branches among which are those nearest to places (N, 3), each as a plant of its own."""
    start = np.concatenate([np.arange(skeleton.first[k], skeleton.first[k] + skeleton.counts[k] - 1) for k in branches])
    middle_m = (at_m.min(axis=0) + at_m.max(axis=0)) / 2
    reach_m = float(np.linalg.norm(at_m - middle_m, axis=1).max())
    low_m, edge_m = skeleton.points_m[start], skeleton.points_m[start + 1] - skeleton.points_m[start]
    square = np.maximum(np.einsum("nc,nc->n", edge_m, edge_m), 1e-300)
    share = np.clip(np.einsum("nc,nc->n", middle_m - low_m, edge_m) / square, 0, 1)
    away_m = np.linalg.norm(middle_m - low_m - share[:, None] * edge_m, axis=1)
    start = start[away_m <= away_m.min() + 2 * reach_m + (_NEAREST + 1) * step_m]
    ends = np.stack([start, start + 1], axis=1).reshape(-1)
    return Skeleton(
        points_m=skeleton.points_m[ends],
        radius_m=skeleton.radius_m[ends],
        counts=np.full(len(start), 2, np.int32),
        parent_curve=np.full(len(start), -1, np.int32),
        parent_vertex=np.full(len(start), -1, np.int32),
        order=np.zeros(len(start), np.int32),
    )
