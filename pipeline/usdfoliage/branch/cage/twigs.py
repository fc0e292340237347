"""Twigs of four sides, drawn out of single faces of what they spring from.

A branch that is joined with a hole of six takes two rows of its parent's faces and many beside these. Where branches
are many, the thinnest are twigs instead: one face of the parent, between two rings round the place where the twig comes
out, is taken away, and four rows lead from its corners along the axis. The surface stays closed, with a quarter of the
faces. A twig for which no such face is free becomes a closed piece of its own that begins on the axis of its parent.
The method is our own.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.axis_places import Exits, places_at
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.cage.limit import pull_limit
from usdfoliage.branch.cage.rings import SHOULDER, TIP, RingMarks, ring_swell
from usdfoliage.branch.cage.tubes import carry_references, turning
from usdfoliage.branch.model import Skeleton

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SIDES = 4
AT_VERTICES = 1.014  # the limit of a square is 2.8 % nearer to the axis half-way between its vertices than at them
THICKEST = 0.8  # of the radius of what a twig springs from, where it begins
GROWTH = 0.3  # of a radius, for a length, from there on
MIN_STUB = 0.3  # of its radius, that a twig must stand out at least
BEHIND = 1.2  # of the radius of what a twig goes on from, that a piece begins behind the tip of that
CLEAR = 0.5  # of its radius, between the parent's surface and a twig's first ring
STEEPEST = 2.0  # cotangent of the angle to the parent, up to which that is more where a twig leaves at an angle
SAGITTA = 0.4  # radii: how far a straight line from ring to ring may be from the axis
COARSEST_BENT = 2.0  # times fewer rings in a bend: with fewer still the surface would leave the axis
LONGEST = 60.0  # radii, from ring to ring
CLOSE = 0.4  # radii, between the rings of a piece where it comes out
NEAREST = 0.3  # radii: rings keep this distance, but for the one beside the tip
ROUNDS = 5  # of moving the limit
CAP_GAIN = 0.2  # a cap's edge is round, too
STEP = 1.2  # radii of a parent, from ring to ring where twigs leave
FACES = 16  # of a parent, that are looked at for a twig
SLENDER = 3.0  # how much longer than wide a face may be
WIDER = 6.0  # radii of the twig, that it may be long in any case
OUTWARD = 0.2  # cosine between a face's normal and the twig, at least
MOVED = 0.4  # radii of a parent, by which its surface is off its axis, from which on a piece begins in its middle
OFF = 1.0  # diagonals of a face, that its middle may be from where the twig comes out


@dataclass(frozen=True, kw_only=True)
class TwigSettings:
    """How many rings twigs have."""

    coarser: float = 1.0  # factor on the distances from ring to ring


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stations:
    """Rings, twig after twig, from what one springs from to its tip."""

    curve: Ints  # (R,)
    center_m: Floats  # (R, 3)
    radius_m: Floats  # (R,)
    arc_m: Floats  # (R,), along the branch, below 0 before its first point


@dataclass(kw_only=True, eq=False)
class _Mesh:
    """The surface while twigs are drawn out of it; faces that are taken stay in their places until the end."""

    points_m: Floats
    ring: Ints
    faces: Ints
    st_m: Floats
    face_st: Ints
    curve: Ints
    row: NDArray[np.bool_]  # (F,), of a row along a branch, out of which a twig can be drawn
    taken: NDArray[np.bool_]  # (F,)
    aims_m: Floats
    tangent: Floats
    swell: Floats
    center_m: Floats
    gain: Floats


def stand_out(skeleton: Skeleton, exits: Exits) -> NDArray[np.bool_]:
    """(B,) whether a branch comes out of its parent far enough to be seen; roots do if they have a length."""
    tip_m = skeleton.radius_m[skeleton.first + skeleton.counts - 1]
    return np.asarray(skeleton.lengths_m > exits.arc_m + MIN_STUB * tip_m)


def count_rows(skeleton: Skeleton, settings: TwigSettings = TwigSettings()) -> Floats:
    """(B,) rows that turns and length of each branch ask for, not rounded."""
    measure = _measure(skeleton, settings)
    return measure[skeleton.first + skeleton.counts - 1] - measure[skeleton.first]


def mark_twigs(skeleton: Skeleton, is_twig: NDArray[np.bool_], exits: Exits) -> RingMarks:
    """Rings on both sides of each twig, on what it springs from."""
    twig = np.flatnonzero(is_twig & (skeleton.parent_curve >= 0))
    parent = skeleton.parent_curve[twig]
    # Twigs that leave close together have rings in common: those of even steps along their parent.
    step_m = STEP * skeleton.radius_m[skeleton.parent_vertex[twig]]
    below_m = np.floor(exits.parent_arc_m[twig] / step_m) * step_m
    return RingMarks(
        branch=np.concatenate([parent, parent]).astype(np.int64), arc_m=np.concatenate([below_m, below_m + step_m])
    )


def draw_twigs(
    skeleton: Skeleton,
    is_twig: NDArray[np.bool_],
    cage: BranchCage,
    exits: Exits,
    settings: TwigSettings = TwigSettings(),
) -> BranchCage:
    """Draw twigs out of a cage.

    Args:
        skeleton: All branches, which stand out of what they spring from; metres.
        is_twig: (B,), those that are twigs; what one of them carries is one of them, too.
        cage: The surface of the others.
        exits: Where axes come out of what they spring from.
        settings: How closely twigs follow their axes.
    """
    marks = mark_twigs(skeleton, is_twig, exits)
    mesh = _begin_mesh(cage)
    pieces: list[int] = []
    for order in np.unique(skeleton.order[is_twig]).tolist():
        curves = np.flatnonzero(is_twig & (skeleton.order == order))
        faces = _choose_faces(skeleton, curves, exits, mesh)
        pieces += curves[faces < 0].tolist()
        stations = _place_rings(skeleton, curves, faces >= 0, exits, marks, settings, mesh)
        _append_twigs(mesh, curves, faces, stations)
    return _finish(cage, mesh, skeleton, pieces)


def _begin_mesh(cage: BranchCage) -> _Mesh:
    points = len(cage.points_m)
    row = np.ones(len(cage.faces), bool)
    # A row leads from one ring to another, a cap has one, and what is round a hole has those of three.
    rings = np.sort(cage.ring[cage.faces], axis=1)
    row = (rings[:, 0] == rings[:, 1]) & (rings[:, 2] == rings[:, 3]) & (rings[:, 1] != rings[:, 2])
    row[cage.fork_faces[_near_holes(cage)]] = False
    return _Mesh(
        points_m=cage.points_m,
        ring=cage.ring.astype(np.int64),
        faces=cage.faces.astype(np.int64),
        st_m=cage.st_m,
        face_st=cage.face_st.astype(np.int64),
        curve=cage.curve.astype(np.int64),
        row=row,
        taken=np.zeros(len(cage.faces), bool),
        aims_m=cage.points_m,
        tangent=np.zeros((points, 3)),
        swell=np.zeros((points, 2)),
        center_m=np.zeros((points, 3)),
        gain=np.zeros(points),
    )


def _near_holes(cage: BranchCage) -> NDArray[np.bool_]:
    """(K,) which faces near forks share a vertex with a face that leads to the branch that leaves there."""
    fork = np.repeat(np.arange(len(cage.fork_counts)), cage.fork_counts)
    leads = cage.curve[cage.fork_faces] == cage.fork_curve[fork]
    touched = np.zeros(len(cage.points_m), bool)
    touched[cage.faces[cage.fork_faces[leads]]] = True
    return np.asarray(touched[cage.faces[cage.fork_faces]].any(axis=1))


def _choose_faces(skeleton: Skeleton, curves: Ints, exits: Exits, mesh: _Mesh) -> Ints:
    """(S,) the face of its parent that each twig is drawn out of, -1 where none is free; thick ones choose first."""
    chosen = np.full(len(curves), -1, np.int64)
    parent = exits.curve[curves].astype(np.int64)
    free = np.flatnonzero(mesh.row & ~mesh.taken & np.isin(mesh.curve, parent))
    if not len(free):
        return chosen
    corners_m = mesh.points_m[mesh.faces[free]]
    middle_m = corners_m.mean(axis=1)
    normal = np.cross(corners_m[:, 2] - corners_m[:, 0], corners_m[:, 3] - corners_m[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    edges_m = np.linalg.norm(np.roll(corners_m, -1, axis=1) - corners_m, axis=2)
    sides_m = np.stack([edges_m[:, [0, 2]].mean(axis=1), edges_m[:, [1, 3]].mean(axis=1)], axis=1)
    long_m, short_m = sides_m.max(axis=1), sides_m.min(axis=1)
    out = places_at(skeleton, curves, exits.arc_m[curves])
    out_m = out.between(skeleton.points_m)
    radius_m = out.between(skeleton.radius_m)
    step = skeleton.points_m[out.vertex + 1] - skeleton.points_m[out.vertex]
    direction = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-300)
    found = cKDTree(middle_m).query(out_m, k=list(range(1, min(FACES, len(free)) + 1)), workers=-1)
    away_m, near = (np.asarray(each) for each in found)
    fits = (
        np.isfinite(away_m)
        & (mesh.curve[free[near]] == parent[:, None])
        & (np.einsum("skc,sc->sk", normal[near], direction) > OUTWARD)
        & (long_m[near] <= np.maximum(WIDER * radius_m[:, None], SLENDER * short_m[near]))
        & (away_m <= OFF * np.hypot(long_m, short_m)[near])
    )
    gone = np.zeros(len(free), bool)
    for twig in np.argsort(-radius_m, kind="stable").tolist():
        able = np.flatnonzero(fits[twig] & ~gone[near[twig]])
        if len(able):
            face = int(near[twig, able[0]])
            gone[face] = True
            chosen[twig] = free[face]
    return chosen


def _measure(skeleton: Skeleton, settings: TwigSettings) -> Floats:
    """(V,) rings that turns and lengths ask for up to each point, all branches one after another."""
    step = np.diff(skeleton.points_m, axis=0, prepend=skeleton.points_m[:1])
    length_m = np.linalg.norm(step, axis=1)
    length_m[skeleton.first] = 0
    direction = np.divide(step, length_m[:, None], out=np.zeros_like(step), where=length_m[:, None] > 0)
    turn = np.zeros(len(step))  # at the point between two segments
    inner = np.flatnonzero((length_m[:-1] > 0) & (length_m[1:] > 0))
    turn[inner] = turning(direction[inner], direction[inner + 1])
    half = np.zeros(len(step))
    half[1:] = (turn[:-1] + turn[1:]) / 2
    # Of n straight lines along an arc that turns by t over s, each is s t / (8 n²) off in its middle.
    bent = np.sqrt(half * length_m / (8 * SAGITTA * skeleton.radius_m)) / min(settings.coarser, COARSEST_BENT)
    asked = bent + length_m / (LONGEST * skeleton.radius_m) / settings.coarser
    asked[skeleton.first] = 0
    return np.cumsum(asked)


def _place_rings(
    skeleton: Skeleton,
    curves: Ints,
    drawn: NDArray[np.bool_],
    exits: Exits,
    marks: RingMarks,
    settings: TwigSettings,
    mesh: _Mesh,
) -> _Stations:
    """Rings of twigs (S,) that are drawn out of faces, or that begin on the axes of their parents."""
    measure = _measure(skeleton, settings)
    first = skeleton.first.astype(np.int64)
    last = first + skeleton.counts - 1
    tip_m = skeleton.radius_m[last[curves]]
    beside_m = skeleton.lengths_m[curves] - SHOULDER * tip_m
    start_m = np.where(drawn, _clear_arc(skeleton, curves, exits), exits.arc_m[curves])
    start_m = np.minimum(start_m, np.maximum(beside_m - NEAREST * tip_m, exits.arc_m[curves]))
    start = places_at(skeleton, curves, start_m)
    start_at = start.vertex + start.share
    grid = np.arange(len(measure), dtype=np.float64)
    low, high = np.interp(start_at, grid, measure), measure[last[curves]]
    rows = np.maximum(1, np.ceil(high - low - 1e-9)).astype(np.int64)
    of = np.repeat(np.arange(len(curves)), rows + 1)
    within = np.arange(len(of)) - np.repeat(np.cumsum(rows + 1) - rows - 1, rows + 1)
    at = np.interp(low[of] + (high - low)[of] * within / rows[of], measure, grid)
    # Where the measure stands still the place is not unique, as from one branch to the next.
    at = np.clip(at, np.where(within == 0, start_at[of], first[curves[of]]), last[curves[of]])
    at = np.where(within == rows[of], last[curves[of]], np.where(within == 0, start_at[of], at))
    vertex = np.clip(np.floor(at).astype(np.int64), first[curves[of]], last[curves[of]] - 1)
    arc_m = (1 - (at - vertex)) * skeleton.arcs_m[vertex] + (at - vertex) * skeleton.arcs_m[vertex + 1]
    # Without a ring beside it, a tip would shrink by a quarter of its row.
    mine = np.isin(marks.branch, curves)
    start_of = np.zeros(len(skeleton))
    start_of[curves] = start_m
    marked, marked_m = marks.branch[mine], marks.arc_m[mine]
    inside = (marked_m > start_of[marked]) & (marked_m < skeleton.lengths_m[marked])
    curve = np.concatenate([curves[of], curves, marked[inside]])
    arc_m = np.concatenate([arc_m, beside_m, marked_m[inside]])
    # Where a piece comes out of its parent, rings stand close, so that its surface is near the other there.
    alone = np.flatnonzero(~drawn)
    close_m = exits.arc_m[curves[alone]] + CLOSE * np.array([[-1.0], [1.0]]) * start.between(skeleton.radius_m)[alone]
    real = ((close_m > 0) & (close_m < beside_m[alone])).reshape(-1)
    curve = np.concatenate([curve, np.tile(curves[alone], 2)[real]])
    arc_m = np.concatenate([arc_m, close_m.reshape(-1)[real]])
    place = places_at(skeleton, curve, arc_m)
    center_m, radius_m = place.between(skeleton.points_m), place.between(skeleton.radius_m)
    springs = curves[~drawn & (skeleton.parent_curve[curves] >= 0)]
    if len(springs):
        begin_m, behind_m = _begin(skeleton, springs)
        begin_m = _inside_surface(mesh, skeleton.parent_curve[springs].astype(np.int64), begin_m)
        curve, center_m = np.concatenate([curve, springs]), np.concatenate([center_m, begin_m])
        radius_m = np.concatenate([radius_m, skeleton.radius_m[first[springs]]])
        arc_m = np.concatenate([arc_m, -behind_m])
    order = np.lexsort([arc_m, curve])
    curve, center_m, radius_m, arc_m = curve[order], center_m[order], radius_m[order], arc_m[order]
    keep = _thin_out(curve, arc_m, radius_m)
    curve, center_m, radius_m, arc_m = curve[keep], center_m[keep], radius_m[keep], arc_m[keep]
    slim_m = np.where(skeleton.parent_curve >= 0, THICKEST * skeleton.radius_m[skeleton.parent_vertex], np.inf)
    return _Stations(
        curve=curve,
        center_m=center_m,
        radius_m=np.minimum(radius_m, slim_m[curve] + GROWTH * np.maximum(arc_m, 0)),
        arc_m=arc_m,
    )


def _clear_arc(skeleton: Skeleton, curves: Ints, exits: Exits) -> Floats:
    """(S,) from where a twig's disc is clear of its parent's surface, by the angle between the two."""
    out = places_at(skeleton, curves, exits.arc_m[curves])
    on = places_at(skeleton, exits.curve[curves], exits.parent_arc_m[curves])
    along, axis = (_unit(skeleton.points_m[place.vertex + 1] - skeleton.points_m[place.vertex]) for place in (out, on))
    cosine = np.abs(np.sum(along * axis, axis=1))
    cotangent = np.minimum(cosine / np.sqrt(np.maximum(1 - cosine**2, 1e-9)), STEEPEST)
    return exits.arc_m[curves] + (CLEAR + cotangent) * out.between(skeleton.radius_m)


def _thin_out(curve: Ints, arc_m: Floats, radius_m: Floats) -> NDArray[np.bool_]:
    """(R,) which of ordered rings stay: a twig's first and last one, the one beside the tip, and what is not close."""
    begins, tip = np.diff(curve, prepend=-1) != 0, np.diff(curve, append=-1) != 0
    keep = np.ones(len(curve), bool)
    needed = begins | tip | np.append(tip[1:], False)
    last_m, last_curve = -np.inf, -1
    for number in range(len(curve)):
        if curve[number] != last_curve:
            last_m, last_curve = -np.inf, int(curve[number])
        if not needed[number] and arc_m[number] - last_m < NEAREST * radius_m[number]:
            keep[number] = False
            continue
        last_m = float(arc_m[number])
    # The one beside the tip goes where it is the first, or at it.
    beside = np.flatnonzero(np.append(tip[1:], False) & ~begins)
    before = beside - 1
    close = (arc_m[beside] - arc_m[before] < NEAREST * radius_m[beside]) & ~begins[before]
    keep[before[close]] = False
    return keep


