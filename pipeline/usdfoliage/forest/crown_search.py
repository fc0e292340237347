"""Single crowns seen from above: places and radii where a canopy, or an orthophoto alone, looks like a crown.

A small network answers how well a disc covers a crown, by their intersection over union, for all places and radii; its
weights come from tools/learn_crowns.py. It knows no colour, only how colours differ from those around, so that it does
not depend on season and species. Where the sun is, is the direction for which the picture has the best crowns. Our own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from usdfoliage.files.toml import parse_toml
from usdfoliage.forest.crown_tiles import CrownTile, Floats, Singles, cut_tiles, tile_facts
from usdfoliage.forest.raster import Raster, to_ground

_WEIGHTS = "crown_weights.toml"
RATIO = 2**0.25  # of a radius over the next smaller one
FINEST_PX = 1.5  # pixels in the smallest radius that is looked for
LOWEST_SCORE = {"photo": 0.42, "canopy": 0.44}  # of an intersection over union that is a crown
PROMISING = 0.28  # answer of one cell of four, around which all cells are asked
APART = 0.62  # of the sum of two radii, within which the better of two crowns stays
SAME = 0.4  # radii apart, within which answers are of one crown
LOWEST_M = 1.0  # of a canopy, where crowns are looked for
SUNS = 12  # directions that are tried
SUN_RADII_M = (1.7, 2.8, 4.8)  # of crowns that show where the sun is
SUN_TILES = 4  # of each radius, that are looked at
SUN_STEP = 3  # cells from one that is asked there to the next


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
    for radius in crown_radii(radius_m, picture.cell_m):
        for tile in cut_tiles(picture, radius, sun_deg):
            score = score_tile(tile)
            highest = score >= ndimage.maximum_filter(score, size=3, mode="constant")
            row, column = np.nonzero(highest & (score > lowest))
            cell = np.stack([column, row], axis=-1) + _peak_offsets(score, row, column) + 0.5
            places.append(cell @ tile.pixel_from_cell[:, :2].T + tile.pixel_from_cell[:, 2])
            radii.append(np.full(len(row), radius))
            scores.append(score[row, column].astype(np.float64))
    ground_m = to_ground(picture, np.concatenate(places))
    return _best_of(ground_m, np.concatenate(radii), np.concatenate(scores), radius_m)


def find_sun(orthophoto: Raster, radius_m: tuple[float, float]) -> float:
    """Azimuth of the sun in degrees, clockwise from north: that for which a picture looks like crowns the best."""
    radii = [radius for radius in SUN_RADII_M if FINEST_PX * orthophoto.cell_m < radius and radius < 1.5 * radius_m[1]]
    radii = radii or [max(FINEST_PX * orthophoto.cell_m, radius_m[0])]
    step = 360 / SUNS
    answers = np.array([_answer_of_sun(orthophoto, radii, number * step) for number in range(SUNS)])
    best = int(np.argmax(answers))
    before, here, after = answers[best - 1], answers[best], answers[(best + 1) % SUNS]
    bend = before - 2 * here + after
    return float((best + (0.5 * (before - after) / bend if bend < 0 else 0.0)) * step % 360)


def crown_radii(radius_m: tuple[float, float], cell_m: float) -> Sequence[float]:
    """The radii that are looked for, from small to large, of pixels so large."""
    low = max(radius_m[0], FINEST_PX * cell_m)
    count = max(1, int(np.ceil(np.log(max(radius_m[1] / low, 1.0)) / np.log(RATIO) + 0.5)))
    return [low * RATIO**number for number in range(count)]


def score_tile(tile: CrownTile) -> Singles:
    """(h, w) how well a disc of the tile's radius around each cell covers a crown, 0 to 1."""
    score = np.zeros(tile.seen.shape, np.float32)
    coarse = np.zeros(tile.seen.shape, bool)
    coarse[::2, ::2] = _worth_asking(tile)[::2, ::2]
    score[coarse] = _answer(tile, coarse)
    near = ndimage.binary_dilation(score > PROMISING, np.ones((3, 3), bool)) & ~coarse & tile.seen
    score[near] = _answer(tile, near)
    return score


