"""What the native kernels of a branch cage compute, plainly: for comparison."""

import bisect
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array
from usdfoliage.branch.cage.exits import CAGE_FACTOR, MAX_STEPS, SKIN, THICKEST, _disc, _Nearest
from usdfoliage.branch.cage.holes import MIN_COLUMN, RELAXED, TIGHTEST
from usdfoliage.branch.cage.sectors import SIDES, TURN
from usdfoliage.branch.cage.tubes import rotate_between

BATCH = 400_000  # pairs at once, so that temporaries stay small
FARTHEST = 0.5  # radii: no vertex is moved by more


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
    return min(gaps) >= 0 and sum(int(gap / MIN_COLUMN) for gap in gaps) >= SIDES - len(gaps)


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


@dataclass(kw_only=True)
class _Block:
    low_m: float
    high_m: float
    members: list[Want] = field(default_factory=list)


def place_all(wants, start_m, end_m, length_m, phases, steep, gone):
    """Blocks (tube, block, columns), turns (tube, arc, angles) and homeless exits.

    wants: by tube a list of (tube of the branch, Want); steep: by tube; gone: set of tubes.
    """
    gone = set(gone)
    blocks, turns, homeless = [], [], []
    for tube in range(len(start_m)):
        own = wants.get(tube, [])
        child = {want.exit: branch for branch, want in own}
        looking = [want for _, want in own]
        if tube in gone:
            gone.update(child.values())
            looking = []
        found, lost = _place_along(looking, start_m[tube], end_m[tube], steep.get(tube, []))
        homeless += lost
        gone.update(child[number] for number in lost)
        phase = phases[tube]
        arranged = []
        for block in found:
            columns = arrange_columns(block.members, phase)
            phase = mean_turn(columns.middle)
            blocks.append((tube, block, columns))
            arranged.append((block, columns))
        turns += _turns_along(tube, phases[tube], arranged, start_m[tube], length_m[tube])
    return blocks, turns, homeless


def _place_along(
    wants: list[Want], start_m: float, end_m: float, steep: list[tuple[float, float]]
) -> tuple[list[_Block], list[int]]:
    """Places along one tube, thick branches first: their holes move least. In order along it."""
    blocks = [_Block(low_m=low, high_m=high) for low, high in steep]
    lost: list[int] = []
    for want in wants:
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
            max_span = 1.6 * max(block.high_m - block.low_m, 2 * half)
            away = max(block.low_m - want.arc_m, want.arc_m - block.high_m) - max_span
            if (best is not None and away > best[0]) or not has_room(block.members, want):
                continue
            # A block may grow towards what it takes in, but stays about as long as its longest.
            floor = max(low, blocks[number - 1].high_m + gap) if number else low
            roof = min(high, blocks[number + 1].low_m - gap) if number + 1 < len(blocks) else high
            grow_low, grow_high = max(floor, block.high_m - max_span), min(roof, block.low_m + max_span)
            if grow_high - grow_low < 2 * half:
                continue
            middle = min(max(want.arc_m, grow_low + half), grow_high - half)
            if max(block.high_m, middle + half) - min(block.low_m, middle - half) > max_span * (1 + 1e-9):
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


