"""Single trees seen from above: blobs of a canopy height model, or of an orthophoto's chroma, at the scale of crowns.

A crown is a bright disc of radius r in either picture. The scale-normalized Laplacian of Gaussians answers it most at
σ = r / √2, so its maxima over place and scale are crowns with their radii (Lindeberg, Feature detection with automatic
scale selection, 1998). The thesis has the trunks given (Argudo, section 6.1); finding them is our own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from usdfoliage.forest.raster import Raster, to_ground, to_pixels

Floats = NDArray[np.float64]

SCALES = 11  # radii that are looked for, in even ratios
WEAKEST_M = 0.5  # response of the least crown in a canopy: half a metre above what is around it
STANDS_OUT = 0.15  # of a tree's height, that its answer is at least; a disc of that height has .74
LOWEST_M = 2.0  # trees that are lower are shrubs
OVERLAP = 0.8  # radii of a crown, within which there is no weaker one
EDGE = 1.15  # radii of a crown, within which its edge answers too
WEAKER = 0.55  # of the crown's own answer, that its edge's is at most
NOISE_PX = 3  # side of the median that takes single wrong pixels out of a canopy
HOLLOW_M = 1.5  # a pixel so much below the median of those around it is a hole of the canopy
TOPS = 4  # nearest to a pixel, of which one has it
CUT = 0.35  # of a crown's height above what is around it: its radius ends there
LARGER = 1.6  # radii of its blob that a crown is looked for in


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
    strength: Floats  # (N,), of the answer, in the picture's units


def find_tops_of_canopy(canopy: Raster, settings: TreeTopSettings = TreeTopSettings()) -> TreeTops:
    """Trees of a canopy height model.

    Args:
        canopy: (H, W) metres above the ground; NaN counts as a hole.
        settings: Which crowns are looked for.
    """
    height_m = fill_canopy(canopy.values)
    cell_m = canopy.cell_m
    row, column, radius_m, strength = _find_blobs(height_m, cell_m, settings, WEAKEST_M)
    pixels = np.stack([column, row], axis=-1) + 0.5
    smooth_m = ndimage.median_filter(height_m, NOISE_PX, mode="nearest")
    top_m = _highest_within(smooth_m, row, column, np.maximum(radius_m / 2, cell_m) / cell_m)
    tall = (top_m >= LOWEST_M) & (strength >= STANDS_OUT * top_m)
    tops = TreeTops(
        ground_m=to_ground(canopy, pixels[tall]),
        height_m=top_m[tall],
        radius_m=radius_m[tall],
        strength=strength[tall],
    )
    return _measure_radii(canopy, height_m, tops)


def find_tops_of_photo(picture: Raster, settings: TreeTopSettings = TreeTopSettings()) -> TreeTops:
    """Trees of an orthophoto alone, from its colours; heights are not known.

    Args:
        picture: (H, W) crowns are bright in it, as crown_contrast makes it.
        settings: Which crowns are looked for.
    """
    values = np.nan_to_num(np.asarray(picture.values, np.float64))
    row, column, radius_m, strength = _find_blobs(values, picture.cell_m, settings, 0.0)
    strong = strength > _split(strength)
    pixels = np.stack([column[strong], row[strong]], axis=-1) + 0.5
    return TreeTops(
        ground_m=to_ground(picture, pixels),
        height_m=np.full(len(pixels), np.nan),
        radius_m=radius_m[strong],
        strength=strength[strong],
    )


def fill_canopy(canopy_m: NDArray[np.floating]) -> Floats:
    """(H, W) a canopy without holes of single pixels: what is NaN or far below those around it has their median."""
    known = np.isfinite(canopy_m)
    filled = np.where(known, canopy_m, 0.0).astype(np.float64)
    around_m = ndimage.median_filter(filled, NOISE_PX + 2, mode="nearest")
    hole = ~known | (filled < around_m - HOLLOW_M)
    return np.where(hole, around_m, filled)


def _find_blobs(
    picture: Floats, cell_m: float, settings: TreeTopSettings, weakest: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]:
    """Row, column, radius in metres and strength of discs that are brighter than what is around them."""
    radii_m = np.geomspace(max(settings.radius_m[0], cell_m), max(settings.radius_m[1], 2 * cell_m), SCALES)
    answers = np.stack(
        [
            -((radius_m / cell_m) ** 2 / 2) * ndimage.gaussian_laplace(picture, radius_m / cell_m / np.sqrt(2))
            for radius_m in radii_m
        ]
    )
    highest = answers == ndimage.maximum_filter(answers, size=3, mode="nearest")
    scale, row, column = np.nonzero(highest & (answers > weakest))
    strength = answers[scale, row, column]
    radius_m = radii_m[scale]
    places_m = np.asarray(np.stack([column, row], axis=-1) * cell_m, np.float64)
    stays = _strongest(places_m, OVERLAP * radius_m, strength)
    stays = stays[~_on_edges(places_m[stays], radius_m[stays], strength[stays])]
    return row[stays], column[stays], radius_m[stays], strength[stays]


def _strongest(places_m: Floats, reach_m: Floats, strength: Floats) -> NDArray[np.int64]:
    """Which places (N, 2) stay when each, from the strongest on, takes away the others within its reach (N,)."""
    gone = np.zeros(len(places_m), bool)
    if not len(places_m):
        return np.flatnonzero(~gone)
    tree = cKDTree(places_m)
    near = tree.query_ball_point(places_m, reach_m)
    kept = []
    for number in np.lexsort([places_m[:, 0], places_m[:, 1], -strength]).tolist():
        if not gone[number]:
            kept.append(number)
            gone[near[number]] = True
    return np.sort(np.array(kept, np.int64))


def _on_edges(places_m: Floats, radius_m: Floats, strength: Floats) -> NDArray[np.bool_]:
    """(N,) which answers are of the edge of a larger crown: small, within it, and far weaker."""
    edge = np.zeros(len(places_m), bool)
    if len(places_m) < 2:
        return edge
    tree = cKDTree(places_m)
    pairs = tree.query_pairs(EDGE * float(radius_m.max()), output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    small, large = pairs.T
    away_m = np.linalg.norm(places_m[small] - places_m[large], axis=1)
    within = (away_m < EDGE * radius_m[large]) & (radius_m[small] < radius_m[large])
    edge[small[within & (strength[small] < WEAKER * strength[large])]] = True
    return edge


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


def _split(strength: Floats) -> float:
    """Where answers part in two: those of crowns, and the weak ones of what is between them (Otsu)."""
    if len(strength) < 2:
        return 0.0
    ordered = np.sort(strength)
    count = np.arange(1, len(ordered))
    below = np.cumsum(ordered)[:-1] / count
    above = (ordered.sum() - np.cumsum(ordered)[:-1]) / (len(ordered) - count)
    apart = count * (len(ordered) - count) * (below - above) ** 2
    best = int(np.argmax(apart))
    return float((ordered[best] + ordered[best + 1]) / 2)
