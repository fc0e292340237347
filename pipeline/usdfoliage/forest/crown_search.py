"""Single crowns seen from above: places and radii where a canopy, or an orthophoto alone, looks like a crown.

A small network answers how well a disc covers a crown, by their intersection over union, for all places and radii; its
weights come from tools/learn_crowns.py. It knows no colour, only how colours differ from those around, so that it does
not depend on season and species. Where the sun is, is the direction for which the picture has the best crowns. Our own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage import _native
from usdfoliage.files.toml import parse_toml
from usdfoliage.forest.crown_tiles import (
    MARGIN,
    CrownTile,
    CrownWindow,
    Floats,
    Singles,
    cut_tiles,
    cut_windows,
    tile_places,
)
from usdfoliage.forest.raster import Raster, to_ground

_WEIGHTS = "crown_weights.toml"
RATIO = 2**0.25  # of a radius over the next smaller one
FINEST_PX = 1.5  # pixels in the smallest radius that is looked for
LOWEST_SCORE = {"photo": 0.42, "canopy": 0.44}  # of an intersection over union that is a crown
PROMISING = 0.28  # answer of one cell of four, around which all cells are asked
HINT = 0.25  # answer of a radius, beside which the next radii are asked
APART = 0.62  # of the sum of two radii, within which the better of two crowns stays
COVERED = 0.4  # of a crown's area, above which better ones hide it: a place between crowns is none
SAME = 0.4  # radii apart, within which answers are of one crown
SAME_SIZE = 0.4  # logarithm of the ratio of their radii, likewise
EDGE_PX = 0.05  # of a picture, within which no crown has its middle
LOWEST_M = 1.0  # of a canopy, where crowns are looked for
SUNS = 8  # directions that are tried
SUN_RADII_M = (1.7, 2.8, 4.8)  # of crowns that show where the sun is
SUN_WINDOWS, SUN_RADII = 4, 25  # parts of a picture that are looked at, and their side, of the largest such radius
SUN_STEP = 4  # cells from one that is asked there to the next


@dataclass(frozen=True, kw_only=True, eq=False)
class Crowns:
    """Crowns as a picture shows them."""

    ground_m: Floats  # (N, 2), easting and northing
    radius_m: Floats  # (N,)
    score: Floats  # (N,), intersection over union that a disc is answered to have with a crown, 0 to 1


def find_crowns(picture: Raster, radius_m: tuple[float, float]) -> Crowns:
    """Crowns of a picture, none of which lies within another.

    Args:
        picture: (H, W, 3) linear colours, NaN where nothing is seen; or (H, W) heights of a canopy, metres.
        radius_m: The smallest and the largest crown.
    """
    lowest = LOWEST_SCORE[_kind(picture)]
    sun_deg = find_sun(picture, radius_m) if picture.values.ndim == 3 else 0.0
    places, radii, scores = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)]
    asked_m = crown_radii(radius_m, picture.cell_m)
    for window in cut_windows(picture, asked_m[-1]):
        for radius, tile, score in _score_window(window, asked_m, sun_deg):
            row, column = np.nonzero((score > lowest) & (score >= cv2.dilate(score, np.ones((3, 3), np.uint8))))
            cell = np.stack([column, row], axis=-1) + _peak_offsets(score, row, column) + 0.5
            places.append(cell @ tile.pixel_from_cell[:, :2].T + tile.pixel_from_cell[:, 2])
            radii.append(np.full(len(row), radius))
            scores.append(score[row, column].astype(np.float64))
    # A peak beside the edge may lie a bit beyond it.
    size_px = np.array(picture.values.shape[1::-1])
    ground_m = to_ground(picture, np.clip(np.concatenate(places), EDGE_PX, size_px - EDGE_PX))
    return _best_of(ground_m, np.concatenate(radii), np.concatenate(scores), radius_m)


def find_sun(orthophoto: Raster, radius_m: tuple[float, float]) -> float:
    """Azimuth of the sun in degrees, clockwise from north: that for which a picture looks like crowns the best."""
    radii = [radius for radius in SUN_RADII_M if FINEST_PX * orthophoto.cell_m < radius and radius < 1.5 * radius_m[1]]
    radii = radii or [max(FINEST_PX * orthophoto.cell_m, radius_m[0])]
    side_px = max(1, int(SUN_RADII * radii[-1] / orthophoto.cell_m))
    step = 360 / SUNS
    answers = np.zeros(SUNS)
    for window in cut_windows(orthophoto, radii[-1], side_px, SUN_WINDOWS):
        for radius in radii:
            tiles = cut_tiles(window, radius, [number * step for number in range(SUNS)])
            answers += [_answer_of_sun(tile, radius) for tile in tiles]
    best = int(np.argmax(answers))
    before, here, after = answers[best - 1], answers[best], answers[(best + 1) % SUNS]
    bend = before - 2 * here + after
    return float((best + (0.5 * (before - after) / bend if bend < 0 else 0.0)) * step % 360)


def crown_radii(radius_m: tuple[float, float], cell_m: float) -> Sequence[float]:
    """The radii that are looked for, from small to large, of pixels so large."""
    low = max(radius_m[0], FINEST_PX * cell_m)
    count = max(1, int(np.ceil(np.log(max(radius_m[1] / low, 1.0)) / np.log(RATIO) + 0.5)))
    return [low * RATIO**number for number in range(count)]


def shared_area(away: Floats, one: Floats, other: Floats) -> Floats:
    """(N,) area that two circles share, so far from each other, with these radii; all (N,) of one unit."""
    d = np.maximum(away, 1e-9)
    a = np.arccos(np.clip((d**2 + one**2 - other**2) / (2 * d * one), -1, 1))
    b = np.arccos(np.clip((d**2 + other**2 - one**2) / (2 * d * other), -1, 1))
    return np.asarray(one**2 * (a - np.sin(2 * a) / 2) + other**2 * (b - np.sin(2 * b) / 2))


def _score_window(
    window: CrownWindow, asked_m: Sequence[float], sun_deg: float
) -> Iterator[tuple[float, CrownTile, Singles]]:
    """Of each radius the tile, and how well a disc around each of its cells (h, w) covers a crown, 0 to 1.

    Every second radius is asked everywhere, those between where one of its two neighbours is a bit like a crown.
    """
    hints: dict[int, tuple[float, NDArray[np.bool_]]] = {}
    for number in [*range(0, len(asked_m), 2), *range(1, len(asked_m), 2)]:
        (tile,) = cut_tiles(window, asked_m[number], [sun_deg])
        asked = _worth_asking(tile)
        if number % 2:
            hinted = [hints[other] for other in (number - 1, number + 1) if other in hints]
            asked &= np.any(
                [_moved_hint(hint, asked_m[number] / radius, asked.shape) for radius, hint in hinted], axis=0
            )
        score = _score_tile(tile, asked)
        if number % 2 == 0:
            hints[number] = (asked_m[number], score > HINT)
        yield asked_m[number], tile, score


def _moved_hint(hint: NDArray[np.bool_], ratio: float, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(h, w) where cells, so many times as large as those of a hint that begin at the same corner, are near to it."""
    wide = cv2.dilate(hint.astype(np.uint8), np.ones((5, 5), np.uint8))
    row, column = (
        np.minimum(((np.arange(size) + 0.5) * ratio).astype(int), count - 1)
        for size, count in zip(shape, hint.shape, strict=True)
    )
    return np.asarray(wide[np.ix_(row, column)] > 0)


