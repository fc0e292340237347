"""Where the branches of a cage leave their parents: holes with a place, and axes that are bent to them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage.bending import ease_bends, move_starts, straighten_starts
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.exits import Exits, find_exits
from usdfoliage.branch.cage.holes import Holes, place_holes
from usdfoliage.branch.cage.rings import SHOULDER
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.tubes import Floats, Ints, Path, Tubes, arcs_along, pack_paths

NEAR_ENOUGH = 0.2  # of a radius: a hole this far from where its axis comes out needs no bend
SMALLER = 0.88  # times, a hole in each new attempt
FARTHER = 0.4  # radii, the first ring of its branch in each new attempt
STRAIGHT = 3  # attempts, after which a way out is made straight
TOGETHER = 6.0  # radii along a parent: forks that are nearer are tried together
ATTEMPTS = 8  # at a fork that crosses, before its branch is dropped


def settle(
    paths: list[Path],
    tries: Ints,
    settings: BranchCageSettings,
    dropped: dict[int, DropReason],
    moving: NDArray[np.bool_] | None = None,
) -> tuple[Exits, Tubes, Holes]:
    """Find a place for every hole, and bend the branches to where their holes are.

    Args:
        paths: The axes; they change in place.
        tries: (B,) how often each branch of the skeleton was tried already; of one whose hole would be too far from
            where its axis comes out it becomes ATTEMPTS.
        settings: How far branches are from their parents, and how far they are moved.
        dropped: Takes the branches that end inside their parents.
        moving: (B,) branches that may be bent to where their holes are; all where it is not given.
    """
    if (tries >= STRAIGHT).any():
        tubes, exits = _leave_parents(paths, tries, settings.clearance, dropped)
        stubborn = np.flatnonzero(tries[leading(tubes, exits)] >= STRAIGHT)
        free_m = exits.free_arc_m[stubborn].tolist()
        straighten_starts(paths, dict(zip(exits.tube[stubborn].tolist(), free_m, strict=True)))
    for last in (False, False, False, True) if settings.farthest < np.inf else (False, False, True):
        tubes, exits = _leave_parents(paths, tries, settings.clearance, dropped)
        again = tries[leading(tubes, exits)]
        start_m: Floats = SHOULDER * tubes.radius_m[tubes.first]  # of roots, whose feet are rounded
        start_m[exits.tube] = exits.free_arc_m
        scale: Floats = SMALLER ** again.astype(np.float64)
        holes = place_holes(tubes, exits, start_m, again < ATTEMPTS, scale)
        slid_m = holes.arc_m - exits.hole_arc_m[holes.exit]
        astray = np.abs(slid_m) * exits.sine[holes.exit] > settings.farthest * exits.radius_m[holes.exit]
        if not last:
            tries[leading(tubes, exits)[holes.exit[astray]]] = ATTEMPTS
        far = np.abs(slid_m) > NEAR_ENOUGH * np.minimum(exits.parent_radius_m, 2 * exits.radius_m)[holes.exit]
        far &= ~astray
        if moving is not None:
            far &= moving[leading(tubes, exits)[holes.exit]]
        if last or not (far.any() or astray.any()):
            break
        along_m = np.zeros(len(tubes))
        along_m[exits.tube[holes.exit[far]]] = slid_m[far]
        move_starts(paths, along_m, start_m)
    return exits, tubes, holes


def _leave_parents(
    paths: list[Path], tries: Ints, clearance: float, dropped: dict[int, DropReason]
) -> tuple[Tubes, Exits]:
    """Find how the tubes leave their parents; those that do not are passed through by what they carry."""
    while True:
        ease_bends(paths)
        tubes = pack_paths(paths)
        children = np.flatnonzero(tubes.parent >= 0)
        branch = tubes.piece_branch[np.searchsorted(tubes.piece_tube, children)]
        clear: Floats = clearance + FARTHER * tries[branch].astype(np.float64)
        exits = find_exits(tubes, children, clear)
        inside = set(children[~exits.reached].tolist())
        if not inside:
            return tubes, exits
        for number in sorted(inside):
            for branch, _ in paths[number].pieces:
                dropped[branch] = DropReason.TOO_SHORT
        for path in paths:
            while path.parent in inside:
                path.leave_instead(paths[path.parent])
        kept = [number for number in range(len(paths)) if number not in inside]
        renumbered = {old: new for new, old in enumerate(kept)} | {-1: -1}
        paths[:] = [paths[number] for number in kept]
        for path in paths:
            path.parent = renumbered[path.parent]


def leading(tubes: Tubes, exits: Exits) -> Ints:
    """(C,) first branch of each tube that leaves a parent."""
    return tubes.piece_branch[np.searchsorted(tubes.piece_tube, exits.tube)]


def take_around(paths: list[Path], tubes: Tubes, exits: Exits, forks: Ints) -> list[Path]:
    """The paths round some forks (G,) of the exits by themselves, so that they can be tried without all others.

    These are the parents, and what leaves them near these forks. Paths are copies. One whose own parent is left out
    begins where it is clear of it.
    """
    near = find_beside(tubes, exits, forks)
    alone = np.zeros(len(paths), bool)
    alone[exits.tube[near]] = alone[exits.parent[near]] = True
    chosen = np.flatnonzero(alone)
    number = {int(old): new for new, old in enumerate(chosen)}
    free_m = np.zeros(len(paths))
    free_m[exits.tube] = exits.free_arc_m
    cut_m = {}
    taken = []
    for old in chosen.tolist():
        path = replace(paths[old], pieces=list(paths[old].pieces))
        if path.parent >= 0 and path.parent not in number:
            cut_m[old] = _begin_at(path, float(free_m[old]))
        path.parent_arc_m = max(0.0, path.parent_arc_m - cut_m.get(path.parent, 0.0))
        path.parent = number.get(path.parent, -1)
        taken.append(path)
    return taken


def find_beside(tubes: Tubes, exits: Exits, forks: Ints) -> NDArray[np.bool_]:
    """(C,) which exits are on the parent of one of these (G,) and near it, themselves among them."""
    arc, reach = exits.hole_arc_m, TOGETHER * exits.parent_radius_m[forks]
    key, line = exits.parent * tubes.stride_m + arc, exits.parent[forks] * tubes.stride_m
    order = np.argsort(key, kind="stable")
    low = np.searchsorted(key[order], line + np.maximum(arc[forks] - reach, 0), side="left")
    high = np.searchsorted(
        key[order], line + np.minimum(arc[forks] + reach, tubes.length_m[exits.parent[forks]]), side="right"
    )
    covered = np.zeros(len(arc) + 1, np.int64)
    np.add.at(covered, low, 1)
    np.add.at(covered, high, -1)
    near = np.zeros(len(arc), bool)
    near[order] = np.cumsum(covered)[:-1] > 0
    near[forks] = True
    return near


def _begin_at(path: Path, free_m: float) -> float:
    """Cut a path's start off, in place, so that as a root it has room for holes from this arc on; what was cut."""
    arc_m = arcs_along(path.points_m)
    radius = float(np.interp(free_m, arc_m, path.radius_m))
    cut_m = float(np.clip(free_m - SHOULDER * radius, 0.0, 0.5 * arc_m[-1]))
    later = arc_m > cut_m + 1e-3 * radius
    start = [[np.interp(cut_m, arc_m, column) for column in path.points_m.T]]
    path.points_m = np.concatenate([start, path.points_m[later]])
    path.radius_m = np.concatenate([[np.interp(cut_m, arc_m, path.radius_m)], path.radius_m[later]])
    path.pieces = [(branch, from_m - cut_m) for branch, from_m in path.pieces]
    path.eased = False
    return cut_m
