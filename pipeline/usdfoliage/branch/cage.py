"""One closed Catmull–Clark cage over all branches of a plant, joined where they fork.

Rings of six vertices stand along every axis. Where a branch leaves, two faces of its parent are taken out, and the six
vertices round them are joined to the six of the branch. The method is our own.
"""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage_check import CageCheck, check_mesh, find_fork_crossings
from usdfoliage.branch.cage_exits import Exits, find_exits
from usdfoliage.branch.cage_faces import Faces, HolePlaces, build_faces, place_hole_vertices
from usdfoliage.branch.cage_forks import Forks, gather_forks
from usdfoliage.branch.cage_limit import pull_limit
from usdfoliage.branch.cage_places import HOLE, Holes, place_holes
from usdfoliage.branch.cage_rings import SHOULDER, Rings, Starts, build_rings
from usdfoliage.branch.cage_sectors import SIDES
from usdfoliage.branch.cage_shifts import ease_bends, move_starts
from usdfoliage.branch.cage_tubes import Floats, Ints, Path, Tubes, find_paths, pack_paths
from usdfoliage.branch.model import Skeleton

logger = logging.getLogger(__name__)

TOO_SHORT = "too short to leave its parent's surface"
NO_ROOM = "its parent has no room left for it"
CROSSES = "would cross its parent or a neighbour"
COVERED = "shorter than the row of faces in which its parent ends"
PARENT_DROPPED = "its parent was dropped"
ROUNDS = 5  # of moving the limit to where it is to be
CAP_GAIN = 0.2  # a cap's edge is round, too
SHOULDER_GAIN = 0.4  # nor is the ring before it to bulge
HOLE_GAIN = 0.0
NEAR_ENOUGH = 0.2  # of a radius: a hole this far from where its axis comes out needs no bend
SMALLER = 0.88  # times, a hole in each new attempt
FARTHER = 0.4  # radii, the first ring of its branch in each new attempt
ATTEMPTS = 6  # at a fork that crosses, before its branch is dropped
STEP = 2  # attempts that are made at once: each builds all again


@dataclass(frozen=True, kw_only=True)
class BranchCageSettings:
    """How close a cage keeps to its skeleton, in radii of the branch."""

    axis_tolerance: float = 0.01  # how far the surface may leave the axis in a bend
    longest_row: float = 24.0  # of faces along a branch
    clearance: float = 0.2  # between a parent and the first ring of a branch

    def __post_init__(self) -> None:
        if not 0 < self.axis_tolerance <= 1:
            raise ValueError(f"axis_tolerance must be above 0 and at most 1, not {self.axis_tolerance}")
        if not self.longest_row >= 1:
            raise ValueError(f"longest_row must be 1 or more, not {self.longest_row}")
        if not 0 < self.clearance <= 2:
            raise ValueError(f"clearance must be above 0 and at most 2, not {self.clearance}")


@dataclass(frozen=True, kw_only=True)
class DroppedBranch:
    """A branch that is not in the cage."""

    curve: int
    why: str


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchCage:
    """A closed mesh of quads whose Catmull–Clark limit is the surface of the branches. Metres, in the skeleton's frame.

    st is in metres: s round a branch, on its mean radius, with a seam; t along it from its first point.
    """

    points_m: NDArray[np.float64]  # (P, 3), six and six those of a ring, after them those of a hole
    faces: NDArray[np.int32]  # (F, 4), counter-clockwise from outside
    st_m: NDArray[np.float64]  # (N, 2)
    face_st: NDArray[np.int32]  # (F, 4), index of st_m at each corner
    curve: NDArray[np.int32]  # (F,), branch of the skeleton
    order: NDArray[np.int32]  # (F,), of that branch
    fork_faces: NDArray[np.int32]  # (K,), faces near each fork, one fork after another
    fork_counts: NDArray[np.int32]  # (J,)
    fork_curve: NDArray[np.int32]  # (J,), branch that leaves there
    dropped: tuple[DroppedBranch, ...]  # by branch


def build_branch_cage(skeleton: Skeleton, settings: BranchCageSettings = BranchCageSettings()) -> BranchCage:
    """Build the cage of all branches.

    A branch that ends inside its parent is left out, and what it carries leaves the parent instead. What crosses at a
    fork is tried again with a smaller hole and a longer way out; at last it is left out, and named in dropped.
    """
    paths, dropped = find_paths(skeleton)
    if not paths:
        return _empty(dropped)
    tries = np.zeros(len(skeleton), np.int64)
    while True:
        exits, tubes, holes = _settle(paths, tries, settings, dropped)
        built = _build(tubes, exits, holes, settings, skeleton)
        pairs = find_fork_crossings(built.points_m, built.faces.faces, built.forks.faces, built.forks.counts)
        if not len(pairs):
            break
        guilty = _guilty(built, pairs)
        logger.debug("%d pairs of faces cross, %d forks are tried again", len(pairs), len(guilty))
        tries[_leading(tubes, exits)[holes.exit[guilty]]] += STEP
    _name_dropped(tubes, exits, holes, tries, dropped)
    for branch in set(tubes.piece_branch.tolist()) - set(built.faces.curve.tolist()):
        dropped.setdefault(branch, COVERED)
    return _finish(built, skeleton, dropped)


