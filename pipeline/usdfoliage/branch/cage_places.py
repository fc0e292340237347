"""Which rings and which sectors of its parent each branch leaves through.

A hole takes two rows of faces in one of the six sectors between three rings. Branches that leave close together share
the three rings where their sectors have room, else the thinner one moves along its parent to the next free place.
"""

import bisect
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage_exits import Exits
from usdfoliage.branch.cage_sectors import (
    SIDES,
    TURN,
    Columns,
    Want,
    arrange_columns,
    even_columns,
    has_room,
    mean_turn,
)
from usdfoliage.branch.cage_tubes import Floats, Ints, Tubes, turning

LEAST_SINE = np.sin(np.radians(35.0))  # a hole is no longer than one at this angle; the branch bends out of it instead
SECTOR_MARGIN = np.radians(14.0)  # between a hole and the edge of its sector
TIGHT_MARGIN = np.radians(5.0)  # the same, where other branches leave through the same rings
NARROWEST = np.radians(23.0)  # half a sector
WIDEST = np.radians(80.0)  # half a sector: beyond it nothing of the parent would be left behind the hole
HOLE = 1.1  # the hole against the exact cut of the two tubes: room for the fillet
HOLE_ALONG = np.sqrt(0.75)  # of a hexagon with two vertices across
STEEP = 0.35  # change of radius per length, above which a tube has no room for holes
SHARP = np.radians(45.0)  # a bend above which it has none either
RELAXED = 1.0  # parent radii behind a fork, in which its ring goes back to even sectors
THICKEST_SINE = 0.97  # of half a hole's width: its middle vertices must lie on the parent
TIGHTEST = 0.35  # of its length that a hole may be pressed to where its parent has no more room


@dataclass(frozen=True, kw_only=True, eq=False)
class Holes:
    """What the parents' rings must leave room for."""

    # Blocks of two rows that share three rings, in order along the tubes.
    block_tube: Ints  # (K,)
    block_arcs_m: Floats  # (K, 3), of the three rings
    # A hole for each exit that found a place.
    exit: Ints  # (H,), index into the exits
    block: Ints  # (H,)
    sector: Ints  # (H,), between columns sector and sector + 1 of its block
    arc_m: Floats  # (H,), middle on the parent
    azimuth_rad: Floats  # (H,), on the same turn as the columns of its block
    half_along_m: Floats  # (H,), to the first and last vertices of the hole
    half_across_m: Floats  # (H,)
    # Angles of columns between blocks: to be interpolated over arcs, tube by tube.
    turn_tube: Ints  # (A,)
    turn_arc_m: Floats  # (A,)
    turn_angles_rad: Floats  # (A, 6)
    homeless: Ints  # (D,), exits without a place


@dataclass(kw_only=True)
class _Block:
    low_m: float
    high_m: float
    members: list[Want] = field(default_factory=list)


def place_holes(tubes: Tubes, exits: Exits, start_m: Floats, wanted: NDArray[np.bool_], scale: Floats) -> Holes:
    """Find a place for each wanted hole.

    Args:
        tubes: All axes.
        exits: How they leave their parents.
        start_m: (T,), from where each tube has rings of its own.
        wanted: (C,), which exits get a hole, if their parents have one.
        scale: (C,), of the holes' sizes, 1 where nothing speaks against it.
    """
    across = HOLE * exits.radius_m * scale
    along = HOLE_ALONG * across / np.maximum(exits.sine, LEAST_SINE)
    half_block = 1.35 * along + 0.2 * np.minimum(exits.parent_radius_m, 3 * exits.radius_m)
    sine = np.minimum(across / exits.parent_radius_m, THICKEST_SINE)
    half_rad = np.clip(np.arcsin(sine) + SECTOR_MARGIN, NARROWEST, WIDEST)
    tight_rad = np.clip(np.arcsin(sine) + TIGHT_MARGIN, NARROWEST, WIDEST)
    # The hole's ends are half as wide as its middle, and even sectors keep the parent round.
    end_rad = np.minimum(np.clip(np.arcsin(sine / 2) + SECTOR_MARGIN, NARROWEST, WIDEST), half_rad)
    by_parent: dict[int, list[Want]] = {}
    gone: set[int] = set(exits.tube[~wanted].tolist())
    for number in np.flatnonzero(wanted).tolist():
        want = Want(
            exit=number,
            arc_m=float(exits.hole_arc_m[number]),
            azimuth_rad=float(exits.azimuth_rad[number]),
            half_rad=float(half_rad[number]),
            tight_rad=float(tight_rad[number]),
            end_rad=float(end_rad[number]),
            half_block_m=float(half_block[number]),
            half_along_m=float(along[number]),
            half_across_m=float(across[number]),
            parent_radius_m=float(exits.parent_radius_m[number]),
        )
        by_parent.setdefault(int(exits.parent[number]), []).append(want)

    # A hole's first vertex is behind to the left; a root's phase is what its first fork likes.
    phases: list[float | None] = [None] * len(tubes)
    for tube, phase_rad in zip(exits.tube.tolist(), exits.phase_rad.tolist(), strict=True):
        phases[tube] = phase_rad - TURN / 3
    steep = _steep_stretches(tubes)
    end_m = tubes.length_m - 0.5 * tubes.radius_m[tubes.first + tubes.counts - 1]  # from there on a tip is rounded
    blocks: list[tuple[int, _Block, Columns]] = []
    turns: list[tuple[int, float, list[float]]] = []
    homeless: list[int] = []
    for tube in range(len(tubes)):
        wants = by_parent.get(tube, [])
        if tube in gone:
            gone.update(int(exits.tube[want.exit]) for want in wants)
            wants = []
        found, lost = _place_along(wants, float(start_m[tube]), float(end_m[tube]), steep.get(tube, []))
        homeless += lost
        gone.update(int(exits.tube[number]) for number in lost)
        phase = phases[tube]
        arranged = []
        for block in found:
            columns = arrange_columns(block.members, phase)
            phase = mean_turn(columns.middle)
            blocks.append((tube, block, columns))
            arranged.append((block, columns))
        turns += _turns_along(tube, phases[tube], arranged, float(start_m[tube]), float(tubes.length_m[tube]))
    return _gather(blocks, turns, homeless)