def _begin(skeleton: Skeleton, springs: Ints) -> tuple[Floats, Floats]:
    """Where pieces begin on the axes of what they spring from (S, 3), and how far before their own first points."""
    parent, leaves = skeleton.parent_curve[springs], skeleton.parent_vertex[springs]
    at_m = skeleton.arcs_m[leaves]
    own_m = np.minimum(skeleton.radius_m[skeleton.first[springs]], THICKEST * skeleton.radius_m[leaves])
    inside_m = np.minimum(BEHIND * skeleton.radius_m[leaves], skeleton.lengths_m[parent] / 2)
    behind_m = np.where(at_m >= skeleton.lengths_m[parent] - own_m, inside_m, 0.0)
    at_foot = (at_m <= own_m) & (skeleton.parent_curve[parent] < 0)
    place = places_at(skeleton, parent, np.where(at_foot, inside_m, at_m - behind_m))
    return place.between(skeleton.points_m), behind_m


def _inside_surface(mesh: _Mesh, parent: Ints, begin_m: Floats) -> Floats:
    """(S, 3) places on the axes of parents (S,), moved to the middle of their surface's nearest ring where that is
    elsewhere: a parent that is joined may have been moved to where it found room."""
    rings = int(mesh.ring.max(initial=-1)) + 1
    count = np.maximum(np.bincount(mesh.ring, minlength=rings), 1)[:, None]
    middle_m = np.stack([np.bincount(mesh.ring, mesh.points_m[:, c], rings) for c in range(3)], axis=-1) / count
    off_m = np.linalg.norm(mesh.points_m - middle_m[mesh.ring], axis=1)
    radius_m = np.bincount(mesh.ring, off_m, rings) / count[:, 0]
    ring, of = mesh.ring[mesh.faces[mesh.row].reshape(-1)], np.repeat(mesh.curve[mesh.row], SIDES)
    key = np.unique(of.astype(np.int64) * rings + ring)  # ascending by curve
    curve_of, ring_of = key // rings, key % rings
    low, high = np.searchsorted(curve_of, parent), np.searchsorted(curve_of, parent, side="right")
    moved_m = begin_m.copy()
    for number in np.flatnonzero(high > low).tolist():
        own = ring_of[low[number] : high[number]]
        away_m = np.linalg.norm(middle_m[own] - begin_m[number], axis=1)
        nearest = int(np.argmin(away_m))
        before, after = middle_m[own[max(nearest - 1, 0)]], middle_m[own[min(nearest + 1, len(own) - 1)]]
        along = _unit(after - before)
        step_m = middle_m[own[nearest]] - begin_m[number]
        across_m = step_m - (step_m @ along) * along
        if np.linalg.norm(across_m) > MOVED * radius_m[own[nearest]]:
            moved_m[number] += across_m
    return moved_m


