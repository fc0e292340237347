"""One closed Catmull–Clark cage over all branches of a plant, joined where they fork.

Rings of six vertices stand along every axis. Where a branch leaves, two faces of its parent are taken out, and the six
vertices round them are joined to the six of the branch. The method is our own.
"""

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage.check import CageCheck, check_mesh
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.join import join_branches
from usdfoliage.branch.cage.layout import Layout
from usdfoliage.branch.cage.mesh import Built
from usdfoliage.branch.cage.pieces import LoosePieces, StandingWood, cut_loose
from usdfoliage.branch.cage.rings import NO_MARKS, RingMarks
from usdfoliage.branch.cage.sectors import SIDES
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.model import Skeleton

logger = logging.getLogger(__name__)

PIECE_ROUNDS = 3  # of pieces that are cut loose from pieces
_AT_FORKS = (DropReason.CROSSES, DropReason.NO_ROOM, DropReason.PARENT_DROPPED)  # these become pieces of their own


@dataclass(frozen=True, kw_only=True)
class DroppedBranch:
    """A branch that is not in the cage."""

    curve: int
    reason: DropReason


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchCage:
    """A closed mesh of quads whose Catmull–Clark limit is the surface of the branches. Metres, in the skeleton's frame.

    st is in metres: s round a branch, on its mean radius, with a seam; t along it from its first point.
    """

    points_m: NDArray[np.float64]  # (P, 3)
    ring: NDArray[np.int32]  # (P,), number of the ring, or of the hole, that a point is of
    faces: NDArray[np.int32]  # (F, 4), counter-clockwise from outside
    st_m: NDArray[np.float64]  # (N, 2)
    face_st: NDArray[np.int32]  # (F, 4), index of st_m at each corner
    curve: NDArray[np.int32]  # (F,), branch of the skeleton
    order: NDArray[np.int32]  # (F,), of that branch
    fork_faces: NDArray[np.int32]  # (K,), faces near each fork, one fork after another
    fork_counts: NDArray[np.int32]  # (J,)
    fork_curve: NDArray[np.int32]  # (J,), branch that leaves there
    dropped: tuple[DroppedBranch, ...]  # by branch
    loose: tuple[int, ...] = ()  # branches that begin a closed piece of their own, inside what they spring from
    tries: NDArray[np.int64] | None = None  # (B,), of the fork of each branch; none where it is not known, as in files


def build_branch_cage(
    skeleton: Skeleton,
    settings: BranchCageSettings = BranchCageSettings(),
    marks: RingMarks = NO_MARKS,
    tried: NDArray[np.int64] | None = None,
) -> BranchCage:
    """Build the cage of all branches, with rings at the marks where there is room.

    A branch that ends inside its parent is left out, named in dropped, and what it carries leaves the parent instead.
    What crosses at a fork is tried again with a smaller hole and a longer way out; at last it becomes a closed piece of
    its own that runs into its parent, named in loose, with all that it carries.

    Args:
        skeleton: B branches; metres.
        settings: How close the cage keeps to the axes.
        marks: Where rings are wanted.
        tried: (B,) the tries of a cage of much the same branches: it takes less time.
    """
    cage = _build_joined(skeleton, settings, marks, tried)
    for number in range(PIECE_ROUNDS):
        lost = np.zeros(len(skeleton), bool)
        lost[[each.curve for each in cage.dropped if each.reason in _AT_FORKS]] = True
        joined = np.ones(len(skeleton), bool)
        joined[[each.curve for each in cage.dropped]] = False
        wood = StandingWood(points_m=cage.points_m, faces=cage.faces) if len(cage.faces) else None
        pieces = cut_loose(skeleton, lost, joined, wood, alone=number == PIECE_ROUNDS - 1)
        if pieces is None:
            break
        cage = _with_pieces(cage, _build_joined(pieces.skeleton, settings), pieces, skeleton)
    return cage


