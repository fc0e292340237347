"""Joining all branches of a plant in one mesh: forks that cross are tried again, and at last given up.

The method is our own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.exits import Exits
from usdfoliage.branch.cage.holes import Holes
from usdfoliage.branch.cage.layout import Layout, lay_out_faces
from usdfoliage.branch.cage.mesh import Built, build_paths, find_guilty
from usdfoliage.branch.cage.rings import NO_MARKS, RingMarks
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.settle import ATTEMPTS, find_beside, leading, take_around
from usdfoliage.branch.cage.tubes import Floats, Ints, Path, Tubes, find_paths
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree

STEP = 1  # attempts that are made at once


@dataclass(frozen=True, kw_only=True, eq=False)
class Joined:
    """The mesh of the branches that could be joined."""

    built: Built | None  # none where no branch has a length
    layout: Layout | None
    dropped: dict[int, DropReason]  # branches that are not in it, and why
    tries: Ints  # (B,), of the fork at which each branch leaves its parent


@dataclass(frozen=True, kw_only=True, eq=False)
class _Work:
    """What does not change from mesh to mesh, but for the tries."""

    tries: Ints  # (B,)
    settings: BranchCageSettings
    carried_m: Floats  # (B,), length of all that a branch carries and its own
    marks: RingMarks

    def build(
        self, paths: list[Path], dropped: dict[int, DropReason], moving: NDArray[np.bool_] | None = None
    ) -> tuple[Built, Ints]:
        """The mesh of these paths, which change in place, and the holes to try again."""
        built = build_paths(paths, self.tries, self.settings, dropped, moving, self.marks)
        return built, find_guilty(built, self.carried_m)


def join_branches(
    skeleton: Skeleton, settings: BranchCageSettings, marks: RingMarks = NO_MARKS, tried: Ints | None = None
) -> Joined:
    """Build the branches that can be joined, with rings at the marks where there is room.

    Args:
        skeleton: B branches.
        settings: How close the mesh keeps to the axes.
        marks: Where rings are wanted.
        tried: (B,) how often forks were tried in a mesh of much the same branches, so that they need not be again.
    """
    paths, dropped = find_paths(skeleton)
    tries = np.zeros(len(skeleton), np.int64) if tried is None else tried.copy()
    if not paths:
        return Joined(built=None, layout=None, dropped=dropped, tries=tries)
    work = _Work(
        tries=tries,
        settings=settings,
        carried_m=RootedTree(skeleton.parent_curve).sum_above(skeleton.lengths_m),
        marks=marks,
    )
    built, guilty = work.build(paths, dropped)
    while len(guilty):
        before = tries.copy()
        _try_around(paths, built, guilty, work)
        # What is far from all that was changed stays as it is, or there would be no end to what crosses anew.
        first = leading(built.tubes, built.exits)
        near = find_beside(built.tubes, built.exits, np.flatnonzero(tries[first] != before[first]))
        moving = np.zeros(len(skeleton), bool)
        moving[first[near]] = True
        built, guilty = work.build(paths, dropped, moving)
    _name_dropped(built.tubes, built.exits, built.holes, tries, dropped)
    layout = lay_out_faces(built.tubes, built.rings, built.holes, built.places, built.faces, _mean_radii(skeleton))
    for branch in set(built.tubes.piece_branch.tolist()) - set(layout.curve.tolist()):
        dropped.setdefault(branch, DropReason.COVERED)
    return Joined(built=built, layout=layout, dropped=dropped, tries=tries)


def _try_around(paths: list[Path], built: Built, guilty: Ints, work: _Work) -> None:
    """Raise the tries of forks until none crosses: each with what is near it, without all the rest."""
    while len(guilty):
        forks = built.holes.exit[guilty]
        work.tries[leading(built.tubes, built.exits)[forks]] += STEP
        paths = take_around(paths, built.tubes, built.exits, forks)
        built, guilty = work.build(paths, {})


def _name_dropped(tubes: Tubes, exits: Exits, holes: Holes, tries: Ints, dropped: dict[int, DropReason]) -> None:
    """Add the branches without a hole, and why."""
    lost: dict[int, DropReason] = {}
    for number in np.flatnonzero(tries[leading(tubes, exits)] >= ATTEMPTS).tolist():
        lost[int(exits.tube[number])] = DropReason.CROSSES
    for number in holes.homeless.tolist():
        lost.setdefault(int(exits.tube[number]), DropReason.NO_ROOM)
    for tube, parent in zip(exits.tube.tolist(), exits.parent.tolist(), strict=True):
        if parent in lost:
            lost.setdefault(tube, DropReason.PARENT_DROPPED)
    for branch, tube in zip(tubes.piece_branch.tolist(), tubes.piece_tube.tolist(), strict=True):
        if tube in lost:
            dropped[branch] = lost[tube]


def _mean_radii(skeleton: Skeleton) -> Floats:
    """(B,) radius of each branch, mean along it."""
    steps = np.linalg.norm(np.diff(skeleton.points_m, axis=0, append=skeleton.points_m[-1:]), axis=1)
    steps[skeleton.first + skeleton.counts - 1] = 0
    middle = (skeleton.radius_m + np.append(skeleton.radius_m[1:], 0)) / 2
    length = np.add.reduceat(steps, skeleton.first)
    plain = np.add.reduceat(skeleton.radius_m, skeleton.first) / skeleton.counts
    weighted = np.add.reduceat(steps * middle, skeleton.first) / np.where(length > 0, length, 1)
    return np.where(length > 0, weighted, plain)