def _score_tile(tile: CrownTile, asked: NDArray[np.bool_]) -> Singles:
    """(h, w) the answers for the cells of a mask, by one of four cells and all around those that are promising."""
    score = np.zeros(tile.seen.shape, np.float32)
    coarse = np.zeros(tile.seen.shape, bool)
    coarse[::2, ::2] = asked[::2, ::2]
    score[coarse] = _answer(tile, coarse)
    near = cv2.dilate((score > PROMISING).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    near &= ~coarse & tile.seen
    score[near] = _answer(tile, near)
    return score


def _worth_asking(tile: CrownTile) -> NDArray[np.bool_]:
    """(h, w) where there could be a crown at all."""
    if len(tile.channels) > 1:
        return tile.seen
    return tile.seen & (tile.channels[0, MARGIN:-MARGIN, MARGIN:-MARGIN] >= LOWEST_M)


def _answer(tile: CrownTile, mask: NDArray[np.bool_]) -> Singles:
    """(N,) the network's answer for the cells of a mask (h, w)."""
    middle, spread, layers = read_weights("canopy" if len(tile.channels) == 1 else "photo")
    return _native.crown_answers(*tile_places(tile, mask), middle=middle, spread=spread, layers=layers, threads=0)


def _answer_of_sun(tile: CrownTile, radius_m: float) -> float:
    """How much of a tile looks like crowns that are lit from its upper edge."""
    mask = np.zeros(tile.seen.shape, bool)
    mask[::SUN_STEP, ::SUN_STEP] = tile.seen[::SUN_STEP, ::SUN_STEP]
    score = np.zeros(tile.seen.shape, np.float32)
    score[mask] = _answer(tile, mask)
    around = cv2.dilate(score, np.ones((2 * SUN_STEP + 1, 2 * SUN_STEP + 1), np.uint8))
    highest = (score >= around) & (score > LOWEST_SCORE["photo"])
    return float((score[highest] - LOWEST_SCORE["photo"]).sum()) * radius_m**2


def _kind(picture: Raster) -> str:
    return "canopy" if picture.values.ndim == 2 else "photo"


def _peak_offsets(score: Singles, row: NDArray[np.int64], column: NDArray[np.int64]) -> Floats:
    """(N, 2) of a cell, by which the peak of a parabola lies off each highest cell: across and down."""
    padded = np.pad(score.astype(np.float64), 1, mode="edge")
    here = padded[row + 1, column + 1]

    def off(before: Floats, after: Floats) -> Floats:
        bend = np.minimum(before - 2 * here + after, -1e-6)
        return np.asarray(np.clip(0.5 * (before - after) / bend, -0.5, 0.5))

    across = off(padded[row + 1, column], padded[row + 1, column + 2])
    return np.stack([across, off(padded[row, column + 1], padded[row + 2, column + 1])], axis=-1)


def _best_of(ground_m: Floats, radius_m: Floats, score: Floats, between_m: tuple[float, float]) -> Crowns:
    """The best answers, none of which lies within another; each is the mean of those that are the same."""
    if not len(ground_m):
        return Crowns(ground_m=ground_m, radius_m=radius_m, score=score)
    order = np.lexsort([ground_m[:, 0], ground_m[:, 1], -score]).astype(np.int32)
    kept = _native.choose_crowns(ground_m, radius_m, order, apart=APART)
    near = cKDTree(ground_m).query_ball_point(ground_m[kept], SAME * radius_m[kept], return_sorted=True)
    own = np.repeat(np.arange(len(kept)), [len(each) for each in near])
    other = np.concatenate([np.array(each, np.int64) for each in near])
    same = np.abs(np.log(radius_m[other] / radius_m[kept[own]])) < SAME_SIZE
    own, other = own[same], other[same]
    weight = score[other] ** 4

    def mean(values: Floats) -> Floats:
        total = np.bincount(own, weight * values[other], minlength=len(kept))
        return np.asarray(total / np.bincount(own, weight, minlength=len(kept)))

    off_m = ground_m - ground_m[0]  # far from the origin digits are lost
    found_m = ground_m[0] + np.stack([mean(off_m[:, 0]), mean(off_m[:, 1])], axis=-1)
    found_radius_m = np.clip(np.exp(mean(np.log(radius_m))), *between_m)
    free = _covered_shares(found_m, found_radius_m) <= COVERED
    return Crowns(ground_m=found_m[free], radius_m=found_radius_m[free], score=score[kept][free])


def _covered_shares(ground_m: Floats, radius_m: Floats) -> Floats:
    """(N,) of the area of each disc, what those before it cover; where two of them do, it counts twice."""
    pairs = cKDTree(ground_m).query_pairs(2 * float(radius_m.max()), output_type="ndarray")
    before, after = pairs.min(axis=1), pairs.max(axis=1)
    shared = shared_area(np.linalg.norm(ground_m[after] - ground_m[before], axis=1), radius_m[after], radius_m[before])
    return np.asarray(np.bincount(after, shared, minlength=len(radius_m)) / (np.pi * radius_m**2))


@cache
def read_weights(kind: str) -> tuple[Singles, Singles, tuple[tuple[Singles, Singles], ...]]:
    """Middle and spread of each fact, and matrix and offset of each layer; of a photo or a canopy."""
    table = parse_toml(files(__package__).joinpath(_WEIGHTS).read_text("utf-8"))[kind]
    layers = tuple(
        (np.array(layer["matrix"], np.float32), np.array(layer["offset"], np.float32)) for layer in table["layers"]
    )
    return np.array(table["middle"], np.float32), np.array(table["spread"], np.float32), layers
