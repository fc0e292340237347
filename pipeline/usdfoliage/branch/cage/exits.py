"""Where a branch leaves the surface of its parent, found for all branches at once by walking out along their axes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.branch.cage.tubes import Floats, Ints, Tubes, rotate_between

CAGE_FACTOR = 1.2  # how much farther from the axis a cage of six is than its limit, nearly
THICKEST = 0.95  # of the parent's radius, where a branch leaves it
MIN_STUB = 0.3  # of its radius: what ends thinner than this before it is clear of its parent is not worth a hole
SKIN = 1e-6  # radii
MAX_STEPS = 400


@dataclass(frozen=True, kw_only=True, eq=False)
class Exits:
    """How C tubes leave their parents. Metres, radians."""

    tube: Ints  # (C,)
    parent: Ints  # (C,), tube
    reached: NDArray[np.bool_]  # (C,), whether the tube comes out at all
    hole_arc_m: Floats  # (C,), on the parent, where the axis comes through the surface
    azimuth_rad: Floats  # (C,), about the parent's axis, in its frame
    sine: Floats  # (C,), of the angle between the two axes there
    parent_radius_m: Floats  # (C,)
    radius_m: Floats  # (C,), of the branch there, at most THICKEST of its parent's
    free_arc_m: Floats  # (C,), on the tube, from where its whole disc is clear of the parent
    free_parent_arc_m: Floats  # (C,), the place of the parent next to that
    free_radius_m: Floats  # (C,), what the disc there may have
    phase_rad: Floats  # (C,), angle in the tube's frame of what lies across the parent's axis


def find_exits(tubes: Tubes, tube: Ints, clearance: Floats) -> Exits:
    """Walk out along tubes (C,) until they are clear of their parents.

    Args:
        tubes: All axes.
        tube: (C,) those that have a parent.
        clearance: (C,) by how much of its radius the disc of a tube must be clear.
    """
    parent = tubes.parent[tube]
    at = _Nearest.start(tubes, tube, parent)
    zero = np.zeros(len(tube))
    exit_arc, exit_ok = _walk(tubes, at, zero, np.zeros(len(tube)), None)
    point, _ = tubes.axis(tube, exit_arc)
    near = at.find(point)
    hole_arc, parent_radius = near.arc_m, near.radius_m
    own_radius = tubes.axis(tube, exit_arc)[1]
    radius = np.minimum(own_radius, THICKEST * parent_radius)

    free_arc, free_ok = _walk(tubes, at, exit_arc, clearance, THICKEST)
    disc = _disc(tubes, at, free_arc, THICKEST)
    # A stub that ends before its disc is clear gets a thinner one.
    room = (disc.distance_m - CAGE_FACTOR * disc.near.radius_m - clearance * radius * 0.5) / CAGE_FACTOR
    slim = room / np.maximum(disc.sideways, 1e-3)
    free_radius = np.where(free_ok, disc.radius_m, np.minimum(disc.radius_m, slim))
    reached = exit_ok & (free_ok | (free_radius > MIN_STUB * disc.radius_m))

    tangent = tubes.tangents(parent, hole_arc, 0.5 * parent_radius)
    first, second = tubes.frames(parent, hole_arc, tangent)
    child = tubes.tangents(tube, exit_arc, 0.5 * radius)
    outward = point - near.point_m
    outward = _sideways_of(outward, tangent, near.radius_m)
    beyond = _sideways_of(disc.point_m - near.point_m, tangent, near.radius_m)
    flat = np.linalg.norm(outward, axis=1) < 0.05 * parent_radius  # out through the end: where it goes on decides
    outward[flat] = beyond[flat]
    none = np.linalg.norm(outward, axis=1) < 1e-9 * parent_radius
    outward[none] = first[none]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    azimuth = np.arctan2(np.sum(outward * second, axis=1), np.sum(outward * first, axis=1))

    free_tangent = tubes.tangents(tube, free_arc, 0.5 * free_radius.clip(1e-3 * radius))
    own_first, own_second = tubes.frames(tube, free_arc, free_tangent)
    across = rotate_between(outward, free_tangent, np.cross(tangent, outward))
    return Exits(
        tube=tube,
        parent=parent,
        reached=reached,
        hole_arc_m=hole_arc,
        azimuth_rad=azimuth,
        sine=np.abs(np.sum(child * outward, axis=1)),
        parent_radius_m=parent_radius,
        radius_m=radius,
        free_arc_m=free_arc,
        free_parent_arc_m=disc.near.arc_m,
        free_radius_m=free_radius,
        phase_rad=np.arctan2(np.sum(across * own_second, axis=1), np.sum(across * own_first, axis=1)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Place:
    """Nearest places (C,) on the parents' axes."""

    point_m: Floats  # (C, 3)
    arc_m: Floats
    radius_m: Floats


