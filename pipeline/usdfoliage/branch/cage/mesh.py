"""The mesh of a branch cage from the axes of its tubes, and the forks at which it crosses itself."""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage.check import find_fork_crossings
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.exits import Exits
from usdfoliage.branch.cage.faces import Faces, HolePlaces, build_faces, place_hole_vertices
from usdfoliage.branch.cage.fork_surroundings import Forks, gather_forks
from usdfoliage.branch.cage.holes import HOLE, Holes
from usdfoliage.branch.cage.limit import pull_limit
from usdfoliage.branch.cage.rings import NO_MARKS, RingMarks, Rings, Starts, build_rings, ring_swell
from usdfoliage.branch.cage.sectors import SIDES
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.settle import leading, settle
from usdfoliage.branch.cage.tubes import Floats, Ints, Path, Tubes

logger = logging.getLogger(__name__)

ROUNDS = 5  # of moving the limit to where it is to be
CAP_GAIN = 0.2  # a cap's edge is round, too
SHOULDER_GAIN = 0.4  # nor is the ring before it to bulge
HOLE_GAIN = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Built:
    """A cage, and all that it was made from."""

    tubes: Tubes
    exits: Exits
    holes: Holes
    rings: Rings
    places: HolePlaces
    points_m: Floats
    faces: Faces
    forks: Forks


def build_paths(
    paths: list[Path],
    tries: Ints,
    settings: BranchCageSettings,
    dropped: dict[int, DropReason],
    moving: NDArray[np.bool_] | None = None,
    marks: RingMarks = NO_MARKS,
) -> Built:
    """The mesh of these paths, which change in place.

    Args:
        paths: The axes.
        tries: (B,) how often each branch of the skeleton was tried already.
        settings: How close the mesh keeps to the axes.
        dropped: Takes the branches that end inside their parents.
        moving: (B,) branches that may be bent to where their holes are; all where it is not given.
        marks: Where rings are wanted.
    """
    exits, tubes, holes = settle(paths, tries, settings, dropped, moving)
    alive = tubes.parent < 0
    child = exits.tube[holes.exit]
    alive[child] = True
    start_m = np.zeros(len(tubes))
    start_m[exits.tube] = exits.free_arc_m
    radius_m, spacing_m = np.full(len(tubes), np.inf), 1.2 * tubes.radius_m[tubes.first]
    radius_m[child] = np.minimum(exits.free_radius_m[holes.exit], holes.half_across_m / HOLE)
    spacing_m[exits.tube] = 1.2 * exits.free_radius_m
    starts = Starts(alive=alive, arc_m=start_m, radius_m=radius_m, spacing_m=spacing_m)
    rings = build_rings(tubes, starts, holes, settings, marks)
    places = place_hole_vertices(tubes, holes)
    faces = build_faces(tubes, rings, holes, child)
    return Built(
        tubes=tubes,
        exits=exits,
        holes=holes,
        rings=rings,
        places=places,
        points_m=_pull(rings, places, faces, tubes.parent < 0),
        faces=faces,
        forks=gather_forks(tubes, exits, holes, rings, faces),
    )


def find_guilty(built: Built, carried_m: Floats) -> Ints:
    """The holes to try again: of two that cross the one that carries less, else the one that crosses its parent."""
    pairs = find_fork_crossings(built.points_m, built.faces.faces, built.forks.faces, built.forks.counts)
    owner = built.forks.owner
    fork = np.repeat(np.arange(len(built.forks.counts)), built.forks.counts)
    one, two = owner[pairs[:, 0]], owner[pairs[:, 1]]
    size = carried_m[leading(built.tubes, built.exits)[built.holes.exit]]
    both = (one >= 0) & (two >= 0)
    lesser = np.where(size[one] < size[two], one, two)
    single = np.maximum(one, two)
    single = np.where(single < 0, fork[pairs[:, 0]], single)
    guilty = np.unique(np.where(both, lesser, single))
    logger.debug("of %d forks %d cross", len(built.holes.exit), len(guilty))
    return guilty


def _pull(rings: Rings, places: HolePlaces, faces: Faces, roots: NDArray[np.bool_]) -> Floats:
    """Vertices of the cage: of the rings, then of the holes."""
    rows = len(rings.tube) * SIDES
    holes = places.points_m.reshape(-1, 3)
    swell = np.zeros((rows + len(holes), 2))
    swell[:rows] = np.repeat(ring_swell(rings.tube, rings.arc_m, rings.radius_m), SIDES, axis=0)
    center, tangent = np.zeros((2, rows + len(holes), 3))
    center[:rows] = np.repeat(rings.center_m, SIDES, axis=0)
    tangent[:rows] = np.repeat(rings.tangent, SIDES, axis=0)
    gain = np.ones(rows + len(holes))
    gain[rows:] = HOLE_GAIN
    by_ring = gain[:rows].reshape(-1, SIDES)
    feet = rings.first[roots[rings.tube[rings.first]]]
    by_ring[np.concatenate([rings.last - 1, feet + 1])] = SHOULDER_GAIN
    by_ring[np.concatenate([rings.last, feet])] = CAP_GAIN
    aims = np.concatenate([rings.points_m.reshape(-1, 3), holes])
    return pull_limit(faces.faces, aims, tangent, swell, center, ROUNDS, gain)
