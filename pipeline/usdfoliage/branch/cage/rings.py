"""Rings of six along the tubes of a branch cage: where they stand, and where the surface is to pass through them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.branch.cage.holes import Holes
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.tubes import Floats, Ints, Tubes, turning

# Half-way between its vertices the limit of a hexagon is 0.4 % nearer to the axis than at them.
AT_VERTICES = 1.002
GROWTH = 0.8  # of the spacing, per length, away from where it must be short
LEAN_GROWTH = 3.0  # likewise, of a lean cage
CROWDED = 0.7  # radii: optional rings keep this distance
PER_INTERVAL = 6  # at least so many samples of the spacing between two rings that are given
MAX_SAMPLES = 4000  # and at most so many
TIP = 0.75  # radius of the last ring of a tip, which is rounded off
STEADIED = (1.0, 2.2)  # radii before the shoulder: rings that keep its rounding to itself
SHOULDER = 0.2  # radii before it: the last ring of full thickness
MARKED = np.radians(15.0)  # a bend that has rings beside it even where points are close
LONG = 4.0  # radii: bends between longer segments are corners, those between shorter ones a curve
SLIGHT = 0.25  # of the tolerance, that one such bend may take
STEADY = 60.0  # spacing in radii where nothing asks for a ring


@dataclass(frozen=True, kw_only=True, eq=False)
class Rings:
    """All rings, tube after tube, each tube's from its start to its tip."""

    tube: Ints  # (N,)
    arc_m: Floats  # (N,)
    block: Ints  # (N,), block whose three rings this is one of, -1 for none
    center_m: Floats  # (N, 3)
    tangent: Floats  # (N, 3), unit
    radius_m: Floats  # (N,)
    angles_rad: Floats  # (N, 6), ascending
    points_m: Floats  # (N, 6, 3), where the limit surface is to be

    @cached_property
    def first(self) -> Ints:
        """(T,) first ring of each tube that has any; as many as there are such tubes."""
        return np.flatnonzero(np.diff(self.tube, prepend=-1))

    @cached_property
    def last(self) -> Ints:
        """(T,) last ring of each tube that has any."""
        return np.flatnonzero(np.diff(self.tube, append=np.iinfo(np.int64).max))


@dataclass(frozen=True, kw_only=True, eq=False)
class Starts:
    """From where each of T tubes has rings, and how thick they may be there."""

    alive: NDArray[np.bool_]  # (T,), false: no rings at all
    arc_m: Floats  # (T,)
    radius_m: Floats  # (T,), inf where nothing limits it
    spacing_m: Floats  # (T,), of the first rings


@dataclass(frozen=True, kw_only=True, eq=False)
class RingMarks:
    """Places along branches that are to have rings where there is room."""

    branch: Ints  # (M,)
    arc_m: Floats  # (M,), along the branch

    def on_tubes(self, tubes: Tubes) -> tuple[Ints, Floats]:
        """Tubes and arcs of those whose branches are there."""
        place = np.full(max(int(self.branch.max(initial=-1)), int(tubes.piece_branch.max(initial=-1))) + 1, -1)
        place[tubes.piece_branch] = np.arange(len(tubes.piece_branch))
        piece = place[self.branch]
        there = piece >= 0
        tube, arc = tubes.piece_tube[piece[there]], (tubes.piece_from_m[piece] + self.arc_m)[there]
        inside = (arc > 0) & (arc < tubes.length_m[tube])
        return tube[inside], arc[inside]


NO_MARKS = RingMarks(branch=np.zeros(0, np.int64), arc_m=np.zeros(0))


def build_rings(
    tubes: Tubes, starts: Starts, holes: Holes, settings: BranchCageSettings, marks: RingMarks = NO_MARKS
) -> Rings:
    """Place rings along all tubes that are alive.

    Args:
        tubes: All axes.
        starts: Where their rings begin.
        holes: What they must leave room for.
        settings: How many.
        marks: Where rings are wanted beside these.
    """
    tube, arc, block = _given_stations(tubes, starts, holes, settings, marks)
    tube, arc, block = _fill(tubes, starts, tube, arc, block, settings)
    center, radius = tubes.axis(tube, arc)
    radius = np.minimum(radius, starts.radius_m[tube] + 0.3 * (arc - starts.arc_m[tube]))
    return _round(tubes, holes, tube, arc, block, center, radius)


