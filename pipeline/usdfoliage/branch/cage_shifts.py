"""Axes changed so that tubes can be swept along them: bent to where their holes are, eased where they are too tight."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage_tubes import Floats, Path, arcs_along

FADES_OVER = 3.0  # lengths of the move, over which the axis comes back to where it was
SAMPLES = 8  # points there
TIGHT = 1.25  # half the angle of a bend takes its tangent in radii of length on both sides, and so much more
MOST_PASSES = 60


class _Moved:
    """What a path was and is, by its old arcs."""

    def __init__(self, old_arc_m: Floats, points_m: Floats, moved_m: Floats) -> None:
        self.old_arc_m = old_arc_m
        self.moved_m = moved_m
        self.new_arc_m = arcs_along(points_m)

    def arc_now(self, arc_m: float) -> float:
        return float(np.interp(arc_m, self.old_arc_m, self.new_arc_m))

    def move_at(self, arc_m: float) -> Floats:
        return np.array([np.interp(arc_m, self.old_arc_m, column) for column in self.moved_m.T])


def move_starts(paths: list[Path], along_m: Floats, held_m: Floats) -> None:
    """Move the starts of paths along their parents, in place.

    A path keeps its shape up to where it is free of its parent, and fades back to its old place from there on; what it
    carries goes with it.

    Args:
        paths: Parents before children.
        along_m: (T,) by how much, towards the parent's tip.
        held_m: (T,) arc up to which a path keeps its shape.
    """
    moved: dict[int, _Moved] = {}
    for number, path in enumerate(paths):
        if path.parent < 0 or (along_m[number] == 0 and path.parent not in moved):
            continue
        parent = paths[path.parent]
        before = moved.get(path.parent)
        old_arc = before.old_arc_m if before else arcs_along(parent.points_m)
        old_points = parent.points_m - before.moved_m if before else parent.points_m
        target = float(np.clip(path.parent_arc_m + along_m[number], 0, old_arc[-1]))
        step = _at(old_arc, old_points, target) - _at(old_arc, old_points, path.parent_arc_m)
        path.parent_arc_m = target
        if before:
            path.parent_arc_m = before.arc_now(target)
            step = step + before.move_at(target)
        size = float(np.linalg.norm(step))
        if size > 1e-3 * float(path.radius_m[0]):
            moved[number] = _bend(path, step, float(held_m[number]), FADES_OVER * size)


def _bend(path: Path, step: Floats, held_m: float, fade_m: float) -> _Moved:
    """Move the start of one path."""
    arc = arcs_along(path.points_m)
    added = held_m + fade_m * np.linspace(0, 1, SAMPLES + 1)
    added = added[added < arc[-1]]
    # No new point next to an old one: its segment would have no direction.
    apart = np.abs(added[:, None] - arc).min(axis=1) > 0.02 * fade_m
    both = np.sort(np.concatenate([arc, added[apart]]))
    share = np.clip((both - held_m) / fade_m, 0, 1)
    weight = 1 - share**2 * (3 - 2 * share)
    move = weight[:, None] * step
    path.radius_m = np.interp(both, arc, path.radius_m)
    path.points_m = np.stack([np.interp(both, arc, column) for column in path.points_m.T], axis=1) + move
    result = _Moved(both, path.points_m, move)
    path.pieces = [(branch, result.arc_now(from_m)) for branch, from_m in path.pieces]
    return result


def _at(arc_m: Floats, points: Floats, at_m: float) -> Floats:
    return np.array([np.interp(at_m, arc_m, column) for column in points.T])


def ease_bends(paths: list[Path]) -> None:
    """Leave out points of axes, in place, until every segment is long enough for the bends at its ends.

    Round a bend of radius below its own no tube can be swept; zigzags finer than the radius are noise.
    """
    if not paths:
        return
    counts = np.array([len(path.points_m) for path in paths])
    first = np.cumsum(counts) - counts
    points = np.concatenate([path.points_m for path in paths])
    radius = np.concatenate([path.radius_m for path in paths])
    of = np.repeat(np.arange(len(paths)), counts)
    fixed = np.zeros(len(points), bool)
    fixed[first] = fixed[first + counts - 1] = True
    kept = np.arange(len(points))
    for _ in range(MOST_PASSES):
        drop = _too_tight(points[kept], radius[kept], of[kept], fixed[kept])
        if not drop.any():
            break
        kept = kept[~drop]
    changed = np.flatnonzero(np.bincount(of[kept], minlength=len(paths)) < counts)
    _keep_points(paths, {number: kept[of[kept] == number] - first[number] for number in changed.tolist()})


def straighten_starts(paths: list[Path], upto_m: dict[int, float]) -> None:
    """Leave out points of axes (by number), in place, between their first and the one at or after this arc."""
    kept = {}
    for number, straight_m in upto_m.items():
        later = arcs_along(paths[number].points_m) >= straight_m
        later[0] = later[-1] = True
        if not later.all():
            kept[number] = np.flatnonzero(later)
    _keep_points(paths, kept)


def _keep_points(paths: list[Path], kept: dict[int, NDArray[np.intp]]) -> None:
    """Leave all other points of these paths out, in place; what they carry leaves from where it was."""
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
