"""Where the stems of a plant come out of the ground: dense places of its cloud seen from above.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 5.3: points are projected
onto the ground, and the densest clusters are roots; section 6.1: of a bush the k densest.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label, maximum_filter, uniform_filter

from usdfoliage.branch.tracing.ground import ground_height
from usdfoliage.branch.tracing.higher_feet import find_higher_feet

_BLUR_CELLS = 1.0
_MAX_CELLS = 400  # a side
_AROUND = 5  # cells a side, in which something rises from the ground
_FEW = 12  # points there, that may all lie low by chance


@dataclass(frozen=True, kw_only=True)
class RootSettings:
    """Which clusters are roots."""

    count: int | None = None  # the densest so many; None: those that stand out
    slab: float = 0.08  # of the height, from the ground, that is looked at
    cell_of_height: float = 0.008
    standing_out: float = 0.3  # of the densest, density of a root
    max_count: int = 12
    rise: float = 0.3  # of that slab, that a stem at a root rises at least: what lies on the ground has none

    def __post_init__(self) -> None:
        if self.count is not None and self.count < 1:
            raise ValueError(f"count must be at least 1, not {self.count}")
        if not (0 < self.slab <= 1 and self.cell_of_height > 0 and 0 < self.standing_out <= 1):
            raise ValueError(f"slab and standing_out must be in (0, 1], cell_of_height above 0, not {self}")


def find_roots(
    points_m: NDArray[np.float64],
    settings: RootSettings = RootSettings(),
    ground: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """(R, 3) roots of a plant without ground, the densest first.

    Args:
        points_m: (N, 3), Y up.
        settings: How many.
        ground: (3,), plane that was under the plant, as find_ground gives it: then heights are those above it.
    """
    above_m = points_m.copy()
    if ground is not None:
        above_m[:, 1] -= ground_height(ground, points_m)
    height_m = float(np.ptp(above_m[:, 1]))
    low = above_m[:, 1] <= above_m[:, 1].min() + settings.slab * height_m
    cell_m = _cell_side(points_m[low], height_m, settings)
    lower_m = _dense_places(above_m, low, cell_m, replace(settings, count=None))
    feet = find_higher_feet(above_m, _cell_side(points_m, height_m, settings), lower_m)
    if (feet & ~low).any():
        low |= feet
        cell_m = _cell_side(points_m[low], height_m, settings)
    return _dense_places(points_m, low, cell_m, settings)


def _cell_side(points_m: NDArray[np.float64], height_m: float, settings: RootSettings) -> float:
    side_m = float(np.ptp(points_m[:, [0, 2]], axis=0).max())
    return max(settings.cell_of_height * height_m, side_m / _MAX_CELLS, 1e-9)


def _dense_places(
    points_m: NDArray[np.float64], low: NDArray[np.bool_], cell_m: float, settings: RootSettings
) -> NDArray[np.float64]:
    """(R, 3) where the low ones of points (N, 3) are dense, seen from above."""
    slab = points_m[low]
    places = slab[:, [0, 2]]
    cell = np.floor((places - places.min(axis=0)) / cell_m).astype(np.int64) + 2
    if settings.count is None:
        at = cell[:, 0], cell[:, 1]
        top_m, counts = np.full(cell.max(axis=0) + 3, -np.inf), np.zeros(cell.max(axis=0) + 3)
        np.maximum.at(top_m, at, slab[:, 1])
        np.add.at(counts, at, 1.0)
        rises = maximum_filter(top_m, _AROUND)[at] > slab[:, 1].min() + settings.rise * settings.slab * np.ptp(
            points_m[:, 1]
        )
        rises |= _AROUND**2 * uniform_filter(counts, _AROUND)[at] < _FEW  # which show nothing
        if rises.any():  # the rest is ground that was left over, such as that in the plant's shadow
            slab, cell = slab[rises], cell[rises]
    density = np.zeros(cell.max(axis=0) + 3)
    np.add.at(density, (cell[:, 0], cell[:, 1]), 1.0)
    density = gaussian_filter(density, _BLUR_CELLS)
    # Stems next to each other part at a level of their own, so that several are looked at.
    clusters = _clusters_by_level(density, settings)
    member = clusters[cell[:, 0], cell[:, 1]]
    strength = np.array([density[clusters == number].max() for number in range(1, int(clusters.max()) + 1)])
    ranked = np.argsort(-strength, kind="stable")[: settings.count or settings.max_count] + 1
    roots_m = []
    for number in ranked:
        own = slab[member == number]
        if not len(own):
            continue
        base = own[own[:, 1] <= np.quantile(own[:, 1], 0.2)]
        roots_m.append([base[:, 0].mean(), own[:, 1].min(), base[:, 2].mean()])
    return np.array(roots_m).reshape(-1, 3)


def _clusters_by_level(density: NDArray[np.float64], settings: RootSettings) -> NDArray[np.int32]:
    """Cells of each cluster, numbered from 1; cells that are in none are 0."""
    top = float(density.max())
    if settings.count is None:
        return np.asarray(label(density >= settings.standing_out * top, np.ones((3, 3)))[0], np.int32)
    best = np.zeros(density.shape, np.int32)
    # From the middle outwards: near the top a thick stem is several clusters, near the bottom two stems are one.
    for share in (0.3, 0.2, 0.4, 0.1, 0.5, 0.05, 0.65, 0.02, 0.8):
        found, count = label(density >= share * top, np.ones((3, 3)))
        if count > int(best.max()):
            best = np.asarray(found, np.int32)
        if count >= settings.count:
            break
    return best