def _append_twigs(mesh: _Mesh, curves: Ints, chosen: Ints, stations: _Stations) -> None:
    """Add the rings and faces of twigs (S,), and take the faces that they are drawn out of."""
    count, start = len(stations.curve), len(mesh.points_m)
    begins, ends = np.diff(stations.curve, prepend=-1) != 0, np.diff(stations.curve, append=-1) != 0
    first = np.flatnonzero(begins)
    sizes = np.diff(np.append(first, count))
    twig = np.repeat(np.arange(len(first)), sizes)  # in the order of curves, which ascends
    drawn = chosen >= 0
    base = mesh.faces[chosen[drawn]]  # (D, 4), of those that are drawn out of one
    ahead = np.minimum(np.arange(count) + 1, np.repeat(first + sizes - 1, sizes))
    before = np.maximum(np.arange(count) - 1, np.repeat(first, sizes))
    back_m = stations.center_m[before]
    back_m[first[drawn]] = mesh.points_m[base].mean(axis=1)
    tangent = _unit(stations.center_m[ahead] - back_m)
    step = stations.center_m[ahead] - stations.center_m
    step[ends] = (stations.center_m - back_m)[ends]
    reference = carry_references(_unit(step), first, sizes)
    side = _unit(reference - np.sum(reference * tangent, axis=1, keepdims=True) * tangent)
    other = np.cross(tangent, side)
    turned_by = np.zeros(len(chosen))
    turned_by[drawn] = _turn_to_corners(mesh, base, first[drawn], side, other)
    angle = turned_by[twig][:, None] + (np.pi / 4 + np.pi / 2 * np.arange(SIDES))
    radius_m = stations.radius_m * np.where(ends, TIP, 1.0)
    spoke = np.cos(angle)[..., None] * side[:, None] + np.sin(angle)[..., None] * other[:, None]
    aims_m = (stations.center_m[:, None] + AT_VERTICES * radius_m[:, None, None] * spoke).reshape(-1, 3)
    gain = np.ones((count, SIDES))
    gain[ends] = CAP_GAIN
    gain[first[~drawn]] = CAP_GAIN

    corner = start + np.arange(count * SIDES).reshape(count, SIDES)
    turned = np.roll(corner, -1, axis=1)
    row = np.flatnonzero(~ends)
    rows = np.stack([corner[row], turned[row], turned[row + 1], corner[row + 1]], axis=-1).reshape(-1, SIDES)
    foot = first[drawn]
    lofts = np.stack([base, np.roll(base, -1, axis=1), turned[foot], corner[foot]], axis=-1)
    lofts = lofts.reshape(-1, SIDES)
    caps = np.concatenate([corner[first[~drawn]][:, ::-1], corner[ends]])
    faces = np.concatenate([rows, lofts, caps])
    of_caps = np.concatenate([stations.curve[first[~drawn]], stations.curve[ends]])
    curve = np.concatenate([np.repeat(stations.curve[row], SIDES), np.repeat(curves[drawn], SIDES), of_caps])
    st_m, face_st = _lay_out(stations, radius_m, row, foot, first[~drawn], np.flatnonzero(ends))

    mesh.taken[chosen[drawn]] = True
    mesh.points_m = np.concatenate([mesh.points_m, aims_m])
    mesh.ring = np.concatenate([mesh.ring, mesh.ring.max(initial=-1) + 1 + np.repeat(np.arange(count), SIDES)])
    mesh.faces = np.concatenate([mesh.faces, faces])
    mesh.face_st = np.concatenate([mesh.face_st, face_st + len(mesh.st_m)])
    mesh.st_m = np.concatenate([mesh.st_m, st_m])
    mesh.curve = np.concatenate([mesh.curve, curve])
    mesh.row = np.concatenate([mesh.row, np.arange(len(faces)) < len(rows)])
    mesh.taken = np.concatenate([mesh.taken, np.zeros(len(faces), bool)])
    mesh.aims_m = np.concatenate([mesh.aims_m, aims_m])
    mesh.tangent = np.concatenate([mesh.tangent, np.repeat(tangent, SIDES, axis=0)])
    swell = ring_swell(stations.curve, stations.arc_m, radius_m)
    mesh.swell = np.concatenate([mesh.swell, np.repeat(swell, SIDES, axis=0)])
    mesh.center_m = np.concatenate([mesh.center_m, np.repeat(stations.center_m, SIDES, axis=0)])
    mesh.gain = np.concatenate([mesh.gain, gain.reshape(-1)])


