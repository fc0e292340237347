"""Blades of grass near the camera of a shot: where clumps of them stand.

The thesis draws a texture of grass on vegetated ground near the camera (section 6.4.2), and leaves blades for later.
Ours: clumps stand in blue noise whose every beginning is spread evenly, so that fewer of them, as the distance asks
for, leave no holes; what are fewer are wider, and the last ones are lower, so that no edge is seen.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.forest.raster import Raster, is_inside, sample_bilinear
from usdfoliage.forest.shots import CameraPath, is_in_view

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CELL_M = 1.0  # side of the squares of ground whose distance from the camera is asked
PATCH_CELLS = 4  # along the square of blue noise that repeats
THROWN = 3  # places that are thrown for each that a patch has
FADE = 0.35  # of the distance, over whose end clumps become lower and none
LOWEST = 0.4  # of their height, that the last ones are high
EDGE = 0.35, 0.65  # range of the share of vegetation from which on a clump stands: pixels of classes are not seen
MIN_CLUMPS, MAX_CLUMPS = 1_000, 10_000_000  # fewer would be none
LONGEST_M = 1_000.0
PATCH_SEED, CLUMP_SEED = 6, 7  # beside those of planting.py


@dataclass(frozen=True, kw_only=True)
class GrassSettings:
    """How dense, how high and how far from the camera grass is."""

    distance_m: float = 30.0  # from the camera, beyond which there is none
    max_clumps: int = 100_000  # of a shot; where there would be more, all distances are shorter
    clumps_per_m2: float = 200.0  # near the camera
    near_m: float = 4.0  # up to which they are so dense; beyond it, as many as the distance is in it
    widest: float = 3.0  # times as wide as near the camera, where they are fewer
    height_m: tuple[float, float] = (0.05, 0.12)

    def __post_init__(self) -> None:
        if not 0 < self.distance_m <= LONGEST_M:
            raise ValueError(f"grass_distance must be above 0 and at most {LONGEST_M:g} m, not {self.distance_m:g}")
        if not MIN_CLUMPS <= self.max_clumps <= MAX_CLUMPS:
            raise ValueError(f"max_grass_clumps must be {MIN_CLUMPS:,} to {MAX_CLUMPS:,}, not {self.max_clumps}")
        if not 0 < self.clumps_per_m2 <= 10_000:
            raise ValueError(f"clumps_per_m2 must be above 0 and at most 10,000, not {self.clumps_per_m2:g}")
        if not (0 < self.near_m < np.inf and 1 <= self.widest < np.inf):
            raise ValueError(f"near_m must be above 0 and widest at least 1, not {self.near_m:g} and {self.widest:g}")
        if not 0 < self.height_m[0] <= self.height_m[1] < np.inf:
            raise ValueError("height_m must be two lengths above 0, the smaller first")


@dataclass(frozen=True, kw_only=True, eq=False)
class GrassClumps:
    """Clumps of blades (N,), in the frame of the terrain."""

    ground_m: Floats  # (N, 2) easting and northing
    elevation_m: Floats  # (N,) of the ground there
    slope: Floats  # (N, 2) of the ground, metres up by metre to the east and to the north
    across: Floats  # (N,) times as wide as a clump near the camera
    height_m: Floats  # (N,) of its highest blade
    turn_deg: Floats  # (N,) about the vertical
    form: Floats  # (N,) from 0 to below 1, which of several clumps it is
    shade: Floats  # (N,) about 1, how light it is beside others

    def __len__(self) -> int:
        return len(self.ground_m)


def place_clumps(
    vegetated: Raster,
    ground_height: Callable[[Floats], Floats],
    path: CameraPath,
    asset_from_ground: Floats,
    seed: int,
    margin: float,
    settings: GrassSettings = GrassSettings(),
) -> GrassClumps:
    """Clumps on the vegetated ground that a camera sees from near.

    Args:
        vegetated: (H, W), 1 where plants of any kind are, 0 elsewhere.
        ground_height: Heights (N,) of places (N, 2), easting and northing; metres, NaN where there is no ground.
        path: Of the camera, in the asset's frame.
        asset_from_ground: (4, 4), column vectors, from easting, northing and height to the asset's frame; no scale.
        seed: Of the draws.
        margin: Of the picture's width and height, beyond its edges, where clumps are kept.
        settings: How many.
    """
    eye_m = _eyes_on_ground(path, asset_from_ground)
    cell = _cells_near(vegetated, eye_m, settings.distance_m)
    middle_m: Floats = CELL_M * (cell + np.float64(0.5))
    # A cell of half the vegetation has half of the clumps, about.
    covered = np.clip(sample_bilinear(vegetated, middle_m), 0, 1) if len(cell) else np.zeros(0)
    cell, middle_m, covered = cell[covered > 0], middle_m[covered > 0], covered[covered > 0]
    place_m = _in_asset(middle_m, ground_height(middle_m), asset_from_ground)
    away_m = _nearest_seen(cell, place_m, eye_m, path, settings, margin)
    shorter = _shorter(away_m, covered, settings)
    share = clump_share(away_m / shorter, settings)
    ground_m, rank, of_cell = _scatter(cell, share, seed, settings)
    rng = np.random.default_rng([seed, CLUMP_SEED])
    draws = rng.random((5, len(ground_m)))
    edge = EDGE[0] + (EDGE[1] - EDGE[0]) * draws[0]
    step_m = CELL_M / 4
    around_m = [ground_height(ground_m + step_m * np.array(step)) for step in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    slope = np.stack([around_m[0] - around_m[1], around_m[2] - around_m[3]], axis=-1) / (2 * step_m)
    elevation_m = ground_height(ground_m)
    stays = is_inside(vegetated, ground_m) & np.isfinite(slope).all(axis=1) & np.isfinite(elevation_m)
    stays[stays] = sample_bilinear(vegetated, ground_m[stays]) > edge[stays]
    own = np.flatnonzero(stays)
    if len(own) > settings.max_clumps:
        first = np.argsort(rank[own] / share[of_cell[own]], kind="stable")
        own = own[np.sort(first[: settings.max_clumps])]
    ground_m, draws, reached_m = ground_m[own], draws[:, own], away_m[of_cell[own]] / shorter
    low_m, high_m = settings.height_m
    return GrassClumps(
        ground_m=ground_m,
        elevation_m=elevation_m[own],
        slope=slope[own],
        across=np.clip(reached_m / settings.near_m, 1, settings.widest),
        height_m=(low_m + (high_m - low_m) * draws[1]) * (LOWEST + (1 - LOWEST) * _fade(reached_m, settings)),
        turn_deg=360 * draws[2],
        form=draws[3],
        shade=0.85 + 0.3 * draws[4],
    )


def clump_share(away_m: Floats, settings: GrassSettings) -> Floats:
    """(N,) how many clumps of those near the camera stand at a distance (N,), 0 to 1."""
    near = np.minimum(settings.near_m / np.maximum(away_m, 1e-9), 1.0)
    return np.asarray(near * _fade(away_m, settings))


def even_places(count: int, side: float, rng: np.random.Generator) -> Floats:
    """(count, 2) places in a square that repeats, in an order whose every beginning is spread evenly.

    Each place is that of many which is farthest from those before it (Eldar and others, The farthest point strategy for
    progressive image sampling, 1997).
    """
    x, y = thrown = rng.uniform(0, side, (2, THROWN * count))
    away = np.full(len(x), np.inf)  # squared
    order = np.zeros(count, np.int64)
    for number in range(1, count):
        last = order[number - 1]
        square = np.zeros(len(x))
        for place in (x, y):
            offset = np.abs(place - place[last])
            np.minimum(offset, side - offset, out=offset)
            offset *= offset
            square += offset
        np.minimum(away, square, out=away)
        order[number] = np.argmax(away)
    return np.ascontiguousarray(thrown[:, order].T)


def _fade(away_m: Floats, settings: GrassSettings) -> Floats:
    """(N,) from 1 to 0 over the end of the distance."""
    return np.asarray(np.clip((1 - away_m / settings.distance_m) / FADE, 0, 1))


def _eyes_on_ground(path: CameraPath, asset_from_ground: Floats) -> Floats:
    """(F, 2) easting and northing of the camera."""
    eye = np.column_stack([path.eye_m, np.ones(len(path.eye_m))])
    return np.asarray((eye @ np.linalg.inv(asset_from_ground).T)[:, :2])


def _in_asset(ground_m: Floats, elevation_m: Floats, asset_from_ground: Floats) -> Floats:
    """(N, 3)."""
    return np.asarray((np.column_stack([ground_m, elevation_m, np.ones(len(ground_m))]) @ asset_from_ground.T)[:, :3])


def _cells_near(vegetated: Raster, eye_m: Floats, distance_m: float) -> Ints:
    """(K, 2) column and row of the cells of the raster that are about so near to a place (F, 2), row by row."""
    height, width = vegetated.values.shape
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]], np.float64)
    corners_m = corners @ vegetated.ground_from_pixel[:, :2].T + vegetated.ground_from_pixel[:, 2]
    low = np.floor(corners_m.min(axis=0) / CELL_M).astype(np.int64)
    high = np.ceil(corners_m.max(axis=0) / CELL_M).astype(np.int64)
    beside = (eye_m < CELL_M * low - distance_m) | (eye_m > CELL_M * high + distance_m)
    eye_m = eye_m[~beside.any(axis=1)]
    if not len(eye_m):
        return np.zeros((0, 2), np.int64)
    stride_m = max(distance_m / 4, CELL_M)
    stops_m = stride_m * (np.unique(np.floor(eye_m / stride_m), axis=0) + 0.5)
    reach = int(np.ceil((distance_m + stride_m) / CELL_M))
    window = np.arange(-reach, reach + 1)
    wide = int(high[0] - low[0])
    keys = np.zeros(0, np.int64)
    for some in np.array_split(stops_m, max(1, len(stops_m) * len(window) ** 2 // 4_000_000)):
        middle = np.floor(some / CELL_M).astype(np.int64) - low
        column = (middle[:, 0, None] + window)[:, None, :]
        row = (middle[:, 1, None] + window)[:, :, None]
        inside = (column >= 0) & (column < wide) & (row >= 0) & (row < high[1] - low[1])
        keys = np.union1d(keys, (row * wide + column)[inside])
    return np.stack([keys % wide, keys // wide], axis=-1) + low


def _nearest_seen(
    cell: Ints, place_m: Floats, eye_m: Floats, path: CameraPath, settings: GrassSettings, margin: float
) -> Floats:
    """(K,) how near the camera is to a cell, of the frames that see it; infinite where none does within the distance.

    Args:
        cell: (K, 2) column and row, row by row.
        place_m: (K, 3) of their middles, in the asset's frame.
        eye_m: (F, 2) easting and northing of the camera.
        path: Of the camera.
        settings: With the distance.
        margin: Beyond the edges of the picture.
    """
    nearest_m = np.full(len(cell), np.inf)
    if not len(cell):
        return nearest_m
    wide = int(np.ptp(cell[:, 0])) + 1
    first, last = cell.min(axis=0), cell.max(axis=0)
    key = (cell[:, 1] - first[1]) * wide + cell[:, 0] - first[0]  # rises
    reach = int(np.ceil(settings.distance_m / CELL_M))
    around = CELL_M / np.sqrt(2) + settings.height_m[1] * settings.widest  # radius of what stands in a cell
    for number in range(len(path.frame)):
        # Beside the cells a camera may be anywhere, so that its own cell is no whole number that fits.
        middle = np.clip(np.floor(eye_m[number] / CELL_M), first - 2 * reach, last + 2 * reach).astype(np.int64) - first
        rows = middle[1] + np.arange(-reach, reach + 1)
        ends = np.clip(middle[0] + np.array([-reach, reach + 1]), 0, wide)
        begin, end = (np.searchsorted(key, rows * wide + each) for each in ends)
        own = np.concatenate([np.arange(a, b) for a, b in zip(begin.tolist(), end.tolist(), strict=True)])
        away_m = np.linalg.norm(place_m[own] - path.eye_m[number], axis=1)
        own, away_m = own[away_m < settings.distance_m], away_m[away_m < settings.distance_m]
        seen = is_in_view(place_m[own], np.full(len(own), around), path, number, margin)
        nearest_m[own[seen]] = np.minimum(nearest_m[own[seen]], away_m[seen])
    return nearest_m


def _shorter(away_m: Floats, covered: Floats, settings: GrassSettings) -> float:
    """By what all distances are multiplied, so that there are no more clumps than may be; at most 1."""

    def count(factor: float) -> float:
        return float(settings.clumps_per_m2 * CELL_M**2 * (covered * clump_share(away_m / factor, settings)).sum())

    low, high = 0.0, 1.0
    if count(high) <= settings.max_clumps:
        return 1.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if count(middle) <= settings.max_clumps else (low, middle)
    return max(low, 1e-6)


def _scatter(cell: Ints, share: Floats, seed: int, settings: GrassSettings) -> tuple[Floats, Floats, Ints]:
    """Places (N, 2) in cells (K, 2) of which each has a share (K,), their ranks (N,) from 0 to 1, and their cells."""
    side_m = PATCH_CELLS * CELL_M
    count = max(1, round(settings.clumps_per_m2 * side_m**2))
    places_m = even_places(count, side_m, np.random.default_rng([seed, PATCH_SEED]))
    rank = (np.arange(count) + 0.5) / count
    column, row = np.minimum(places_m // CELL_M, PATCH_CELLS - 1).astype(np.int64).T
    own_cell = row * PATCH_CELLS + column
    order = np.lexsort([rank, own_cell])
    begin = np.searchsorted(own_cell[order], np.arange(PATCH_CELLS**2 + 1))
    within_m = (places_m - CELL_M * np.stack([column, row], axis=-1))[order]
    rank = rank[order]
    of_patch = (cell[:, 1] % PATCH_CELLS) * PATCH_CELLS + cell[:, 0] % PATCH_CELLS
    # Ranks rise within a cell of the patch: made to rise over all of them, one search finds how many a share has.
    rising = np.repeat(np.arange(PATCH_CELLS**2), np.diff(begin)) * 2 + rank
    drawn = np.searchsorted(rising, of_patch * 2 + share) - begin[of_patch]
    of_cell = np.repeat(np.arange(len(cell)), drawn)
    number = np.arange(len(of_cell)) - np.repeat(np.cumsum(drawn) - drawn, drawn) + begin[of_patch][of_cell]
    return CELL_M * cell[of_cell] + within_m[number], rank[number], of_cell