def _round(tubes: Tubes, holes: Holes, tube: Ints, arc: Floats, block: Ints, center: Floats, radius: Floats) -> Rings:
    """The circles, upright to the axis, smaller where they would cross in a bend."""
    same_next = np.diff(tube) == 0
    step = np.where(same_next, np.diff(arc), np.inf)
    shorter = np.minimum(np.append(step, np.inf), np.insert(step, 0, np.inf))
    # Close rings in a bend have nearly one direction, or they would cross inside it.
    reach = np.maximum(0.8 * radius, 0.45 * np.where(np.isfinite(shorter), shorter, 0))
    tangent = tubes.tangents(tube, arc, reach)
    tip = np.flatnonzero(np.diff(tube, append=-1))
    radius[tip] *= TIP
    angles = turned(tubes, holes, tube, arc)
    first, second = tubes.frames(tube, arc, tangent)
    rounded = _native.round_rings(
        _native.RingCircles(
            tube=tube,
            center_m=center,
            tangent=tangent,
            first=first,
            second=second,
            angles_rad=angles,
            radius_m=radius,
        ),
        at_vertices=AT_VERTICES,
        threads=0,
    )
    return Rings(
        tube=tube,
        arc_m=arc,
        block=block,
        center_m=center,
        tangent=tangent,
        radius_m=rounded.radius_m,
        angles_rad=angles,
        points_m=rounded.points_m,
    )


def ring_swell(tube: Ints, arc_m: Floats, radius_m: Floats) -> Floats:
    """(N, 2) by how much of its radius a tube grows per length, ahead of each ring and behind it; 0 beyond its ends."""
    same = np.diff(tube) == 0
    step, change = np.diff(arc_m), np.diff(radius_m)
    swell = np.zeros((len(tube), 2))
    swell[:-1, 0][same] = (change / radius_m[:-1] / np.where(same, step, 1))[same]
    swell[1:, 1][same] = (change / radius_m[1:] / np.where(same, step, 1))[same]
    return swell


def turned(tubes: Tubes, holes: Holes, tube: Ints, arc: Floats) -> Floats:
    """(N, 6) angles of the columns at places of tubes."""
    given = holes.turn_tube * tubes.stride_m + holes.turn_arc_m
    at = tube * tubes.stride_m + arc
    # Between the last of one tube and the first of the next nothing is asked, but before the first and after the
    # last of a tube its own hold.
    low = np.searchsorted(holes.turn_tube, tube, side="left")
    high = np.searchsorted(holes.turn_tube, tube, side="right") - 1
    at = np.clip(at, given[low], given[high])
    return np.stack([np.interp(at, given, column) for column in holes.turn_angles_rad.T], axis=1)