def _gather(
    blocks: list[tuple[int, _Block, Columns]],
    turns: list[tuple[int, float, list[float]]],
    homeless: list[int],
) -> Holes:
    members = [
        (want, number, sector)
        for number, (_, block, columns) in enumerate(blocks)
        for want, sector in zip(block.members, columns.sectors, strict=True)
    ]
    arcs = [(block.low_m, (block.low_m + block.high_m) / 2, block.high_m) for _, block, _ in blocks]
    return Holes(
        block_tube=np.array([tube for tube, _, _ in blocks], np.int64),
        block_arcs_m=np.array(arcs, float).reshape(-1, 3),
        exit=np.array([want.exit for want, _, _ in members], np.int64),
        block=np.array([number for _, number, _ in members], np.int64),
        sector=np.array([sector for _, _, sector in members], np.int64),
        arc_m=np.array([want.arc_m for want, _, _ in members], float),
        azimuth_rad=np.array([want.azimuth_rad for want, _, _ in members], float),
        half_along_m=np.array([want.half_along_m for want, _, _ in members], float),
        half_across_m=np.array([want.half_across_m for want, _, _ in members], float),
        turn_tube=np.array([tube for tube, _, _ in turns], np.int64),
        turn_arc_m=np.array([arc for _, arc, _ in turns], float),
        turn_angles_rad=np.array([angles for _, _, angles in turns], float).reshape(-1, SIDES),
        homeless=np.array(sorted(homeless), np.int64),
    )


def _steep_stretches(tubes: Tubes) -> dict[int, list[tuple[float, float]]]:
    """Arcs of each tube where it thins, thickens or bends so fast that a hole would be torn."""
    ends = tubes.first + tubes.counts - 1
    slope = np.abs(np.diff(tubes.radius_m, append=0.0))
    slope[ends] = 0
    step = np.diff(tubes.arc_m, append=np.inf)
    steep = np.flatnonzero((slope > STEEP * step) & (slope > 0.2 * tubes.radius_m))
    of = np.searchsorted(tubes.first, steep, side="right") - 1
    stretches: dict[int, list[tuple[float, float]]] = {}
    for tube, at in zip(of.tolist(), steep.tolist(), strict=True):
        stretches.setdefault(tube, []).append((float(tubes.arc_m[at]), float(tubes.arc_m[at + 1])))
    inner = np.ones(len(tubes.arc_m), bool)
    inner[tubes.first] = inner[ends] = False
    corners = np.flatnonzero(inner)
    bend = turning(tubes.direction[corners - 1], tubes.direction[corners])
    bends = corners[bend > SHARP]
    reach = tubes.radius_m[bends] * np.tan(bend[bend > SHARP] / 2.2)
    of = np.searchsorted(tubes.first, bends, side="right") - 1
    for tube, arc, half in zip(of.tolist(), tubes.arc_m[bends].tolist(), reach.tolist(), strict=True):
        stretches.setdefault(tube, []).append((arc - half, arc + half))
    return {tube: _merged(parts) for tube, parts in stretches.items()}