def crossing_quads(points: np.ndarray, faces: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Which pairs (N, 2) of faces (F, 4) cross; those that share a vertex do not count.

    Quads are split along their first diagonal. Triangles that only touch, or lie in one plane, do not cross.
    """
    crossing = np.zeros(len(pairs), bool)
    for start in range(0, len(pairs), BATCH):
        block = pairs[start : start + BATCH]
        one, two = faces[block[:, 0]], faces[block[:, 1]]
        shared = np.zeros(len(block), bool)
        for corner in range(4):
            for other in range(4):
                shared |= one[:, corner] == two[:, other]
        left = np.flatnonzero(~shared)
        for a_face, b_face in ((one, two), (two, one)):
            near = ~_on_one_side(points[a_face[left]], points[b_face[left]])
            left = left[near]
        a, b = points[one[left]], points[two[left]]
        hit = np.zeros(len(left), bool)
        for first in ((0, 1, 2), (0, 2, 3)):
            for second in ((0, 1, 2), (0, 2, 3)):
                hit |= _triangles_cross(a[:, first], b[:, second])
        crossing[start + left[hit]] = True
    return crossing


def _on_one_side(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether quads b lie on one side of both triangles of quads a."""
    result = np.ones(len(a), bool)
    for corners in ((0, 1, 2), (0, 2, 3)):
        origin = a[:, corners[0]]
        normal = np.cross(a[:, corners[1]] - origin, a[:, corners[2]] - origin)
        above = below = np.ones(len(a), bool)
        for corner in range(4):
            height = np.einsum("nc,nc->n", b[:, corner] - origin, normal)
            above, below = above & (height > 0), below & (height < 0)
        result &= above | below
    return result


def _triangles_cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether an edge of one triangle (N, 3, 3) goes through the other."""
    result = np.zeros(len(a), bool)
    for one, two in ((a, b), (b, a)):
        for k in range(3):
            result |= _edge_through(one[:, k], one[:, (k + 1) % 3], two)
    return result


def _edge_through(start: np.ndarray, end: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    before = np.sum((start - triangle[:, 0]) * normal, axis=1)
    after = np.sum((end - triangle[:, 0]) * normal, axis=1)
    sides = before * after < 0
    along = end - start
    # Signs of the volumes that the edge makes with the triangle's edges.
    inside = outside = sides
    for k in range(3):
        spanned = np.cross(triangle[:, k] - start, triangle[:, (k + 1) % 3] - start)
        volume = np.einsum("nc,nc->n", spanned, along)
        inside, outside = inside & (volume > 0), outside & (volume < 0)
    return inside | outside


def limit_stencils(faces: np.ndarray, count: int) -> csr_array:
    """(count, count) matrix from the vertices of a closed mesh of quads (F, 4) to their limits."""
    valence = np.bincount(faces.reshape(-1), minlength=count).astype(float)
    corners = [np.roll(faces, -k, axis=1).reshape(-1) for k in range(4)]
    rows = np.concatenate([corners[0]] * 3 + [np.arange(count)]).astype(np.int32)
    columns = np.concatenate([corners[1], corners[3], corners[2], np.arange(count)]).astype(np.int32)
    size = faces.size
    # An edge is seen from both its faces, so each gives half of its weight.
    weights = np.concatenate([np.full(2 * size, 2.0), np.ones(size), valence**2])
    matrix = csr_array((weights, (rows, columns)), shape=(count, count))
    matrix.data /= np.repeat(np.maximum(valence * (valence + 5), 1), np.diff(matrix.indptr))
    return matrix


def pull_limit(faces, aims, tangents, swell, center, rounds, gain):
    """Vertices whose limits are at their aims, nearly.

    Args:
        faces: (F, 4) a closed mesh.
        aims: (V, 3) where the limits are to be.
        tangents: (V, 3) unit vector along which a vertex is not moved; 0 for none.
        swell: (V, 2) by how much a tube's radius grows per length along the tangent, ahead and behind.
        center: (V, 3) the place of the axis that an aim belongs to.
        rounds: How often.
        gain: (V,) share of what is missing that a vertex is moved by.
    """
    stencils = limit_stencils(faces, len(aims))
    radial = aims - center
    farthest = FARTHEST * np.linalg.norm(radial, axis=1)
    points = aims.copy()
    for _ in range(rounds):
        off = stencils @ points - center
        along = np.einsum("vc,vc->v", off, tangents)[:, None]
        grown = 1 + np.where(along > 0, swell[:, :1], swell[:, 1:]) * along
        missing = radial * np.clip(grown, 0.5, 2.0) - (off - along * tangents)
        moved = points + gain[:, None] * missing - aims
        # Where rows are very uneven in a bend, what is off is not what to move by: then rather round the bend off.
        size = np.linalg.norm(moved, axis=1)
        points = aims + moved * np.minimum(1, farthest / np.maximum(size, 1e-300))[:, None]
    return points


def walk(tubes, at, start_m, clearance, thickest):
    """Arcs, whether they are outside, and parents' segments; at is a cage_exits._Nearest."""
    arc = start_m.copy()
    done = np.zeros(len(arc), bool)
    moving = np.arange(len(arc))
    for _ in range(MAX_STEPS):
        some = _Nearest(tubes=tubes, tube=at.tube[moving], parent=at.parent[moving], at=at.at[moving])
        disc = _disc(tubes, some, arc[moving], thickest or THICKEST)
        at.at[moving] = some.at
        missing = disc.near.radius_m - disc.distance_m
        if thickest is not None:
            reach = CAGE_FACTOR * (disc.near.radius_m + disc.sideways * disc.radius_m)
            missing = reach + clearance[moving] * disc.radius_m - disc.distance_m
        end = tubes.length_m[at.tube[moving]]
        missing[missing <= SKIN * disc.near.radius_m] = 0
        done[moving] = missing <= 0
        on = (missing > 0) & (arc[moving] < end)
        step = np.maximum(0.6 * missing if thickest is not None else missing, 0.04 * disc.near.radius_m)
        arc[moving[on]] = np.minimum(arc[moving[on]] + step[on], end[on])
        moving = moving[on]
        if not len(moving):
            break
    return arc, done, at.at


def carry_references(direction, first, counts, reference):
    """Fill reference, one segment a step."""
    longest_first = np.argsort(-counts, kind="stable")
    ascending = -counts[longest_first]
    for step in range(1, int(counts.max(initial=1))):
        at = first[longest_first[: np.searchsorted(ascending, -step, side="left")]] + step
        turned = rotate_between(direction[at - 1], direction[at], reference[at - 1])
        turned -= np.sum(turned * direction[at], axis=1, keepdims=True) * direction[at]
        reference[at] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return reference