def check_cage(cage: BranchCage) -> CageCheck:
    """Check that a cage is closed, oriented, manifold and does not cross itself at forks."""
    return check_mesh(cage.points_m, cage.faces, cage.fork_faces, cage.fork_counts)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Built:
    holes: Holes
    points_m: Floats
    faces: Faces
    forks: Forks


def _settle(
    paths: list[Path], tries: Ints, settings: BranchCageSettings, dropped: dict[int, str]
) -> tuple[Exits, Tubes, Holes]:
    """Find a place for every hole, and bend the branches to where their holes are. Paths change in place."""
    for last in (False, False, True):
        tubes, exits = _leave_parents(paths, tries, settings, dropped)
        again = tries[_leading(tubes, exits)]
        start_m: Floats = SHOULDER * tubes.radius_m[tubes.first]  # of roots, whose feet are rounded
        start_m[exits.tube] = exits.free_arc_m
        scale: Floats = SMALLER ** again.astype(np.float64)
        holes = place_holes(tubes, exits, start_m, again < ATTEMPTS, scale)
        slid_m = holes.arc_m - exits.hole_arc_m[holes.exit]
        far = np.abs(slid_m) > NEAR_ENOUGH * np.minimum(exits.parent_radius_m, 2 * exits.radius_m)[holes.exit]
        if last or not far.any():
            break
        along_m = np.zeros(len(tubes))
        along_m[exits.tube[holes.exit[far]]] = slid_m[far]
        move_starts(paths, along_m, start_m)
    return exits, tubes, holes


def _leave_parents(
    paths: list[Path], tries: Ints, settings: BranchCageSettings, dropped: dict[int, str]
) -> tuple[Tubes, Exits]:
    """Find how the tubes leave their parents; those that do not are passed through by what they carry."""
    while True:
        ease_bends(paths)
        tubes = pack_paths(paths)
        children = np.flatnonzero(tubes.parent >= 0)
        leading = tubes.piece_branch[np.searchsorted(tubes.piece_tube, children)]
        clearance: Floats = settings.clearance + FARTHER * tries[leading].astype(np.float64)
        exits = find_exits(tubes, children, clearance)
        inside = set(children[~exits.reached].tolist())
        if not inside:
            return tubes, exits
        for number in sorted(inside):
            for branch, _ in paths[number].pieces:
                dropped[branch] = TOO_SHORT
        for path in paths:
            while path.parent in inside:
                path.leave_instead(paths[path.parent])
        kept = [number for number in range(len(paths)) if number not in inside]
        renumbered = {old: new for new, old in enumerate(kept)} | {-1: -1}
        paths[:] = [paths[number] for number in kept]
        for path in paths:
            path.parent = renumbered[path.parent]


def _leading(tubes: Tubes, exits: Exits) -> Ints:
    """(C,) first branch of each tube that leaves a parent."""
    return tubes.piece_branch[np.searchsorted(tubes.piece_tube, exits.tube)]


def _name_dropped(tubes: Tubes, exits: Exits, holes: Holes, tries: Ints, dropped: dict[int, str]) -> None:
    """Add the branches without a hole, and why."""
    lost: dict[int, str] = {}
    for number in np.flatnonzero(tries[_leading(tubes, exits)] >= ATTEMPTS).tolist():
        lost[int(exits.tube[number])] = CROSSES
    for number in holes.homeless.tolist():
        lost.setdefault(int(exits.tube[number]), NO_ROOM)
    for tube, parent in zip(exits.tube.tolist(), exits.parent.tolist(), strict=True):
        if parent in lost:
            lost.setdefault(tube, PARENT_DROPPED)
    for branch, tube in zip(tubes.piece_branch.tolist(), tubes.piece_tube.tolist(), strict=True):
        if tube in lost:
            dropped[branch] = lost[tube]


def _build(tubes: Tubes, exits: Exits, holes: Holes, settings: BranchCageSettings, skeleton: Skeleton) -> _Built:
    """The mesh with these holes."""
    alive = tubes.parent < 0
    child = exits.tube[holes.exit]
    alive[child] = True
    start_m = np.zeros(len(tubes))
    start_m[exits.tube] = exits.free_arc_m
    radius_m, spacing_m = np.full(len(tubes), np.inf), 1.2 * tubes.radius_m[tubes.first]
    radius_m[child] = np.minimum(exits.free_radius_m[holes.exit], holes.half_across_m / HOLE)
    spacing_m[exits.tube] = 1.2 * exits.free_radius_m
    starts = Starts(alive=alive, arc_m=start_m, radius_m=radius_m, spacing_m=spacing_m)
    rings = build_rings(tubes, starts, holes, settings.axis_tolerance, settings.longest_row)
    places = place_hole_vertices(tubes, holes)
    faces = build_faces(tubes, rings, holes, places, child, _mean_radii(skeleton))
    return _Built(
        holes=holes,
        points_m=_pull(rings, places, faces, tubes.parent < 0),
        faces=faces,
        forks=gather_forks(tubes, exits, holes, rings, faces),
    )


