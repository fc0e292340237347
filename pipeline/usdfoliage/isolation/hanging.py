"""What of a plant hangs over the edge of what it stands on, lower than that. Our own.

A floor that is seen all around has nothing of a plant below it: what is measured there are reflections. A table, a
shelf or a balcony ends, and what trails over its edge is below its level.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening, label
from scipy.spatial import ConvexHull, QhullError, cKDTree

from usdfoliage.geometry.point_cells import touching_parts

_FEW = 12  # cells of a floor, of which no edge is found
_COARSER = 2.5  # cells' widths, in which the density of the floor is measured
_IN_CELL, _MIN_IN_CELL = 6.0, 2  # points of a floor in a cell: on the mean, and for it to be seen there
_WIDEST = 4.0  # times, that cells may grow where points are few
_LARGE = 0.25  # of the largest part of the floor: smaller ones are none of it
_SQUARE = np.ones((3, 3), bool)


@dataclass(frozen=True, kw_only=True)
class HangingSettings:
    """What hangs from a plant."""

    cell: float = 0.02  # of the cameras' distance, in which the floor's edge is found
    reach: float = 2.0  # of the same, around the focus, within which the floor is looked at
    max_green: float = 0.3  # share of a floor that is green: of lawns no edge is found
    wide: float = 1.4  # of the plant's reach to its sides, within which what hangs must be

    def __post_init__(self) -> None:
        if not (self.cell > 0 and self.reach > 0 and 0 <= self.max_green <= 1 and self.wide >= 1):
            raise ValueError(f"cell and reach must be above 0, max_green a share, wide at least 1, not {self}")


def find_hanging(
    low_m: NDArray[np.float64],
    is_level: NDArray[np.bool_],
    green: NDArray[np.bool_],
    plant_m: NDArray[np.float64],
    place_m: NDArray[np.float64],
    scale_m: float,
    gaps: tuple[float, float],
    settings: HangingSettings = HangingSettings(),
) -> NDArray[np.bool_]:
    """(N,) what is of the plant: green, beyond the floor's edge on all heights, and linked with the plant.

    Args:
        low_m: (N, 3), Y up, points of the floor's level and below.
        is_level: (N,), which are of the floor's level.
        green: (N,).
        plant_m: (M, 3), points of the plant over the floor.
        place_m: (3,), what the photographs are aimed at.
        scale_m: How far from it the cameras are.
        gaps: Of the same, without points: around pieces, and that is bridged between those of the plant.
        settings: What hangs.
    """
    none = np.zeros(len(low_m), bool)
    if not len(plant_m):
        return none
    beside_m = low_m[:, [0, 2]] - place_m[[0, 2]]
    seen = is_level & (np.hypot(*beside_m.T) < settings.reach * scale_m)
    if not seen.any() or green[seen].mean() > settings.max_green:
        return none
    edges = _find_edges(beside_m[seen & ~green], settings.cell * scale_m)
    if edges is None:
        return none
    beyond_m = np.full(len(low_m), -np.inf)
    for x, z, away_m in edges:  # of a convex floor
        np.maximum(beyond_m, beside_m[:, 0] * x + beside_m[:, 1] * z + away_m, out=beyond_m)
    chosen = np.flatnonzero(green & (beyond_m > settings.cell * scale_m / 2))
    if not len(chosen):
        return none
    piece = touching_parts(low_m[chosen], gaps[0] * scale_m)
    middle_m = np.quantile(plant_m[:, [0, 2]], [0.02, 0.98], axis=0).mean(axis=0)
    reach_m = settings.wide * float(np.hypot(*(plant_m[:, [0, 2]] - middle_m).T).max()) + gaps[1] * scale_m
    # What grows on the ground below begins within reach, but does not end there.
    within = np.hypot(*(low_m[chosen][:, [0, 2]] - middle_m).T) <= reach_m
    may_be = np.bincount(piece, within) >= 0.9 * np.bincount(piece)
    of_plant = np.zeros(len(may_be), bool)
    linked_m = plant_m
    while len(rest := np.flatnonzero((may_be & ~of_plant)[piece])):
        gap_m, _ = cKDTree(linked_m).query(low_m[chosen[rest]], distance_upper_bound=gaps[1] * scale_m)
        linked = np.unique(piece[rest[np.isfinite(gap_m)]])
        if not len(linked):
            break
        of_plant[linked] = True
        linked_m = low_m[chosen[of_plant[piece]]]
    none[chosen] = of_plant[piece]
    return none


def _find_edges(floor_m: NDArray[np.float64], cell_m: float) -> NDArray[np.float64] | None:
    """(E, 3) edges of a convex floor, outwards, x and z and distance; None where they are not found.

    Args:
        floor_m: (N, 2), x and z of the floor's points.
        cell_m: Width of cells, if the points are many.
    """
    if len(floor_m) < _FEW:
        return None
    corner_m = floor_m.min(axis=0) - 2 * cell_m
    coarse = np.unique(np.floor((floor_m - corner_m) / (_COARSER * cell_m)).astype(np.int64), axis=0)
    per_cell = len(floor_m) / (len(coarse) * _COARSER**2)  # in a cell
    grown = max(1.0, float(np.sqrt(_IN_CELL / per_cell)))
    if grown > _WIDEST:
        return None
    cell_m *= grown
    corner_m = floor_m.min(axis=0) - 2 * cell_m
    place = np.floor((floor_m - corner_m) / cell_m).astype(np.int64)
    counts = np.zeros(place.max(axis=0) + 3, np.int64)
    np.add.at(counts, (place[:, 0], place[:, 1]), 1)
    # Walls and what else crosses the level are thin there.
    parts, count = label(binary_opening(binary_closing(counts >= _MIN_IN_CELL, _SQUARE), _SQUARE), _SQUARE)
    if not count:
        return None
    sizes = np.bincount(parts.ravel())[1:]
    large = 1 + np.flatnonzero(sizes >= _LARGE * sizes.max())
    of_floor = corner_m + (np.argwhere(np.isin(parts, large)) + 0.5) * cell_m
    if len(of_floor) < _FEW:
        return None
    around_m = cell_m / 2 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    try:
        hull = ConvexHull((of_floor[:, None] + around_m).reshape(-1, 2))
    except QhullError:  # all on a line
        return None
    return np.asarray(hull.equations, np.float64)
