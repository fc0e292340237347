"""Single trees seen from above, with their heights and radii.

The thesis has the trunks given (Argudo, section 6.1); finding them is our own.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from usdfoliage.forest.crown_search import find_crowns
from usdfoliage.forest.raster import Raster, to_pixels

Floats = NDArray[np.float64]

LOWEST_M = 2.0  # trees that are lower are shrubs
TOPS = 4  # nearest to a pixel, of which one has it
CUT = 0.35  # of a crown's height: its radius ends there
LARGER = 1.2  # found radii that a crown is looked for in
NOISE_PX = 3  # side of the median that takes single wrong pixels out of a canopy
NOISE_M = 0.15  # median of what it changes on crowns, from which a canopy is noisy
HOLLOW_M = 1.5  # a pixel so much below the median of those around it is a hole of the canopy


@dataclass(frozen=True, kw_only=True)
class TreeTopSettings:
    """Which crowns are looked for."""

    radius_m: tuple[float, float] = (0.9, 7.0)  # the smallest and the largest

    def __post_init__(self) -> None:
        if not 0 < self.radius_m[0] < self.radius_m[1] < np.inf:
            raise ValueError(f"the radii of crowns must be two metres above 0 that increase, not {self.radius_m}")


@dataclass(frozen=True, kw_only=True, eq=False)
class TreeTops:
    """Trees as they are seen from above."""

    ground_m: Floats  # (N, 2), easting and northing
    height_m: Floats  # (N,), above the ground; NaN where no canopy shows it
    radius_m: Floats  # (N,), of the crown
    strength: Floats  # (N,), 0 to 1, how well the crown covers what is seen


def find_tops_of_canopy(canopy: Raster, settings: TreeTopSettings = TreeTopSettings()) -> TreeTops:
    """Trees of a canopy height model.

    Args:
        canopy: (H, W) metres above the ground; NaN counts as a hole.
        settings: Which crowns are looked for.
    """
    height_m = fill_canopy(canopy.values)
    crowns = find_crowns(replace(canopy, values=height_m), settings.radius_m)
    smooth_m = _without_noise(height_m)
    row, column = _cells_of(canopy, crowns.ground_m)
    reach_px = np.maximum(crowns.radius_m / 2, canopy.cell_m) / canopy.cell_m
    top_m = _highest_within(smooth_m, row, column, reach_px)
    tall = top_m >= LOWEST_M
    tops = TreeTops(
        ground_m=crowns.ground_m[tall],
        height_m=top_m[tall],
        radius_m=crowns.radius_m[tall],
        strength=crowns.score[tall],
    )
    return _measure_radii(canopy, height_m, tops)


def find_tops_of_photo(orthophoto: Raster, settings: TreeTopSettings = TreeTopSettings()) -> TreeTops:
    """Trees of an orthophoto alone; heights are not known.

    Args:
        orthophoto: (H, W, 3) linear colours, NaN where nothing is seen.
        settings: Which crowns are looked for.
    """
    crowns = find_crowns(orthophoto, settings.radius_m)
    return TreeTops(
        ground_m=crowns.ground_m,
        height_m=np.full(len(crowns.ground_m), np.nan),
        radius_m=crowns.radius_m,
        strength=crowns.score,
    )


def fill_canopy(canopy_m: NDArray[np.floating]) -> Floats:
    """(H, W) a canopy without holes of single pixels: what is NaN or far below those around it has their median."""
    known = np.isfinite(canopy_m)
    filled = np.where(known, canopy_m, 0.0).astype(np.float64)
    around_m = ndimage.median_filter(filled, NOISE_PX + 2, mode="nearest")
    hole = ~known | (filled < around_m - HOLLOW_M)
    return np.where(hole, around_m, filled)


def _without_noise(height_m: Floats) -> Floats:
    """(H, W) the median around each pixel of a noisy canopy; a smooth one as it is, whose tips a median cuts off."""
    smooth_m = np.asarray(ndimage.median_filter(height_m, NOISE_PX, mode="nearest"))
    tall = height_m >= LOWEST_M
    noise_m = float(np.median(np.abs(height_m - smooth_m)[tall])) if tall.any() else 0.0
    return smooth_m if noise_m > NOISE_M else height_m


def _cells_of(raster: Raster, ground_m: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the pixels in which places (N, 2) lie."""
    height, width = raster.values.shape[:2]
    column, row = np.clip(np.floor(to_pixels(raster, ground_m)).astype(np.int64), 0, [width - 1, height - 1]).T
    return row, column


def _highest_within(picture: Floats, row: NDArray[np.int64], column: NDArray[np.int64], reach_px: Floats) -> Floats:
    """(N,) the highest value within so many pixels (N,) of each place."""
    highest = np.zeros(len(row))
    for size in np.unique(np.ceil(reach_px)).astype(int).tolist():
        mine = np.ceil(reach_px) == size
        y, x = np.mgrid[-size : size + 1, -size : size + 1]
        largest = ndimage.maximum_filter(picture, footprint=x * x + y * y <= size * size, mode="nearest")
        highest[mine] = largest[row[mine], column[mine]]
    return highest


def _measure_radii(canopy: Raster, height_m: Floats, tops: TreeTops) -> TreeTops:
    """Tops with radii of the area that each crown has: pixels nearer to it than to others, by their radii, and high."""
    if not len(tops.ground_m):
        return tops
    row, column = np.nonzero(height_m > CUT * LOWEST_M)
    places = np.stack([column, row], axis=-1) + 0.5
    pixels = to_pixels(canopy, tops.ground_m)
    radius_px = tops.radius_m / canopy.cell_m
    count = min(TOPS, len(pixels))
    found = cKDTree(pixels).query(places, k=list(range(1, count + 1)))
    away_px, near = (np.asarray(each) for each in found)
    chosen = np.argmin(away_px / radius_px[near], axis=1)[:, None]
    top = np.take_along_axis(near, chosen, axis=1)[:, 0]
    off = np.take_along_axis(away_px, chosen, axis=1)[:, 0]
    mine = (off < LARGER * radius_px[top]) & (height_m[row, column] > CUT * tops.height_m[top])
    area_px = np.bincount(top[mine], minlength=len(pixels))
    measured_m = np.sqrt(area_px / np.pi) * canopy.cell_m
    return TreeTops(
        ground_m=tops.ground_m,
        height_m=tops.height_m,
        radius_m=np.where(area_px > 0, measured_m, tops.radius_m),
        strength=tops.strength,
    )