def _merged(stretches: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Stretches that do not overlap."""
    merged: list[tuple[float, float]] = []
    for low, high in sorted(stretches):
        if merged and low <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(high, merged[-1][1])
        else:
            merged.append((low, high))
    return merged


def _place_along(
    wants: list[Want], start_m: float, end_m: float, steep: list[tuple[float, float]]
) -> tuple[list[_Block], list[int]]:
    """Places along one tube, thick branches first: their holes move least. In order along it."""
    blocks = [_Block(low_m=low, high_m=high) for low, high in steep]
    lost: list[int] = []
    for want in sorted(wants, key=lambda want: (-want.half_across_m, want.exit)):
        gap = 0.25 * want.parent_radius_m
        low, high = start_m + gap, end_m - gap
        if not _place(want, blocks, low, high, gap):
            lost.append(want.exit)
    return [block for block in blocks if block.members], lost


def _place(want: Want, blocks: list[_Block], low: float, high: float, gap: float) -> bool:
    """Put a hole into the nearest block that has a sector for it, or into a new one where there is room.

    Blocks are in order along the tube, do not overlap, and stay so.
    """
    best: tuple[float, _Block | None, float, float] | None = None
    for press in (1.0, 0.75, 0.5, TIGHTEST):
        half = press * want.half_block_m
        for middle in _free_middles(want.arc_m, half, blocks, low, high, gap):
            moved = abs(middle - want.arc_m)
            if best is None or moved < best[0]:
                best = (moved, None, middle, press)
        for number, block in enumerate(blocks):
            most = 1.6 * max(block.high_m - block.low_m, 2 * half)
            away = max(block.low_m - want.arc_m, want.arc_m - block.high_m) - most
            if (best is not None and away > best[0]) or not has_room(block.members, want):
                continue
            # A block may grow towards what it takes in, but stays about as long as its longest.
            floor = max(low, blocks[number - 1].high_m + gap) if number else low
            roof = min(high, blocks[number + 1].low_m - gap) if number + 1 < len(blocks) else high
            grow_low, grow_high = max(floor, block.high_m - most), min(roof, block.low_m + most)
            if grow_high - grow_low < 2 * half:
                continue
            middle = min(max(want.arc_m, grow_low + half), grow_high - half)
            if max(block.high_m, middle + half) - min(block.low_m, middle - half) > most * (1 + 1e-9):
                middle = min(max(want.arc_m, block.low_m + half), block.high_m - half)
                if block.high_m - block.low_m < 2 * half:
                    continue
            # Rings that a thick branch has already bent are no good place for another.
            cost = abs(middle - want.arc_m) + max(member.half_across_m for member in block.members)
            if best is None or cost < best[0]:
                best = (cost, block, middle, press)
        # Rather a little out of place than a hole pressed flat.
        if best is not None and best[0] <= 2 * want.half_block_m + 2 * want.parent_radius_m:
            break
    if best is None:
        return False
    _, chosen, want.arc_m, press = best
    half = press * want.half_block_m
    want.half_along_m *= press
    if press < 1:
        want.half_across_m *= np.sqrt(press)
    if chosen is None:
        chosen = _Block(low_m=want.arc_m - half, high_m=want.arc_m + half)
        bisect.insort(blocks, chosen, key=lambda block: block.low_m)
    chosen.low_m = min(chosen.low_m, want.arc_m - half)
    chosen.high_m = max(chosen.high_m, want.arc_m + half)
    chosen.members.append(want)
    return True


def _free_middles(arc_m: float, half: float, blocks: list[_Block], low: float, high: float, gap: float) -> list[float]:
    """The nearest middles of free stretches of this half length between blocks in order, one for each stretch."""
    ends = [low - gap]
    for block in blocks:
        ends += [block.low_m, block.high_m]
    ends.append(high + gap)
    middles = []
    for floor, roof in zip(ends[::2], ends[1::2], strict=True):
        if roof - floor >= 2 * (half + gap):
            middles.append(min(max(arc_m, floor + gap + half), roof - gap - half))
    return middles


def _turns_along(
    tube: int, phase: float | None, arranged: list[tuple[_Block, Columns]], start_m: float, end_m: float
) -> list[tuple[int, float, list[float]]]:
    """Column angles at arcs of one tube: those of the blocks, even between them where that is far enough."""
    if not arranged:
        return [(tube, start_m, even_columns(phase or 0.0))]
    turns: list[tuple[int, float, list[float]]] = []
    before = start_m
    for number, (block, columns) in enumerate(arranged):
        relaxed = RELAXED * max(member.parent_radius_m for member in block.members)
        even = even_columns(mean_turn(columns.middle))
        if number == 0 and phase is not None:
            turns.append((tube, start_m, even_columns(phase)))
        if block.low_m - relaxed > before:
            turns.append((tube, block.low_m - relaxed, even))
        turns.append((tube, block.low_m, columns.ends))
        turns.append((tube, (block.low_m + block.high_m) / 2, columns.middle))
        turns.append((tube, block.high_m, columns.ends))
        after = arranged[number + 1][0].low_m if number + 1 < len(arranged) else end_m
        if block.high_m + relaxed < after:
            turns.append((tube, block.high_m + relaxed, even))
        before = block.high_m + relaxed
    return turns
