"""Axes changed so that tubes can be swept along them: bent to where their holes are, eased where they are too tight."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.branch.cage.tubes import Floats, Path, arcs_along

FADES_OVER = 3.0  # lengths of the move, over which the axis comes back to where it was
SAMPLES = 8  # points there
NEXT = 0.02  # of that way: no new point is nearer to an old one
TIGHT = 1.25  # half the angle of a bend takes its tangent in radii of length on both sides, and so much more
MAX_PASSES = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class _Moved:
    """What a path was and is, by its old arcs; n points."""

    old_arc_m: Floats  # (n,)
    old_points_m: Floats  # (n, 3)
    moved_m: Floats  # (n, 3)
    new_arc_m: Floats  # (n,)


def move_starts(paths: list[Path], along_m: Floats, kept_m: Floats) -> None:
    """Move the starts of paths along their parents, in place.

    A path keeps its shape up to where it is free of its parent, and fades back to its old place from there on; what it
    carries goes with it.

    Args:
        paths: Parents before children.
        along_m: (T,) by how much, towards the parent's tip.
        kept_m: (T,) arc up to which a path keeps its shape.
    """
    moved: dict[int, _Moved] = {}
    parent_arcs: dict[int, Floats] = {}  # arcs of the parents that stay
    for number, path in enumerate(paths):
        if path.parent < 0 or (along_m[number] == 0 and path.parent not in moved):
            continue
        parent = paths[path.parent]
        before = moved.get(path.parent)
        if before is None and path.parent not in parent_arcs:
            parent_arcs[path.parent] = arcs_along(parent.points_m)
        old_arc = before.old_arc_m if before else parent_arcs[path.parent]
        old_points = before.old_points_m if before else parent.points_m
        target = float(min(max(path.parent_arc_m + along_m[number], 0.0), old_arc[-1]))
        step = _at(old_arc, old_points, target) - _at(old_arc, old_points, path.parent_arc_m)
        path.parent_arc_m = target
        if before:
            path.parent_arc_m = float(np.interp(target, before.old_arc_m, before.new_arc_m))
            step = step + _at(before.old_arc_m, before.moved_m, target)
        size = float(np.linalg.norm(step))
        if size > 1e-3 * float(path.radius_m[0]):
            moved[number] = _bend(path, step, float(kept_m[number]), FADES_OVER * size)


def _bend(path: Path, step: Floats, kept_m: float, fade_m: float) -> _Moved:
    """Move the start of one path."""
    bent = _native.bend_start(
        path.points_m,
        path.radius_m,
        step_m=step,
        settings=_native.StartBendSettings(kept_m=kept_m, fade_m=fade_m, samples=SAMPLES, min_apart=NEXT),
    )
    path.points_m, path.radius_m, old_arc, new_arc = bent.points_m, bent.radius_m, bent.old_arc_m, bent.new_arc_m
    path.pieces = [(branch, float(np.interp(from_m, old_arc, new_arc))) for branch, from_m in path.pieces]
    path.eased = False
    return _Moved(old_arc_m=old_arc, old_points_m=path.points_m - bent.moved_m, moved_m=bent.moved_m, new_arc_m=new_arc)


def _at(arc_m: Floats, values: Floats, at_m: float) -> Floats:
    """(3,) of values (n, 3) given by arc (n,), constant beyond the ends."""
    after = min(max(int(np.searchsorted(arc_m, at_m, side="right")), 1), len(arc_m) - 1)
    share = min(max((at_m - arc_m[after - 1]) / (arc_m[after] - arc_m[after - 1]), 0.0), 1.0)
    return values[after - 1] + share * (values[after] - values[after - 1])


def ease_bends(paths: list[Path]) -> None:
    """Leave out points of axes, in place, until every segment is long enough for the bends at its ends.

    Round a bend of radius below its own no tube can be swept; zigzags finer than the radius are noise.
    """
    tight = [number for number, path in enumerate(paths) if not path.eased]
    if not tight:
        return
    counts = np.array([len(paths[number].points_m) for number in tight])
    first = np.cumsum(counts) - counts
    points = np.concatenate([paths[number].points_m for number in tight])
    radius = np.concatenate([paths[number].radius_m for number in tight])
    of = np.repeat(np.arange(len(tight)), counts)
    fixed = np.zeros(len(points), bool)
    fixed[first] = fixed[first + counts - 1] = True
    kept = np.arange(len(points))
    for _ in range(MAX_PASSES):
        drop = _too_tight(points[kept], radius[kept], of[kept], fixed[kept])
        if not drop.any():
            break
        kept = kept[~drop]
    left = np.bincount(of[kept], minlength=len(tight))
    begin = np.cumsum(left) - left
    changed = np.flatnonzero(left < counts).tolist()
    own = {k: kept[begin[k] : begin[k] + left[k]] - first[k] for k in changed}
    _keep_points(paths, {tight[k]: mine for k, mine in own.items()})
    for number in tight:
        paths[number].eased = True


def straighten_starts(paths: list[Path], upto_m: dict[int, float]) -> None:
    """Leave out points of axes (by number), in place, between their first and the one at or after this arc."""
    kept = {}
    for number, straight_m in upto_m.items():
        later = arcs_along(paths[number].points_m) >= straight_m
        later[0] = later[-1] = True
        if not later.all():
            kept[number] = np.flatnonzero(later)
            paths[number].eased = False
    _keep_points(paths, kept)


def _keep_points(paths: list[Path], kept: dict[int, NDArray[np.intp]]) -> None:
    """Leave all other points of these paths out, in place; what they carry leaves from where it was."""
    if not kept:
        return
    eased: dict[int, tuple[Floats, Floats]] = {}
    for number, mine in kept.items():
        path = paths[number]
        old_arc = arcs_along(path.points_m)[mine]
        path.points_m, path.radius_m = path.points_m[mine], path.radius_m[mine]
        eased[number] = old_arc, arcs_along(path.points_m)
        path.pieces = [(branch, float(np.interp(from_m, *eased[number]))) for branch, from_m in path.pieces]
    for path in paths:
        if path.parent in eased:
            path.parent_arc_m = float(np.interp(path.parent_arc_m, *eased[path.parent]))


def _too_tight(points: Floats, radius: Floats, of: NDArray[np.intp], fixed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which points (N,) to leave out next: of each segment that is too short the end that bends more."""
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    own = np.diff(of) == 0
    unit = step / np.where(length > 0, length, 1)[:, None]
    half = np.zeros(len(points))
    half[1:-1] = np.arcsin(np.clip(np.linalg.norm(np.diff(unit, axis=0), axis=1) / 2, 0, 1))
    half[fixed] = 0
    need = radius * np.tan(np.minimum(half, 1.5))
    short = own & (TIGHT * (need[:-1] + need[1:]) > length)
    short |= own & (length < 1e-3 * np.minimum(radius[:-1], radius[1:]))
    # The worst of its neighbourhood first: what is left bends less then.
    excess = np.where(short, (need[:-1] + need[1:]) / np.maximum(length, 1e-12), 0)
    excess = np.where(fixed[:-1] & fixed[1:], 0, excess)
    before, after = np.concatenate([[0], excess[:-1]]), np.concatenate([excess[1:], [0]])
    worst = np.flatnonzero((excess > 0) & (excess > before) & (excess >= after))
    left = (need[worst] >= need[worst + 1]) & ~fixed[worst] | fixed[worst + 1]
    drop = np.zeros(len(points), bool)
    drop[np.where(left, worst, worst + 1)] = True
    return drop & ~fixed