def _given_stations(
    tubes: Tubes, starts: Starts, holes: Holes, settings: BranchCageSettings, marks: RingMarks
) -> tuple[Ints, Floats, Ints]:
    """Stations that must be, in order: ends, blocks, and corners that spacing alone would round off."""
    alive = np.flatnonzero(starts.alive)
    tip_m = tubes.length_m[alive]
    tip_radius = np.minimum(tubes.radius_m[tubes.first[alive] + tubes.counts[alive] - 1], starts.radius_m[alive])
    shoulder = tip_m - SHOULDER * tip_radius
    rounded = shoulder > starts.arc_m[alive] + 0.5 * tip_radius
    roots = np.flatnonzero(tubes.parent < 0)
    foot = tubes.radius_m[tubes.first[roots]]
    tall = tubes.length_m[roots] > 2 * SHOULDER * (foot + tubes.radius_m[tubes.first[roots] + tubes.counts[roots] - 1])
    hard_tube = [alive, alive, alive[rounded], roots[tall], np.repeat(holes.block_tube, 3)]
    hard_arc = [starts.arc_m[alive], tip_m, shoulder[rounded], (SHOULDER * foot)[tall], holes.block_arcs_m.reshape(-1)]
    count = len(holes.block_tube)
    none = np.full(2 * len(alive) + int(rounded.sum() + tall.sum()), -1)
    hard_block = np.concatenate([none, np.repeat(np.arange(count), 3)])
    tube, arc = np.concatenate(hard_tube), np.concatenate(hard_arc)
    # A tube that is all stub has one ring, which is its start and its tip.
    order = np.lexsort([arc, tube])
    tube, arc, block = tube[order], arc[order], hard_block[order]
    distinct = np.ones(len(tube), bool)
    distinct[1:] = (np.diff(tube) != 0) | (np.diff(arc) > 1e-3 * tubes.axis(tube[1:], arc[1:])[1])
    tube, arc, block = tube[distinct], arc[distinct], block[distinct]

    # A few more rings keep the rounding of tips and feet out of the long rows beside them.
    soft_tube, soft_arc = _corners(tubes, settings.axis_tolerance)
    steadied = STEADIED[:1] if settings.lean else STEADIED
    beside_tips = [shoulder - away * tip_radius for away in steadied]
    beside_feet = [(SHOULDER + away) * foot for away in steadied]
    of_marks, at_marks = marks.on_tubes(tubes)
    soft_tube = np.concatenate([soft_tube, *[alive] * len(steadied), *[roots] * len(steadied), of_marks])
    soft_arc = np.concatenate([soft_arc, *beside_tips, *beside_feet, at_marks])
    order = np.lexsort([soft_arc, soft_tube])
    soft_tube, soft_arc = soft_tube[order], soft_arc[order]
    keep = starts.alive[soft_tube]
    soft_tube, soft_arc = soft_tube[keep], soft_arc[keep]
    soft_tube, soft_arc = _thin_out(tubes, tube, arc, block, soft_tube, soft_arc)
    tube, arc = np.concatenate([tube, soft_tube]), np.concatenate([arc, soft_arc])
    block = np.concatenate([block, np.full(len(soft_tube), -1)])
    order = np.lexsort([arc, tube])
    return tube[order], arc[order], block[order]


def _corners(tubes: Tubes, tolerance: float) -> tuple[Ints, Floats]:
    """Stations at and beside corners between long straight segments, where thickness bends, and between branches."""
    inner = np.ones(len(tubes.arc_m), bool)
    inner[tubes.first] = False
    inner[tubes.first + tubes.counts - 1] = False
    at = np.flatnonzero(inner)
    of = np.repeat(np.arange(len(tubes)), tubes.counts)[at]
    radius = tubes.radius_m[at]
    before, after = tubes.arc_m[at] - tubes.arc_m[at - 1], tubes.arc_m[at + 1] - tubes.arc_m[at]
    short = np.minimum(before, after)
    bend = turning(tubes.direction[at - 1], tubes.direction[at])
    beside = np.maximum(6 * tolerance * radius / np.maximum(bend, 1e-9), radius * (0.75 + np.tan(bend / 2.2)))
    corner = (bend * short / 8 > tolerance * radius) & ((short > 2 * beside) | (bend > MARKED))
    slope = np.abs((tubes.radius_m[at + 1] - radius) / after - (radius - tubes.radius_m[at - 1]) / before)
    # One ring where without any a row would cut the corner: half-way along a bend's shorter segment it is off by this,
    # and by as much again where the next one bends to the same side.
    between = (np.maximum(before, after) > LONG * radius) & (bend * short / 2 > SLIGHT * tolerance * radius)
    kink = between | (slope * short / 2 > tolerance * radius)
    arcs = tubes.arc_m[at]
    seam = tubes.piece_from_m > 0
    sharp = bend[corner] > MARKED  # then a second one keeps the bend out of the long rows
    tube = np.concatenate([*[of[corner]] * 3, *[of[corner][sharp]] * 2, of[kink & ~corner], tubes.piece_tube[seam]])
    beside, middle = beside[corner], arcs[corner]
    more = 2.2 * beside[sharp]
    arc = np.concatenate([middle - beside, middle, middle + beside, middle[sharp] - more, middle[sharp] + more])
    arc = np.concatenate([arc, arcs[kink & ~corner], tubes.piece_from_m[seam]])
    order = np.lexsort([arc, tube])
    return tube[order], arc[order]


