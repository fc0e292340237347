"""Branches that cannot be joined to their parent in one mesh: closed pieces of their own that run into it.

A limb that is left out would take all that it carries with it. Its piece begins inside of what it springs from, a
little before the place where its axis comes out, and no thicker than that is there, so that no light passes between the
two and nothing stands out on the other side. The method is our own.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from usdfoliage.branch.distances import sample_axes
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.pruning import pass_through
from usdfoliage.geometry.smooth_mesh import refine_smooth

THICKEST = 0.8  # of the radius of what a piece springs from, where it begins
GROWTH = 0.3  # of its radius, for a length, from there on
FOOT = 2.4  # of its radius, that a piece begins inside: its third ring stands so far from the first
MIN_STUB = 0.3  # of its radius, that a piece must stand out at least
_LEVELS = 2  # of division of the faces near the place where a piece leaves
_FACES = 8  # by whose size the reach around a place is chosen
_STEP = 0.25  # of a branch's mean radius, between places on axes that are looked at


@dataclass(frozen=True, kw_only=True, eq=False)
class LoosePieces:
    """Branches as plants of their own."""

    skeleton: Skeleton
    curve: NDArray[np.int32]  # (B,), the branch that each one is in the skeleton that they are from


@dataclass(frozen=True, kw_only=True, eq=False)
class StandingWood:
    """The surface that there is already."""

    points_m: NDArray[np.float64]  # (P, 3), of a closed cage
    faces: NDArray[np.int32]  # (F, 4)

    @cached_property
    def middle_m(self) -> NDArray[np.float64]:
        """(F, 3), middles of the faces."""
        return np.asarray(self.points_m[self.faces].mean(axis=1))

    @cached_property
    def tree(self) -> "scipy.spatial.cKDTree":
        return scipy.spatial.cKDTree(self.middle_m)

    def find_outside(self, places_m: NDArray[np.float64]) -> NDArray[np.bool_] | None:
        """(N,), which places (N, 3) of a polyline are outside the limit of the faces near it; None without any."""
        middle_m = (places_m.min(axis=0) + places_m.max(axis=0)) / 2
        reach_m = float(np.linalg.norm(places_m - middle_m, axis=1).max())
        near = np.array(sorted(self.tree.query_ball_point(middle_m, reach_m + 2 * self._typical_m(middle_m))), np.int64)
        if not len(near):
            return None
        used, corners = np.unique(self.faces[near], return_inverse=True)
        refined_m, quads = refine_smooth(self.points_m[used], corners.reshape(-1, 4), _LEVELS)
        around = refined_m[quads]
        at_m = around.mean(axis=1)
        normal = np.cross(around[:, 2] - around[:, 0], around[:, 3] - around[:, 1])
        nearest = np.asarray(scipy.spatial.cKDTree(at_m).query(places_m)[1])
        return np.asarray(np.einsum("nc,nc->n", places_m - at_m[nearest], normal[nearest]) > 0)

    def _typical_m(self, place_m: NDArray[np.float64]) -> float:
        """The size of the faces near a place."""
        found = np.asarray(self.tree.query(place_m, k=min(_FACES, len(self.faces)))[1]).reshape(-1)
        corners_m = self.points_m[self.faces[found]]
        return float(np.linalg.norm(corners_m - self.middle_m[found][:, None], axis=2).max())


def cut_loose(
    skeleton: Skeleton,
    lost: NDArray[np.bool_],
    joined: NDArray[np.bool_],
    wood: StandingWood | None = None,
    *,
    alone: bool = False,
) -> LoosePieces | None:
    """What can be saved of branches that are lost; None where nothing can.

    Args:
        skeleton: All branches.
        lost: (B,), that could not be joined to what they spring from, with all that they carry.
        joined: (B,), that are in the surface.
        wood: That surface, where a piece comes out of it; by the radii of the branches where it is not given.
        alone: True makes a piece of each branch, with no fork among them: none of these can cross.
    """
    parts: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    curve: list[int] = []
    parent_curve: list[int] = []
    parent_vertex: list[int] = []
    number = np.full(len(skeleton), -1)  # of a branch among the pieces
    own_first = np.zeros(len(skeleton), np.int64)  # where the first of its own points is put
    cut_off = np.zeros(len(skeleton), np.int64)  # of its own points, how many the piece lacks
    total = 0
    for branch in np.flatnonzero(lost).tolist():  # parents first
        above, leaves = int(skeleton.parent_curve[branch]), int(skeleton.parent_vertex[branch])
        # What left from the part of a piece that was cut off runs into what is there now.
        has_piece = above >= 0 and number[above] >= 0 and leaves - int(skeleton.first[above]) >= cut_off[above]
        if has_piece and not alone:
            points_m, radius_m = skeleton.points_m[skeleton.branch(branch)], skeleton.radius_m[skeleton.branch(branch)]
            parent_curve.append(int(number[above]))
            parent_vertex.append(int(own_first[above]) + leaves - int(skeleton.first[above]))
            added = gone = 0
        else:
            found = _begin_inside(skeleton, branch, joined | (number >= 0), wood)
            if found is None:
                continue
            points_m, radius_m, added, gone = found
            parent_curve.append(-1)
            parent_vertex.append(-1)
        number[branch] = len(curve)
        own_first[branch], cut_off[branch] = total + added, gone
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


def _begin_inside(
    skeleton: Skeleton, branch: int, standing: NDArray[np.bool_], wood: StandingWood | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], int, int] | None:
    """Points (n, 3) and radii (n,) of a branch from within what stands below it, the place of its own first point among
    them, and how many of its own are left out; None where it does not stand out.

    Through branches that are in no surface it goes back to the first one that is.
    """
    part = skeleton.branch(branch)
    points_m, radius_m = skeleton.points_m[part], skeleton.radius_m[part]
    passed, below, leaves = pass_through(skeleton, branch, standing)
    added = len(passed)
    points_m = np.concatenate([skeleton.points_m[passed], points_m])
    radius_m = np.concatenate([np.full(added, radius_m[0]), radius_m])
    if below < 0:
        return points_m, radius_m, added, 0
    walked_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_m, axis=0), axis=1))])
    if walked_m[-1] == 0:
        return None
    chain = []
    while below >= 0:
        if standing[below]:
            chain.append(below)
        below = int(skeleton.parent_curve[below])
    radius_m = np.minimum(radius_m, THICKEST * skeleton.radius_m[leaves] + GROWTH * walked_m)
    out_m = _leaving_arc(skeleton, chain, points_m, radius_m, walked_m, wood)
    if out_m is None:
        return None
    # The third ring of the piece is where it comes out.
    begin_m = max(0.0, out_m - FOOT * float(np.interp(out_m, walked_m, radius_m)))
    if begin_m == 0:
        return points_m, radius_m, added, 0
    first_m = np.array([np.interp(begin_m, walked_m, column) for column in points_m.T])
    cut = int(np.argmax(walked_m > begin_m + 1e-9 * walked_m[-1]))  # points that are left out
    return (
        np.concatenate([first_m[None], points_m[cut:]]),
        np.concatenate([[np.interp(begin_m, walked_m, radius_m)], radius_m[cut:]]),
        added + 1 - cut,
        max(0, cut - added),
    )


def _leaving_arc(
    skeleton: Skeleton,
    chain: list[int],
    points_m: NDArray[np.float64],
    radius_m: NDArray[np.float64],
    walked_m: NDArray[np.float64],
    wood: StandingWood | None,
) -> float | None:
    """How far along a polyline (n, 3) with radii (n,) its axis leaves the wood of the branches of a chain; None where
    it never stands out of it by MIN_STUB."""
    step_m = _STEP * float(radius_m.mean())
    edges = np.concatenate([np.arange(skeleton.first[k], skeleton.first[k] + skeleton.counts[k] - 1) for k in chain])
    edges = edges[_near_edges(skeleton, edges, points_m)]
    ends = np.stack([edges, edges + 1], axis=1).reshape(-1)
    segments = Skeleton(
        points_m=skeleton.points_m[ends],
        radius_m=skeleton.radius_m[ends],
        counts=np.full(len(edges), 2, np.int32),
        parent_curve=np.full(len(edges), -1, np.int32),
        parent_vertex=np.full(len(edges), -1, np.int32),
        order=np.zeros(len(edges), np.int32),
    )
    axis_m, axis_radius_m, _ = sample_axes(segments, max(step_m, float(skeleton.radius_m[ends].min()) / 2))
    at_m = np.unique(np.append(np.arange(0, walked_m[-1], step_m), walked_m[-1]))
    places_m = np.stack([np.interp(at_m, walked_m, column) for column in points_m.T], axis=1)
    own_m = np.interp(at_m, walked_m, radius_m)
    away_m, nearest = (np.asarray(each) for each in scipy.spatial.cKDTree(axis_m).query(places_m))
    outside_m = away_m - axis_radius_m[nearest]
    if not (outside_m + own_m >= MIN_STUB * own_m).any():
        return None
    through = np.flatnonzero(outside_m >= 0)
    if wood is not None:
        first = int(through[0]) if len(through) else len(at_m) - 1
        upto = min(len(at_m), 2 * first + 16)
        outside = wood.find_outside(places_m[:upto])
        if outside is not None:
            inside = np.flatnonzero(~outside)
            # The last place inside before it stays outside; none inside: it begins where its parent has no surface.
            return float(at_m[min(int(inside[-1]) + 1, len(at_m) - 1)]) if len(inside) else 0.0
    return float(at_m[through[0]]) if len(through) else float(at_m[-1])


def _near_edges(skeleton: Skeleton, edges: NDArray[np.int64], points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(E,) segments of axes in whose wood a place of a polyline (n, 3) may be, by spheres; the nearest is one."""
    begin_m, end_m = skeleton.points_m[edges], skeleton.points_m[edges + 1]
    middle_m = (points_m.min(axis=0) + points_m.max(axis=0)) / 2
    reach_m = np.linalg.norm(points_m - middle_m, axis=1).max()
    reach_m += 2 * float(np.maximum(skeleton.radius_m[edges], skeleton.radius_m[edges + 1]).max())
    away_m = np.linalg.norm((begin_m + end_m) / 2 - middle_m, axis=1) - np.linalg.norm(end_m - begin_m, axis=1) / 2
    near = away_m <= reach_m
    near[np.argmin(away_m)] = True
    return np.asarray(near)
