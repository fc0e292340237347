"""Sectors of a ring of six for the branches that leave through it: who has which, and how wide."""

from dataclasses import dataclass

import numpy as np

SIDES = 6
TURN = 2 * np.pi
LEAST_COLUMN = np.radians(11.0)  # between neighbouring vertices of a ring


@dataclass(kw_only=True)
class Want:
    """A hole that looks for a place."""

    exit: int
    arc_m: float
    azimuth_rad: float
    half_rad: float  # of its sector, at the middle ring of its block
    tight_rad: float  # the same where neighbours are close
    end_rad: float  # at the two others
    half_block_m: float
    half_along_m: float
    half_across_m: float
    parent_radius_m: float


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Angles of a block's columns, and the sectors of its members."""

    middle: list[float]
    ends: list[float]
    sectors: list[int]


def has_room(members: list[Want], want: Want) -> bool:
    """Whether a ring that these leave through has a sector for another."""
    if not 0 < len(members) < SIDES:
        return False
    ranked = sorted([*members, want], key=lambda member: member.azimuth_rad % TURN)
    return _fits(_gaps(ranked, [member.tight_rad for member in ranked]))


def _fits(gaps: list[float]) -> bool:
    """Whether the other columns have room between the sectors."""
    return min(gaps) >= 0 and sum(int(gap / LEAST_COLUMN) for gap in gaps) >= SIDES - len(gaps)


def _gaps(members: list[Want], halves: list[float]) -> list[float]:
    """Angles between the sectors of members in order, each to the next."""
    gaps = []
    for number, member in enumerate(members):
        following = (number + 1) % len(members)
        apart = (members[following].azimuth_rad - member.azimuth_rad) % TURN if len(members) > 1 else TURN
        gaps.append(apart - halves[number] - halves[following])
    return gaps


def arrange_columns(members: list[Want], phase: float | None) -> Columns:
    """Angles of the six columns, and the sector of each member; members get azimuths on the same turn.

    Each sector ends at its branch's edges, or half-way to a neighbour that has the next sector; what is left of the
    circle is shared by the other columns. Of the six numberings the one that turns the rings least is taken.
    """
    order = sorted(range(len(members)), key=lambda number: (members[number].azimuth_rad % TURN, number))
    ranked = [members[number] for number in order]
    halves = [member.half_rad for member in ranked]
    gaps = _gaps(ranked, halves)
    if not _fits(gaps):
        halves = [member.tight_rad for member in ranked]
        gaps = _gaps(ranked, halves)
    extra = [0] * len(ranked)
    for _ in range(SIDES - len(ranked)):
        widest = max(range(len(gaps)), key=lambda number: gaps[number] / (extra[number] + 1))
        extra[widest] += 1
    azimuth = ranked[0].azimuth_rad
    for number, member in enumerate(ranked):
        following = ranked[(number + 1) % len(ranked)]
        apart = (following.azimuth_rad - azimuth) % TURN
        member.azimuth_rad = azimuth
        azimuth += apart
    middle = _share_out(ranked, halves, extra)
    end_halves = [min(half, member.end_rad) for half, member in zip(halves, ranked, strict=True)]
    ends = _share_out(ranked, end_halves, extra)
    aim = phase if phase is not None else mean_turn(middle)
    # Column k becomes column k + shift: its angle then belongs to shift sixths of a turn more.
    turns, shift = divmod(round((mean_turn(middle) - aim) / (TURN / SIDES)), SIDES)
    middle, ends = (
        [angles[(k - shift) % SIDES] - (TURN if k < shift else 0.0) - turns * TURN for k in range(SIDES)]
        for angles in (middle, ends)
    )
    sectors = [0] * len(ranked)
    sector = shift
    for rank, member in enumerate(ranked):
        sectors[order[rank]] = sector % SIDES
        left, right = middle[sector % SIDES], middle[(sector + 1) % SIDES]
        center = (left + right + (TURN if sector % SIDES == SIDES - 1 else 0.0)) / 2
        member.azimuth_rad += TURN * round((center - member.azimuth_rad) / TURN)
        sector += 1 + extra[rank]
    return Columns(middle=middle, ends=ends, sectors=sectors)


def _share_out(ranked: list[Want], halves: list[float], extra: list[int]) -> list[float]:
    """Six ascending angles, the first the left edge of the first member's sector."""
    gaps = _gaps(ranked, halves)
    angles: list[float] = []
    for number, member in enumerate(ranked):
        left = member.azimuth_rad - halves[number]
        angles.append(left if extra[number - 1] else left - gaps[number - 1] / 2)
        if extra[number]:
            step = gaps[number] / extra[number]
            angles += [member.azimuth_rad + halves[number] + step * k for k in range(extra[number])]
    return angles


def mean_turn(angles: list[float]) -> float:
    return sum(angles) / SIDES - TURN / SIDES * (SIDES - 1) / 2


def even_columns(phase: float) -> list[float]:
    return [phase + TURN / SIDES * k for k in range(SIDES)]