def _worth_asking(tile: CrownTile) -> NDArray[np.bool_]:
    """(h, w) where there could be a crown at all."""
    if len(tile.channels) > 1:
        return tile.seen
    margin = (tile.channels.shape[1] - tile.seen.shape[0]) // 2
    return tile.seen & (tile.channels[0, margin:-margin, margin:-margin] >= LOWEST_M)


def _answer(tile: CrownTile, mask: NDArray[np.bool_]) -> Singles:
    """(N,) the network's answer for the cells of a mask."""
    if not mask.any():
        return np.zeros(0, np.float32)
    middle, spread, layers = _read_weights("canopy" if len(tile.channels) == 1 else "photo")
    answer = tile_facts(tile, *np.nonzero(mask))
    answer -= middle[:, None]
    answer /= spread[:, None]
    np.clip(answer, -4, 4, out=answer)
    for number, (matrix, offset) in enumerate(layers):
        answer = matrix.T @ answer + offset[:, None]
        if number < len(layers) - 1:
            np.maximum(answer, 0, out=answer)
    return np.asarray(1 / (1 + np.exp(-answer[0])), np.float32)


def _answer_of_sun(orthophoto: Raster, radii: Sequence[float], sun_deg: float) -> float:
    """How much of the picture looks like crowns that are lit from there."""
    total = 0.0
    for radius in radii:
        for tile in cut_tiles(orthophoto, radius, sun_deg, SUN_TILES):
            mask = np.zeros(tile.seen.shape, bool)
            mask[::SUN_STEP, ::SUN_STEP] = tile.seen[::SUN_STEP, ::SUN_STEP]
            score = np.zeros(tile.seen.shape, np.float32)
            score[mask] = _answer(tile, mask)
            highest = (score >= ndimage.maximum_filter(score, size=2 * SUN_STEP + 1, mode="constant")) & (
                score > LOWEST_SCORE["photo"]
            )
            total += float((score[highest] - LOWEST_SCORE["photo"]).sum()) * radius**2
    return total


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
    kept: list[int] = []
    means: list[Floats] = []
    if len(ground_m):
        tree = cKDTree(ground_m)
        near = tree.query_ball_point(ground_m, APART * (radius_m + float(radius_m.max())))
        gone = np.zeros(len(ground_m), bool)
        for number in np.lexsort([ground_m[:, 0], ground_m[:, 1], -score]).tolist():
            if gone[number]:
                continue
            others = np.array(near[number])
            away_m = np.linalg.norm(ground_m[others] - ground_m[number], axis=1)
            same = others[
                (away_m < SAME * radius_m[number]) & (np.abs(np.log(radius_m[others] / radius_m[number])) < 0.4)
            ]
            weight = score[same] ** 4
            mean_m = (weight[:, None] * ground_m[same]).sum(axis=0) / weight.sum()
            kept.append(number)
            means.append(np.append(mean_m, np.exp((weight * np.log(radius_m[same])).sum() / weight.sum())))
            gone[others[away_m < APART * (radius_m[others] + radius_m[number])]] = True
    found = np.array(means).reshape(-1, 3)
    return Crowns(
        ground_m=found[:, :2], radius_m=np.clip(found[:, 2], *between_m), score=score[np.array(kept, np.int64)]
    )


@cache
def _read_weights(kind: str) -> tuple[Singles, Singles, tuple[tuple[Singles, Singles], ...]]:
    """Middle and spread of each fact, and matrix and offset of each layer; of a photo or a canopy."""
    table = parse_toml(files(__package__).joinpath(_WEIGHTS).read_text("utf-8"))[kind]
    layers = tuple(
        (np.array(layer["matrix"], np.float32), np.array(layer["offset"], np.float32)) for layer in table["layers"]
    )
    return np.array(table["middle"], np.float32), np.array(table["spread"], np.float32), layers