@dataclass(kw_only=True, eq=False)
class _Nearest:
    """The parents' segments (C,) next to points that move a little at a time."""

    tubes: Tubes
    tube: Ints
    parent: Ints
    at: Ints

    @staticmethod
    def start(tubes: Tubes, tube: Ints, parent: Ints) -> "_Nearest":
        return _Nearest(tubes=tubes, tube=tube, parent=parent, at=tubes.segment(parent, tubes.parent_arc_m[tube]))

    def find(self, points: Floats) -> _Place:
        """The places next to points (C, 3), from where the last ones were."""
        near = _native.tube_nearest(
            self.tubes.axes, self.parent, self.at, places_m=points, max_steps=MAX_STEPS, threads=0
        )
        self.at = near.at
        return _Place(point_m=near.points_m, arc_m=near.arc_m, radius_m=near.radius_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Disc:
    """Discs across the tubes at some places (C,)."""

    near: _Place
    point_m: Floats  # (C, 3)
    distance_m: Floats  # of the middle from the parent's axis
    radius_m: Floats
    sideways: Floats  # how much of its radius the disc reaches towards the parent


def _disc(tubes: Tubes, at: _Nearest, arc_m: Floats, thickest: float) -> _Disc:
    point, own = tubes.axis(at.tube, arc_m)
    near = at.find(point)
    offset = point - near.point_m
    distance = np.linalg.norm(offset, axis=1)
    radius = np.minimum(own, thickest * near.radius_m)
    tangent = tubes.tangents(at.tube, arc_m, 0.5 * radius)
    along = np.sum(offset * tangent, axis=1) / np.maximum(distance, 1e-300)
    return _Disc(
        near=near,
        point_m=point,
        distance_m=distance,
        radius_m=radius,
        sideways=np.sqrt(np.clip(1 - along**2, 0, 1)),
    )


def _walk(
    tubes: Tubes, at: _Nearest, start_m: Floats, clearance: Floats, thickest: float | None
) -> tuple[Floats, NDArray[np.bool_]]:
    """Walk on until the axis (thickest None), or the whole disc of the cage, is outside the parent.

    Returns:
        Arcs (C,), not beyond the tip, and whether they were reached.
    """
    exits = _native.walk_out(
        tubes.axes,
        _native.ExitWalks(tube=at.tube, parent=at.parent, clearance=clearance, at=at.at, start_m=start_m),
        settings=_native.ExitWalkSettings(
            whole_disc=thickest is not None,
            cage_factor=CAGE_FACTOR,
            thickest=thickest or THICKEST,
            skin=SKIN,
            max_steps=MAX_STEPS,
        ),
        threads=0,
    )
    at.at = exits.at
    return exits.arc_m, exits.done.astype(bool)


def _sideways_of(vectors: Floats, tangent: Floats, radius_m: Floats) -> Floats:
    out = vectors - np.sum(vectors * tangent, axis=1, keepdims=True) * tangent
    return np.where(np.linalg.norm(out, axis=1, keepdims=True) > 1e-9 * radius_m[:, None], out, 0.0)
