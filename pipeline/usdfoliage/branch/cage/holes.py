"""Which rings and which sectors of its parent each branch leaves through.

A hole takes two rows of faces in one of the six sectors between three rings. Branches that leave close together share
the three rings where their sectors have room, else the thinner one moves along its parent to the next free place.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.branch.cage.exits import Exits
from usdfoliage.branch.cage.sectors import TURN
from usdfoliage.branch.cage.tubes import Floats, Ints, Tubes, turning

MIN_SINE = np.sin(np.radians(35.0))  # a hole is no longer than one at this angle; the branch bends out of it instead
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
MIN_COLUMN = np.radians(11.0)  # between neighbouring vertices of a ring
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
    along = HOLE_ALONG * across / np.maximum(exits.sine, MIN_SINE)
    half_block = 1.35 * along + 0.2 * np.minimum(exits.parent_radius_m, 3 * exits.radius_m)
    sine = np.minimum(across / exits.parent_radius_m, THICKEST_SINE)
    half_rad = np.clip(np.arcsin(sine) + SECTOR_MARGIN, NARROWEST, WIDEST)
    tight_rad = np.clip(np.arcsin(sine) + TIGHT_MARGIN, NARROWEST, WIDEST)
    # The hole's ends are half as wide as its middle, and even sectors keep the parent round.
    end_rad = np.minimum(np.clip(np.arcsin(sine / 2) + SECTOR_MARGIN, NARROWEST, WIDEST), half_rad)
    looking = np.flatnonzero(wanted)
    # Thick branches first: their holes move least, even where they were made smaller.
    looking = looking[np.lexsort([looking, -exits.radius_m[looking], exits.parent[looking]])]
    # A hole's first vertex is behind to the left; a root's phase is what its first fork likes.
    phases = np.full(len(tubes), np.nan)
    phases[exits.tube] = exits.phase_rad - TURN / 3
    gone = np.zeros(len(tubes), np.uint8)
    gone[exits.tube[~wanted]] = 1
    steep, steep_first = _steep_stretches(tubes)
    # From there on a tip is rounded.
    end_m = tubes.length_m - 0.5 * tubes.radius_m[tubes.first + tubes.counts - 1]
    places = _native.place_holes(
        _native.HoleTubes(
            start_m=start_m,
            end_m=end_m,
            length_m=tubes.length_m,
            phase_rad=phases,
            steep_m=steep,
            steep_first=steep_first,
            gone=gone,
        ),
        _native.HoleWants(
            tube=exits.tube[looking],
            first=np.searchsorted(exits.parent[looking], np.arange(len(tubes) + 1)),
            arc_m=exits.hole_arc_m[looking],
            azimuth_rad=exits.azimuth_rad[looking],
            half_rad=half_rad[looking],
            tight_rad=tight_rad[looking],
            end_half_rad=end_rad[looking],
            half_block_m=half_block[looking],
            half_along_m=along[looking],
            half_across_m=across[looking],
            parent_radius_m=exits.parent_radius_m[looking],
        ),
        settings=_native.HoleSettings(tightest=TIGHTEST, relaxed=RELAXED, min_column_rad=MIN_COLUMN),
    )
    return Holes(
        block_tube=places.block_tube,
        block_arcs_m=places.block_arcs_m,
        exit=looking[places.want],
        block=places.block,
        sector=places.sector,
        arc_m=places.arc_m,
        azimuth_rad=places.azimuth_rad,
        half_along_m=places.half_along_m,
        half_across_m=places.half_across_m,
        turn_tube=places.turn_tube,
        turn_arc_m=places.turn_arc_m,
        turn_angles_rad=places.turn_angles_rad,
        homeless=np.sort(looking[places.homeless]),
    )


def _steep_stretches(tubes: Tubes) -> tuple[Floats, Ints]:
    """Arcs where tubes thin, thicken or bend so fast that a hole would be torn.

    Returns:
        From and to (S, 2), in order and apart, and (T + 1,) where each tube's begin.
    """
    ends = tubes.first + tubes.counts - 1
    slope = np.abs(np.diff(tubes.radius_m, append=0.0))
    slope[ends] = 0
    step = np.diff(tubes.arc_m, append=np.inf)
    steep = np.flatnonzero((slope > STEEP * step) & (slope > 0.2 * tubes.radius_m))
    of = np.searchsorted(tubes.first, steep, side="right") - 1
    inner = np.ones(len(tubes.arc_m), bool)
    inner[tubes.first] = inner[ends] = False
    corners = np.flatnonzero(inner)
    bend = turning(tubes.direction[corners - 1], tubes.direction[corners])
    bends = corners[bend > SHARP]
    reach = tubes.radius_m[bends] * np.tan(bend[bend > SHARP] / 2.2)
    low = np.concatenate([tubes.arc_m[steep], tubes.arc_m[bends] - reach])
    high = np.concatenate([tubes.arc_m[steep + 1], tubes.arc_m[bends] + reach])
    of = np.concatenate([of, np.searchsorted(tubes.first, bends, side="right") - 1])
    order = np.lexsort([high, low, of])
    of, low, high = of[order], low[order], high[order]
    # What overlaps is one: a stretch begins where all before it on its tube have ended.
    key = of * (4 * tubes.stride_m)
    reached = np.maximum.accumulate(high + key)
    begins = np.ones(len(of), bool)
    begins[1:] = low[1:] + key[1:] > reached[:-1]
    begins[1:] |= np.diff(of) != 0
    first = np.flatnonzero(begins)
    merged = np.stack([low[first], np.maximum.reduceat(high, first) if len(first) else high], axis=1)
    return merged, np.searchsorted(of[first], np.arange(len(tubes) + 1))
