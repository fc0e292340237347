"""One closed Catmull–Clark cage over all branches of a plant, joined where they fork.

Rings of six vertices stand along every axis. Where a branch leaves, two faces of its parent are taken out, and the six
vertices round them are joined to the six of the branch. The method is our own.
"""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage_check import CageCheck, check_mesh, find_fork_crossings
from usdfoliage.branch.cage_exits import Exits
from usdfoliage.branch.cage_faces import Faces, HolePlaces, build_faces, place_hole_vertices
from usdfoliage.branch.cage_forks import Forks, gather_forks
from usdfoliage.branch.cage_limit import pull_limit
from usdfoliage.branch.cage_pieces import LoosePieces, cut_loose
from usdfoliage.branch.cage_places import HOLE, Holes
from usdfoliage.branch.cage_rings import Rings, Starts, build_rings
from usdfoliage.branch.cage_sectors import SIDES
from usdfoliage.branch.cage_settle import ATTEMPTS, find_beside, leading, settle, take_around
from usdfoliage.branch.cage_tubes import Floats, Ints, Path, Tubes, find_paths
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree

logger = logging.getLogger(__name__)

NO_ROOM = "its parent has no room left for it"
CROSSES = "would cross its parent or a neighbour"
COVERED = "shorter than the row of faces in which its parent ends"
PARENT_DROPPED = "its parent was dropped"
ROUNDS = 5  # of moving the limit to where it is to be
CAP_GAIN = 0.2  # a cap's edge is round, too
SHOULDER_GAIN = 0.4  # nor is the ring before it to bulge
HOLE_GAIN = 0.0
PIECE_ROUNDS = 3  # of pieces that are cut loose from pieces
STEP = 1  # attempts that are made at once


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
    loose: tuple[int, ...] = ()  # branches that begin a closed piece of their own, beside what they spring from


def build_branch_cage(skeleton: Skeleton, settings: BranchCageSettings = BranchCageSettings()) -> BranchCage:
    """Build the cage of all branches.

    A branch that ends inside its parent is left out, named in dropped, and what it carries leaves the parent instead.
    What crosses at a fork is tried again with a smaller hole and a longer way out; at last it becomes a closed piece of
    its own that begins beside its parent, named in loose, with all that it carries.
    """
    cage = _build_joined(skeleton, settings)
    for _ in range(PIECE_ROUNDS):
        lost = np.zeros(len(skeleton), bool)
        lost[[each.curve for each in cage.dropped if each.why in (CROSSES, NO_ROOM, PARENT_DROPPED)]] = True
        joined = np.ones(len(skeleton), bool)
        joined[[each.curve for each in cage.dropped]] = False
        pieces = cut_loose(skeleton, lost, joined)
        if pieces is None:
            break
        before = len(cage.dropped)
        cage = _with_pieces(cage, _build_joined(pieces.skeleton, settings), pieces, skeleton)
        if len(cage.dropped) == before:
            break
    return cage


def _with_pieces(cage: BranchCage, other: BranchCage, pieces: LoosePieces, skeleton: Skeleton) -> BranchCage:
    """A cage and that of pieces beside it, as one mesh."""
    points, faces, corners = len(cage.points_m), len(cage.faces), len(cage.st_m)
    saved = set(pieces.curve.tolist()) - {int(pieces.curve[each.curve]) for each in other.dropped}
    roots = set(pieces.curve[pieces.skeleton.parent_curve < 0].tolist())
    why = {each.curve: each.why for each in cage.dropped if each.curve not in saved}
    why.update({int(pieces.curve[each.curve]): each.why for each in other.dropped})
    curve = pieces.curve[other.curve]
    return BranchCage(
        points_m=np.concatenate([cage.points_m, other.points_m]),
        faces=np.concatenate([cage.faces, other.faces + points]).astype(np.int32),
        st_m=np.concatenate([cage.st_m, other.st_m]),
        face_st=np.concatenate([cage.face_st, other.face_st + corners]).astype(np.int32),
        curve=np.concatenate([cage.curve, curve]),
        order=np.concatenate([cage.order, skeleton.order[curve]]).astype(np.int32),
        fork_faces=np.concatenate([cage.fork_faces, other.fork_faces + faces]).astype(np.int32),
        fork_counts=np.concatenate([cage.fork_counts, other.fork_counts]),
        fork_curve=np.concatenate([cage.fork_curve, pieces.curve[other.fork_curve]]),
        dropped=tuple(DroppedBranch(curve=each, why=why[each]) for each in sorted(why)),
        loose=tuple(sorted({*cage.loose, *(saved & roots)})),
    )


