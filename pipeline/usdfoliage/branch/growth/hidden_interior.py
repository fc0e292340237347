"""The inside of a crown that nobody saw: points in it, for branches to grow towards.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 6.1, figure 8: Poisson-disk
samples inside the convex hull of the crown. That only what foliage hides from all sides counts, and not the air between
branches that were seen, is ours.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.geometry.disks import choose_disks

_MIN_POINTS = 4  # that have an inside
_SIDES = 128  # planes around a crown
_TRIES = 3.0  # places tried for each disk that fits
_MAX_TRIES = 400_000
_MAX_CELLS = 160  # along the longest side
_FAR_APART = 37  # directions from one that is looked in to the next: no divisor of how many there are


@dataclass(frozen=True, kw_only=True)
class HiddenSettings:
    """What is hidden; lengths in internodes."""

    spacing: float = 2.0  # between the points
    clear: float = 2.0  # farthest from a point of the cloud that is still seen
    cell: float = 2.0  # of the grid in which sight is blocked
    blocked: float = 0.9  # share of directions

    def __post_init__(self) -> None:
        if not (self.spacing > 0 and self.clear >= 0 and self.cell > 0 and 0 < self.blocked <= 1):
            raise ValueError("spacing and cell must be above 0, clear not below, blocked in (0, 1]")


def find_hidden(
    points_m: NDArray[np.float64],
    internode_m: float,
    spacing_m: float,
    settings: HiddenSettings = HiddenSettings(),
    seed: int = 0,
) -> NDArray[np.float64]:
    """(M, 3) points evenly spread where the cloud of a crown hides what is inside; none where it is seen through.

    Args:
        points_m: (N, 3), of the plant.
        internode_m: Of the plant.
        spacing_m: Between points of the cloud: a finer grid would have gaps between them.
        settings: How.
        seed: Of where points lie.
    """
    if len(points_m) < _MIN_POINTS:
        return np.zeros((0, 3))
    rng = np.random.default_rng(seed)
    apart_m = settings.spacing * internode_m
    low_m, size_m = points_m.min(axis=0), np.ptp(points_m, axis=0)
    tries = int(min(_MAX_TRIES, _TRIES * size_m.prod() / apart_m**3))
    places_m = low_m + rng.random((tries, 3)) * size_m
    places_m = places_m[_within(places_m, points_m)]
    clear_m = settings.clear * internode_m
    near_m = cKDTree(points_m).query(places_m, distance_upper_bound=clear_m, workers=-1)[0]
    places_m = places_m[~np.isfinite(near_m)]
    places_m = places_m[choose_disks(places_m, apart_m, seed)]
    cell_m = max(settings.cell * internode_m, 2 * spacing_m, float(size_m.max()) / _MAX_CELLS)
    return places_m[blocked_share(places_m, points_m, cell_m, settings.blocked) >= settings.blocked]


def _within(places_m: NDArray[np.float64], points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(M,) places (M, 3) inside the convex hull of points, as many directions show it; a few are a little outside."""
    turn = np.pi * (1 + 5**0.5) * np.arange(_SIDES)  # evenly over the sphere, as the seeds of a sunflower
    height = 1 - (2 * np.arange(_SIDES) + 1) / _SIDES
    across = np.sqrt(1 - height**2)
    sides = np.column_stack([across * np.cos(turn), height, across * np.sin(turn)])
    inside = np.ones(len(places_m), bool)
    for side in sides:
        inside &= places_m @ side <= (points_m @ side).max()
    return inside


def blocked_share(
    places_m: NDArray[np.float64], points_m: NDArray[np.float64], cell_m: float, min_share: float = 0.0
) -> NDArray[np.float64]:
    """(M,) share of the directions in which points (N, 3), as cells of a grid, stand before a place (M, 3).

    Args:
        places_m: (M, 3).
        points_m: (N, 3).
        cell_m: Of the grid.
        min_share: Where the share cannot come to this, the share is only known to be less.
    """
    both_m = np.concatenate([points_m, places_m])
    low_m = both_m.min(axis=0) - cell_m
    shape = np.floor((both_m.max(axis=0) - low_m) / cell_m).astype(np.int64) + 2
    taken = np.zeros(shape, bool)
    taken[tuple(np.floor((points_m - low_m) / cell_m).astype(np.int64).T)] = True
    directions = np.array(
        [direction for direction in product((-2, -1, 0, 1, 2), repeat=3) if max(map(abs, direction)) == 2], np.float64
    )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions[_FAR_APART * np.arange(len(directions)) % len(directions)]  # an open side shows soon
    blocked = np.zeros(len(places_m))
    for number, direction in enumerate(directions):
        at = (places_m - low_m) / cell_m
        before = np.zeros(len(places_m), bool)
        going = np.flatnonzero(blocked + len(directions) - number >= min_share * len(directions) - 1e-9)
        while len(going):
            at[going] += direction
            cell = np.floor(at[going]).astype(np.int64)
            going = going[((cell >= 0) & (cell < shape)).all(axis=1)]
            cell = np.floor(at[going]).astype(np.int64)
            hit = taken[tuple(cell.T)]
            before[going[hit]] = True
            going = going[~hit]
        blocked += before
    return blocked / len(directions)