def _pull(rings: Rings, places: HolePlaces, faces: Faces, roots: NDArray[np.bool_]) -> Floats:
    """Vertices of the cage: of the rings, then of the holes."""
    rows = len(rings.tube) * SIDES
    holes = places.points_m.reshape(-1, 3)
    same = np.diff(rings.tube) == 0
    growth = np.zeros(len(rings.tube))
    step, change = np.diff(rings.arc_m), np.diff(rings.radius_m)
    growth[:-1][same] = (change / rings.radius_m[:-1] / np.where(same, step, 1))[same]
    behind = np.zeros(len(rings.tube))
    behind[1:][same] = (change / rings.radius_m[1:] / np.where(same, step, 1))[same]
    swell = np.zeros((rows + len(holes), 2))
    swell[:rows] = np.repeat(np.stack([growth, behind], axis=1), SIDES, axis=0)
    center, tangent = np.zeros((2, rows + len(holes), 3))
    center[:rows] = np.repeat(rings.center_m, SIDES, axis=0)
    tangent[:rows] = np.repeat(rings.tangent, SIDES, axis=0)
    gain = np.ones(rows + len(holes))
    gain[rows:] = HOLE_GAIN
    by_ring = gain[:rows].reshape(-1, SIDES)
    feet = rings.first[roots[rings.tube[rings.first]]]
    by_ring[np.concatenate([rings.last - 1, feet + 1])] = SHOULDER_GAIN
    by_ring[np.concatenate([rings.last, feet])] = CAP_GAIN
    aims = np.concatenate([rings.points_m.reshape(-1, 3), holes])
    return pull_limit(faces.faces, aims, tangent, swell, center, ROUNDS, gain)


def _guilty(built: _Built, pairs: Ints) -> Ints:
    """The holes to try again: of two that cross each other the thinner, else the one that crosses its parent."""
    owner = built.forks.owner
    fork = np.repeat(np.arange(len(built.forks.counts)), built.forks.counts)
    one, two = owner[pairs[:, 0]], owner[pairs[:, 1]]
    size = built.holes.half_across_m
    both = (one >= 0) & (two >= 0)
    thinner = np.where(size[one] < size[two], one, two)
    single = np.maximum(one, two)
    single = np.where(single < 0, fork[pairs[:, 0]], single)
    return np.unique(np.where(both, thinner, single))


def _mean_radii(skeleton: Skeleton) -> Floats:
    """(B,) radius of each branch, mean along it."""
    steps = np.linalg.norm(np.diff(skeleton.points_m, axis=0, append=skeleton.points_m[-1:]), axis=1)
    steps[skeleton.first + skeleton.counts - 1] = 0
    middle = (skeleton.radius_m + np.append(skeleton.radius_m[1:], 0)) / 2
    length = np.add.reduceat(steps, skeleton.first)
    plain = np.add.reduceat(skeleton.radius_m, skeleton.first) / skeleton.counts
    weighted = np.add.reduceat(steps * middle, skeleton.first) / np.where(length > 0, length, 1)
    return np.where(length > 0, weighted, plain)


def _finish(built: _Built, skeleton: Skeleton, dropped: dict[int, str]) -> BranchCage:
    if dropped:
        logger.info("%d of %d branches are not in the cage", len(dropped), len(skeleton))
    return BranchCage(
        points_m=built.points_m,
        faces=built.faces.faces.astype(np.int32),
        st_m=built.faces.st_m,
        face_st=built.faces.face_st.astype(np.int32),
        curve=built.faces.curve.astype(np.int32),
        order=skeleton.order[built.faces.curve].astype(np.int32),
        fork_faces=built.forks.faces.astype(np.int32),
        fork_counts=built.forks.counts.astype(np.int32),
        fork_curve=built.faces.curve[built.faces.loft_face[:, 0]].astype(np.int32),
        dropped=tuple(DroppedBranch(curve=curve, why=dropped[curve]) for curve in sorted(dropped)),
    )


def _empty(dropped: dict[int, str]) -> BranchCage:
    none = np.zeros(0, np.int32)
    return BranchCage(
        points_m=np.zeros((0, 3)),
        faces=none.reshape(0, 4),
        st_m=np.zeros((0, 2)),
        face_st=none.reshape(0, 4),
        curve=none,
        order=none,
        fork_faces=none,
        fork_counts=none,
        fork_curve=none,
        dropped=tuple(DroppedBranch(curve=curve, why=dropped[curve]) for curve in sorted(dropped)),
    )