def _turn_to_corners(mesh: _Mesh, base: Ints, first: Ints, side: Floats, other: Floats) -> Floats:
    """(D,) by how much the first rings (D,) are turned, so that their vertices face the corners of faces (D, 4)."""
    corner_m = mesh.points_m[base]
    corner_m = corner_m - corner_m.mean(axis=1, keepdims=True)
    across = np.einsum("skc,sc->sk", corner_m, side[first]) + 1j * np.einsum("skc,sc->sk", corner_m, other[first])
    turned_back = across * np.exp(-1j * (np.pi / 4 + np.pi / 2 * np.arange(SIDES)))
    return np.asarray(np.angle(turned_back.sum(axis=1)))


def _finish(cage: BranchCage, mesh: _Mesh, skeleton: Skeleton, pieces: list[int]) -> BranchCage:
    """The cage without the faces that were taken, its limit where the axes are."""
    stays = ~mesh.taken
    points_m = pull_limit(mesh.faces[stays], mesh.aims_m, mesh.tangent, mesh.swell, mesh.center_m, ROUNDS, mesh.gain)
    number = np.cumsum(stays) - 1
    fork = np.repeat(np.arange(len(cage.fork_counts)), cage.fork_counts)
    near = stays[cage.fork_faces]
    curve = mesh.curve[stays].astype(np.int32)
    return replace(
        cage,
        points_m=points_m,
        ring=mesh.ring.astype(np.int32),
        faces=mesh.faces[stays].astype(np.int32),
        st_m=mesh.st_m,
        face_st=mesh.face_st[stays].astype(np.int32),
        curve=curve,
        order=skeleton.order[curve].astype(np.int32),
        fork_faces=number[cage.fork_faces[near]].astype(np.int32),
        fork_counts=np.bincount(fork[near], minlength=len(cage.fork_counts)).astype(np.int32),
        loose=tuple(sorted({*cage.loose, *pieces})),
    )