def _with_pieces(cage: BranchCage, other: BranchCage, pieces: LoosePieces, skeleton: Skeleton) -> BranchCage:
    """A cage and that of pieces beside it, as one mesh."""
    points, faces, corners = len(cage.points_m), len(cage.faces), len(cage.st_m)
    rings = int(cage.ring.max(initial=-1)) + 1
    saved = set(pieces.curve.tolist()) - {int(pieces.curve[each.curve]) for each in other.dropped}
    roots = set(pieces.curve[pieces.skeleton.parent_curve < 0].tolist())
    reasons = {each.curve: each.reason for each in cage.dropped if each.curve not in saved}
    reasons.update({int(pieces.curve[each.curve]): each.reason for each in other.dropped})
    curve = pieces.curve[other.curve]
    return BranchCage(
        points_m=np.concatenate([cage.points_m, other.points_m]),
        ring=np.concatenate([cage.ring, other.ring + rings]).astype(np.int32),
        faces=np.concatenate([cage.faces, other.faces + points]).astype(np.int32),
        st_m=np.concatenate([cage.st_m, other.st_m]),
        face_st=np.concatenate([cage.face_st, other.face_st + corners]).astype(np.int32),
        curve=np.concatenate([cage.curve, curve]),
        order=np.concatenate([cage.order, skeleton.order[curve]]).astype(np.int32),
        fork_faces=np.concatenate([cage.fork_faces, other.fork_faces + faces]).astype(np.int32),
        fork_counts=np.concatenate([cage.fork_counts, other.fork_counts]),
        fork_curve=np.concatenate([cage.fork_curve, pieces.curve[other.fork_curve]]),
        dropped=tuple(DroppedBranch(curve=each, reason=reasons[each]) for each in sorted(reasons)),
        loose=tuple(sorted({*cage.loose, *(saved & roots)})),
        tries=cage.tries,
    )


def _build_joined(
    skeleton: Skeleton,
    settings: BranchCageSettings,
    marks: RingMarks = NO_MARKS,
    tried: NDArray[np.int64] | None = None,
) -> BranchCage:
    """The cage of the branches that can be joined."""
    joined = join_branches(skeleton, settings, marks, tried)
    if joined.built is None or joined.layout is None:
        return replace(_empty(joined.dropped), tries=joined.tries)
    return replace(_finish(joined.built, joined.layout, skeleton, joined.dropped), tries=joined.tries)


def check_cage(cage: BranchCage) -> CageCheck:
    """Check that a cage is closed, oriented, manifold and does not cross itself at forks."""
    return check_mesh(cage.points_m, cage.faces, cage.fork_faces, cage.fork_counts)


def _finish(built: Built, layout: Layout, skeleton: Skeleton, dropped: dict[int, DropReason]) -> BranchCage:
    if dropped:
        logger.info("%d of %d branches are not in the cage", len(dropped), len(skeleton))
    return BranchCage(
        points_m=built.points_m,
        ring=(np.arange(len(built.points_m)) // SIDES).astype(np.int32),
        faces=built.faces.faces.astype(np.int32),
        st_m=layout.st_m,
        face_st=layout.face_st.astype(np.int32),
        curve=layout.curve.astype(np.int32),
        order=skeleton.order[layout.curve].astype(np.int32),
        fork_faces=built.forks.faces.astype(np.int32),
        fork_counts=built.forks.counts.astype(np.int32),
        fork_curve=layout.curve[built.faces.loft_face[:, 0]].astype(np.int32),
        dropped=tuple(DroppedBranch(curve=curve, reason=dropped[curve]) for curve in sorted(dropped)),
    )


def _empty(dropped: dict[int, DropReason]) -> BranchCage:
    none = np.zeros(0, np.int32)
    return BranchCage(
        points_m=np.zeros((0, 3)),
        ring=none,
        faces=none.reshape(0, 4),
        st_m=np.zeros((0, 2)),
        face_st=none.reshape(0, 4),
        curve=none,
        order=none,
        fork_faces=none,
        fork_counts=none,
        fork_curve=none,
        dropped=tuple(DroppedBranch(curve=curve, reason=dropped[curve]) for curve in sorted(dropped)),
    )