def _build_joined(skeleton: Skeleton, settings: BranchCageSettings) -> BranchCage:
    """The cage of the branches that can be joined."""
    paths, dropped = find_paths(skeleton)
    if not paths:
        return _empty(dropped)
    tries = np.zeros(len(skeleton), np.int64)
    mean_radius_m = _mean_radii(skeleton)
    carried_m = RootedTree(skeleton.parent_curve).sum_above(skeleton.lengths_m)
    built = _build(paths, tries, settings, mean_radius_m, dropped)
    guilty = _find_guilty(built, carried_m)
    while len(guilty):
        before = tries.copy()
        _try_around(paths, built, guilty, tries, settings, mean_radius_m, carried_m)
        # What is far from all that was changed stays as it is, or there would be no end to what crosses anew.
        first = leading(built.tubes, built.exits)
        near = find_beside(built.tubes, built.exits, np.flatnonzero(tries[first] != before[first]))
        moving = np.zeros(len(skeleton), bool)
        moving[first[near]] = True
        built = _build(paths, tries, settings, mean_radius_m, dropped, moving)
        guilty = _find_guilty(built, carried_m)
    _name_dropped(built.tubes, built.exits, built.holes, tries, dropped)
    for branch in set(built.tubes.piece_branch.tolist()) - set(built.faces.curve.tolist()):
        dropped.setdefault(branch, COVERED)
    return _finish(built, skeleton, dropped)


def check_cage(cage: BranchCage) -> CageCheck:
    """Check that a cage is closed, oriented, manifold and does not cross itself at forks."""
    return check_mesh(cage.points_m, cage.faces, cage.fork_faces, cage.fork_counts)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Built:
    tubes: Tubes
    exits: Exits
    holes: Holes
    points_m: Floats
    faces: Faces
    forks: Forks


def _try_around(
    paths: list[Path],
    built: _Built,
    guilty: Ints,
    tries: Ints,
    settings: BranchCageSettings,
    mean_radius_m: Floats,
    carried_m: Floats,
) -> None:
    """Raise the tries of forks until none crosses: each with what is near it, without all the rest."""
    before = tries.copy()
    first = leading(built.tubes, built.exits)
    whole, some = built, paths
    while True:
        while len(guilty):
            tries[leading(built.tubes, built.exits)[built.holes.exit[guilty]]] += STEP
            some = take_around(some, built.tubes, built.exits, built.holes.exit[guilty])
            built = _build(some, tries, settings, mean_radius_m, {})
            guilty = _find_guilty(built, carried_m)
        # Each was left alone once it did not cross: now all that were tried together.
        some = take_around(paths, whole.tubes, whole.exits, np.flatnonzero(tries[first] != before[first]))
        before = tries.copy()
        built = _build(some, tries, settings, mean_radius_m, {})
        guilty = _find_guilty(built, carried_m)
        if not len(guilty):
            return


def _name_dropped(tubes: Tubes, exits: Exits, holes: Holes, tries: Ints, dropped: dict[int, str]) -> None:
    """Add the branches without a hole, and why."""
    lost: dict[int, str] = {}
    for number in np.flatnonzero(tries[leading(tubes, exits)] >= ATTEMPTS).tolist():
        lost[int(exits.tube[number])] = CROSSES
    for number in holes.homeless.tolist():
        lost.setdefault(int(exits.tube[number]), NO_ROOM)
    for tube, parent in zip(exits.tube.tolist(), exits.parent.tolist(), strict=True):
        if parent in lost:
            lost.setdefault(tube, PARENT_DROPPED)
    for branch, tube in zip(tubes.piece_branch.tolist(), tubes.piece_tube.tolist(), strict=True):
        if tube in lost:
            dropped[branch] = lost[tube]


def _build(
    paths: list[Path],
    tries: Ints,
    settings: BranchCageSettings,
    mean_radius_m: Floats,
    dropped: dict[int, str],
    moving: NDArray[np.bool_] | None = None,
) -> _Built:
    """The mesh of these paths, which change in place."""
    exits, tubes, holes = settle(paths, tries, settings.clearance, dropped, moving)
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
    faces = build_faces(tubes, rings, holes, places, child, mean_radius_m)
    return _Built(
        tubes=tubes,
        exits=exits,
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


def _find_guilty(built: _Built, carried_m: Floats) -> Ints:
    """The holes to try again: of two that cross the one that carries less, else the one that crosses its parent."""
    pairs = find_fork_crossings(built.points_m, built.faces.faces, built.forks.faces, built.forks.counts)
    owner = built.forks.owner
    fork = np.repeat(np.arange(len(built.forks.counts)), built.forks.counts)
    one, two = owner[pairs[:, 0]], owner[pairs[:, 1]]
    size = carried_m[leading(built.tubes, built.exits)[built.holes.exit]]
    both = (one >= 0) & (two >= 0)
    lesser = np.where(size[one] < size[two], one, two)
    single = np.maximum(one, two)
    single = np.where(single < 0, fork[pairs[:, 0]], single)
    guilty = np.unique(np.where(both, lesser, single))
    logger.debug("of %d forks %d cross", len(built.holes.exit), len(guilty))
    return guilty


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
