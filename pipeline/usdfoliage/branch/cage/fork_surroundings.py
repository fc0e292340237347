"""The neighbourhood of each fork of a branch cage: what must not cross there."""

from dataclasses import dataclass

import numpy as np

from usdfoliage.branch.cage.exits import Exits
from usdfoliage.branch.cage.faces import Faces
from usdfoliage.branch.cage.holes import Holes
from usdfoliage.branch.cage.rings import Rings
from usdfoliage.branch.cage.sectors import SIDES
from usdfoliage.branch.cage.tubes import Floats, Ints, Tubes

CHILD_ROWS = 3  # rows of a branch that belong to its fork
BESIDE = 1.0  # parent radii of rows before and behind a fork that belong to it


@dataclass(frozen=True, kw_only=True, eq=False)
class Forks:
    """Faces near each of H forks, one list after another."""

    faces: Ints  # (sum of counts,)
    owner: Ints  # (sum of counts,), hole that a face belongs to, -1 for the parent's rows
    counts: Ints  # (H,)


def gather_forks(tubes: Tubes, exits: Exits, holes: Holes, rings: Rings, faces: Faces) -> Forks:
    """The faces of each hole, the first rows of its branch, its parent's rows beside it, and its siblings there."""
    count = len(holes.exit)
    parent, child = holes.block_tube[holes.block], exits.tube[holes.exit]
    first_ring = np.full(len(tubes), -1)
    last_ring = np.full(len(tubes), -1)
    first_ring[rings.tube[rings.first]], last_ring[rings.tube[rings.last]] = rings.first, rings.last
    arcs = holes.block_arcs_m[holes.block]
    beside = BESIDE * exits.parent_radius_m[holes.exit]
    passed = exits.free_parent_arc_m[holes.exit]
    low_m = np.minimum(arcs[:, 0], passed) - beside
    high_m = np.maximum(arcs[:, 2], passed) + beside
    low = np.maximum(_ring_before(tubes, rings, parent, low_m), first_ring[parent])
    high = np.minimum(_ring_before(tubes, rings, parent, high_m) + 1, last_ring[parent])
    row_of, rows = _ranges(low, high)
    parts = [(row_of, faces.row_face[rows], np.full(len(rows), -1))]

    # Siblings, the fork's own branch among them: all whose holes are within that stretch.
    key = parent * tubes.stride_m + holes.arc_m
    order = np.argsort(key, kind="stable")
    start = np.searchsorted(key[order], parent * tubes.stride_m + np.maximum(low_m, 0))
    upto = parent * tubes.stride_m + np.minimum(high_m, tubes.length_m[parent])
    end = np.searchsorted(key[order], upto, side="right")
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    fork, sibling = _ranges(np.minimum(start, rank), np.maximum(end, rank + 1))
    sibling = order[sibling]
    parts.append((fork, faces.edge_face[sibling], sibling))
    parts.append((fork, faces.loft_face[sibling], sibling))
    first = first_ring[child[sibling]]
    until = np.minimum(first + CHILD_ROWS, last_ring[child[sibling]])
    of, ring = _ranges(first, until)
    parts.append((fork[of], faces.row_face[ring], sibling[of]))

    number = np.concatenate([np.repeat(of, SIDES) for of, _, _ in parts])
    near = np.concatenate([group.reshape(-1) for _, group, _ in parts])
    owner = np.concatenate([np.repeat(own, SIDES) for _, _, own in parts])
    kept = near >= 0
    number, near, owner = number[kept], near[kept], owner[kept]
    order = np.argsort(number, kind="stable")
    return Forks(faces=near[order], owner=owner[order], counts=np.bincount(number, minlength=count))


def _ring_before(tubes: Tubes, rings: Rings, tube: Ints, arc_m: Floats) -> Ints:
    key = rings.tube * tubes.stride_m + rings.arc_m
    return np.searchsorted(key, tube * tubes.stride_m + np.clip(arc_m, 0, tubes.length_m[tube]), side="right") - 1


def _ranges(low: Ints, high: Ints) -> tuple[Ints, Ints]:
    """All numbers from low up to before high, and which range each is of."""
    counts = np.maximum(high - low, 0)
    of = np.repeat(np.arange(len(low)), counts)
    return of, np.arange(len(of)) - (np.cumsum(counts) - counts)[of] + low[of]
