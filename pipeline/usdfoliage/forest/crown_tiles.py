"""A picture from above at the scale of one radius, and what is known there of a crown around each place.

A crown is brighter to the sun and darker away from it, has a shadow beside it, and colours and leaves of its own; in a
canopy it is a dome. How this lies around a middle, in radii and turned to the sun, is the template of M. Larsen and
M. Rudemo, Optimizing templates for finding trees in aerial photographs, Pattern Recognition Letters 19, 1998.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.forest.raster import Raster, is_inside, to_ground, to_pixels

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

CELLS = 4  # of the grid that is looked at, in a radius
RINGS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.5)  # cells from the middle, on which a picture is read
ANGLES = 12  # places of a ring, the first towards the sun
MARGIN = 8  # cells around a tile
TILE = 192  # cells along a tile
BLUR = 0.12  # of a radius, that a picture is blurred by
LEAVES_M = 0.4  # blur that parts leaves and gaps from the crown's shading
DARK = 0.03  # of the mean light, that is added before logarithms: noise in shadows is no colour
EDGE_PX = 3  # around what is cut, for blurs
MIN_SPREAD, MIN_SPREAD_M = 0.05, 0.3  # of the logarithm of light, and of heights, below which all is noise
LIGHT = (0.25, 0.55, 0.2)  # weights of red, green and blue


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownTile:
    """A square of a picture at the scale of one radius, turned so that the sun is at its upper edge."""

    # (C, H, W) with a margin. Of an orthophoto four: logarithms of light, of red and of blue over green, and of how
    # rough it is. Of a canopy one: metres.
    channels: Singles
    seen: NDArray[np.bool_]  # (h, w), without the margin, whether the picture shows anything there
    pixel_from_cell: Floats  # (2, 3): column, row and 1 without the margin to column and row of the picture


def cut_tiles(picture: Raster, radius_m: float, sun_deg: float, max_tiles: int | None = None) -> Iterator[CrownTile]:
    """The squares of a picture at the scale of a radius.

    Args:
        picture: (H, W, 3) linear colours, NaN where nothing is seen; or (H, W) heights of a canopy, metres.
        radius_m: Of the crowns that are looked for.
        sun_deg: Azimuth of the sun, clockwise from north; any for a canopy.
        max_tiles: So many squares and no more, evenly chosen; None for all.
    """
    sun = np.radians(sun_deg)
    height, width = picture.values.shape[:2]
    corners = to_ground(picture, np.array([[0, 0], [width, 0], [0, height], [width, height]], np.float64))
    axes = np.array([[-np.cos(sun), np.sin(sun)], [-np.sin(sun), -np.cos(sun)]]).T  # of columns, and of rows
    cell_m = radius_m / CELLS
    bounds = corners @ axes / cell_m
    first = np.floor(bounds.min(axis=0))
    columns, rows = np.ceil(bounds.max(axis=0) - first).astype(int).tolist()
    starts = np.array([(column, row) for row in range(0, rows, TILE) for column in range(0, columns, TILE)])
    middles_m = (starts + TILE / 2 + first) * cell_m @ axes.T
    starts = starts[_near(picture, middles_m, TILE * cell_m / np.sqrt(2))]
    if max_tiles is not None and len(starts) > max_tiles:
        inside = is_inside(picture, (starts + TILE / 2 + first) * cell_m @ axes.T)
        starts = starts[inside] if inside.any() else starts
        starts = starts[np.linspace(0, len(starts) - 1, min(max_tiles, len(starts))).astype(int)]
    mean = _mean_light(picture)
    linear = np.linalg.inv(picture.ground_from_pixel[:, :2])
    for start in starts:
        size = np.minimum([columns - start[0], rows - start[1]], TILE)
        matrix = np.column_stack([linear @ axes * cell_m, linear @ ((first + start) * cell_m @ axes.T)])
        matrix[:, 2] -= linear @ picture.ground_from_pixel[:, 2]
        yield _cut_tile(picture, matrix, size.tolist(), radius_m, mean)


def tile_facts(tile: CrownTile, row: NDArray[np.int64], column: NDArray[np.int64]) -> Singles:
    """(K, N) what is known of cells (N,) without the margin: light and colour on rings, against what is around.

    What lies to both sides of the light is the same, and is taken together. Colour is how far along the way from the
    outside to the inside a place is, whatever the two are.
    """
    count, _height, width = tile.channels.shape
    flat = tile.channels.reshape(count, -1)
    place = (row + MARGIN) * width + column + MARGIN
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES

    def moved(away: float, turn: float) -> Singles:
        moved_by = round(away * np.sin(turn)) - width * round(away * np.cos(turn))
        return np.take(flat, place + moved_by, axis=1, mode="clip")  # the margin holds all; to clip is faster

    middle = moved(0, 0)
    rings, means, uneven = [], [], []
    for away in RINGS:
        around = [moved(away, turn) for turn in angle.tolist()]
        pairs = [(around[number], around[-number]) for number in range(1, ANGLES // 2)]
        rings.append([around[0], *(0.5 * (left + right) for left, right in pairs), around[ANGLES // 2]])
        differ = _mean([np.abs(left[0] - right[0]) for left, right in pairs])
        uneven.append(differ * len(pairs) / ANGLES)
        means.append(_mean(around))
    inside = (middle + 2 * means[0] + 3 * means[1]) / 6
    outside = _mean(means[4:7])
    spread = np.sqrt(_mean([(side[0] - inside[0]) ** 2 for ring in rings for side in ring]))
    scale = 1 / (spread + (MIN_SPREAD_M if count == 1 else MIN_SPREAD))
    facts = [(middle[0] - inside[0]) * scale, -np.log(scale)]
    for ring, asymmetry in zip(rings, uneven, strict=True):
        facts += [asymmetry * scale, *((side[0] - inside[0]) * scale for side in ring)]
    if count == 1:
        facts += [np.log(np.maximum(inside[0], 0) + 1), outside[0] / (np.maximum(inside[0], 0) + 1)]
        return np.array(facts, np.float32)
    apart = (inside - outside)[1:3]
    distance = np.sqrt(apart[0] ** 2 + apart[1] ** 2)
    across, along = apart / np.maximum(distance, 0.02)
    level = across * outside[1] + along * outside[2]
    facts += [across * middle[1] + along * middle[2] - level, np.log(distance + 0.02), middle[3] - outside[3]]
    for ring, mean in zip(rings, means, strict=True):
        facts += [mean[3] - outside[3], *(across * side[1] + along * side[2] - level for side in ring)]
    return np.array(facts, np.float32)


def _mean(planes: Sequence[Singles]) -> Singles:
    """Of planes of one shape."""
    total = planes[0].copy()
    for plane in planes[1:]:
        total += plane
    return np.asarray(total / np.float32(len(planes)))


def _near(raster: Raster, middles_m: Floats, reach_m: float) -> NDArray[np.bool_]:
    """(N,) which places are within reach of a raster."""
    height, width = raster.values.shape[:2]
    reach = reach_m / raster.cell_m
    pixels = to_pixels(raster, middles_m)
    return np.asarray((pixels > -reach).all(axis=1) & (pixels < np.array([width, height]) + reach).all(axis=1))


def _mean_light(picture: Raster) -> float:
    """Mean of a few of the colours that are seen; 0 of none."""
    if picture.values.ndim == 2:
        return 0.0
    height, width = picture.values.shape[:2]
    some = picture.values[:: max(1, height // 256), :: max(1, width // 256)]
    known = some[np.isfinite(some)]
    return float(known.mean()) if len(known) else 0.0


def _cut_tile(picture: Raster, pixel_from_cell: Floats, size: list[int], radius_m: float, mean: float) -> CrownTile:
    width, height = size
    far = np.array([-MARGIN, width + MARGIN, height + MARGIN])
    corners = np.array([[far[0], far[0]], [far[1], far[0]], [far[0], far[2]], [far[1], far[2]]])
    pixels = corners @ pixel_from_cell[:, :2].T + pixel_from_cell[:, 2]
    limit = np.array(picture.values.shape[1::-1])
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - EDGE_PX, 0, limit - 1)
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + EDGE_PX, low + 1, limit)
    values = np.asarray(picture.values[low[1] : high[1], low[0] : high[0]], np.float32)
    if values.ndim == 2:
        known = np.asarray(np.isfinite(values))
        channels = np.where(known, values, 0)[..., None]
    else:
        known = np.asarray(np.isfinite(values).all(axis=-1))
        channels = _color_channels(np.where(known[..., None], values, mean), mean, picture.cell_m)
    blur = BLUR * radius_m / picture.cell_m
    if blur > 0.3:
        channels = cv2.GaussianBlur(channels, (0, 0), blur).reshape(channels.shape)
    # Middles of cells and of pixels are at half of their sides; OpenCV counts from the middle of the first.
    matrix = pixel_from_cell.copy()
    matrix[:, 2] += pixel_from_cell[:, :2] @ np.full(2, 0.5 - MARGIN) - low - 0.5
    to = (width + 2 * MARGIN, height + 2 * MARGIN)
    linear, nearest = (each | cv2.WARP_INVERSE_MAP for each in (cv2.INTER_LINEAR, cv2.INTER_NEAREST))
    turned = cv2.warpAffine(channels, matrix, to, flags=linear, borderMode=cv2.BORDER_REPLICATE)
    seen = cv2.warpAffine(known.astype(np.uint8), matrix, to, flags=nearest)[MARGIN:-MARGIN, MARGIN:-MARGIN]
    planes = np.ascontiguousarray(np.moveaxis(turned.reshape(*turned.shape[:2], -1), -1, 0))
    if len(planes) > 1:
        planes[3] = np.log(planes[3] + 0.01)
    return CrownTile(channels=planes, seen=seen.astype(bool), pixel_from_cell=pixel_from_cell)


def _color_channels(colors: Singles, mean: float, cell_m: float) -> Singles:
    """(H, W, 4) as those of a tile, but how rough it is not yet as a logarithm."""
    logs = np.log(np.maximum(colors, 0) + np.float32(DARK * mean + 1e-6))
    light = logs @ np.array(LIGHT, np.float32)
    rough = np.abs(light - cv2.GaussianBlur(light, (0, 0), max(LEAVES_M / cell_m, 1.0)))
    return np.stack([light, logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1], rough], axis=-1)