def _thin_out(
    tubes: Tubes, tube: Ints, arc: Floats, block: Ints, soft_tube: Ints, soft_arc: Floats
) -> tuple[Ints, Floats]:
    """The optional stations that are not in a block, nor next to a given one, nor to each other."""
    key, soft = tube * tubes.stride_m + arc, soft_tube * tubes.stride_m + soft_arc
    room = CROWDED * tubes.axis(soft_tube, soft_arc)[1]
    after = np.clip(np.searchsorted(key, soft), 1, len(key) - 1)
    in_block = (block[after] >= 0) & (block[after] == block[after - 1])
    inside = (tube[after] == soft_tube) & (tube[after - 1] == soft_tube)
    keep = inside & ~in_block & (np.minimum(key[after] - soft, soft - key[after - 1]) > room)
    soft, soft_tube, soft_arc, room = soft[keep], soft_tube[keep], soft_arc[keep], room[keep]
    while len(soft) > 1:
        crowded = np.concatenate([[False], np.diff(soft) < room[1:]])
        crowded[1:] &= ~crowded[:-1]  # its neighbour may go, and then it may stay
        if not crowded.any():
            break
        soft, soft_tube, soft_arc, room = (values[~crowded] for values in (soft, soft_tube, soft_arc, room))
    return soft_tube, soft_arc


def _fill(
    tubes: Tubes, starts: Starts, tube: Ints, arc: Floats, block: Ints, settings: BranchCageSettings
) -> tuple[Ints, Floats, Ints]:
    """Add stations between the given ones, so many as bends ask for, and closer towards blocks and ends."""
    apart = np.diff(arc)
    is_gap = (np.diff(tube) == 0) & ~((block[1:] >= 0) & (block[1:] == block[:-1]))
    gap = np.flatnonzero(is_gap)
    of, low, length = tube[gap], arc[gap], apart[gap]
    spacing = np.full(len(tube), np.inf)
    for side in (-1, 1):  # a block's own row length goes on beside it
        neighbor = np.clip(np.arange(len(tube)) + side, 0, len(tube) - 1)
        in_block = (block >= 0) & (block == block[neighbor]) & (neighbor != np.arange(len(tube)))
        spacing[in_block] = np.abs(arc[neighbor] - arc)[in_block]
    begins = np.concatenate([[True], np.diff(tube) != 0])
    spacing[begins] = starts.spacing_m[tube[begins]]
    added = _native.fill_gaps(
        tubes.axes,
        _native.RingGaps(tube=of, low_m=low, length_m=length, below_m=spacing[gap], above_m=spacing[gap + 1]),
        turned_rad=tubes.turned_rad,
        settings=_native.RingSpacingSettings(
            tolerance=settings.axis_tolerance,
            longest=settings.longest_row,
            growth=LEAN_GROWTH if settings.lean else GROWTH,
            steady=STEADY,
            long_segment=LONG,
            max_reach_m=0.25 * tubes.stride_m,
            min_samples=PER_INTERVAL,
            max_samples=MAX_SAMPLES,
        ),
        threads=0,
    )
    new, new_arc = added.gap, added.arc_m
    out_tube = np.concatenate([tube, of[new]])
    out_arc = np.concatenate([arc, new_arc])
    out_block = np.concatenate([block, np.full(len(new), -1)])
    order = np.lexsort([out_arc, out_tube])
    return out_tube[order], out_arc[order], out_block[order]