def _lay_out(
    stations: _Stations, radius_m: Floats, row: Ints, foot: Ints, begins: Ints, ends: Ints
) -> tuple[Floats, Ints]:
    """Texture coordinates: around on the mean radius of each twig, along its axis; caps are flat."""
    of = np.unique(stations.curve, return_inverse=True)[1]
    mean_m = np.bincount(of, weights=stations.radius_m) / np.bincount(of)
    around = mean_m[of][:, None] * (np.pi / 2 * np.arange(SIDES + 1))
    st = np.stack([around, np.broadcast_to(stations.arc_m[:, None], around.shape)], axis=-1)
    # What leads from the parent begins a radius before the first ring.
    below = st[foot] - np.array([0.0, 1.0]) * stations.radius_m[foot][:, None, None]
    column = np.arange(SIDES)
    near, far = row[:, None] * (SIDES + 1) + column, (row + 1)[:, None] * (SIDES + 1) + column
    rows = np.stack([near, near + 1, far + 1, far], axis=-1).reshape(-1, SIDES)
    low = st.shape[0] * (SIDES + 1) + np.arange(len(foot))[:, None] * (SIDES + 1) + column
    high = foot[:, None] * (SIDES + 1) + column
    lofts = np.stack([low, low + 1, high + 1, high], axis=-1).reshape(-1, SIDES)
    angle = np.pi / 4 + np.pi / 2 * np.arange(SIDES)
    flat = radius_m[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    caps_st = np.concatenate([flat[begins][:, ::-1], flat[ends]])
    at = (st.shape[0] + len(foot)) * (SIDES + 1) + np.arange(SIDES * len(caps_st)).reshape(-1, SIDES)
    return (
        np.concatenate([part.reshape(-1, 2) for part in (st, below, caps_st)]),
        np.concatenate([rows, lofts, at]).astype(np.int64),
    )


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300))
