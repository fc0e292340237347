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

from usdfoliage import _native
from usdfoliage.forest.raster import Raster, to_ground

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

CELLS = 4  # of the grid that is looked at, in a radius
RINGS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.5)  # cells from the middle, on which a picture is read
ANGLES = 12  # places of a ring, the first towards the sun
MARGIN = 8  # cells around a tile
WINDOW_PX = 1024  # side of the part of a picture that is looked at in one piece
BLUR = 0.12  # of a radius, that a picture is blurred by
FINE_BLUR_PX = 0.8  # what is blurred by more than twice as much is halved first
LEAVES_M = 0.4  # blur that parts leaves and gaps from the crown's shading
DARK = 0.03  # of the mean light, that is added before logarithms: noise in shadows is no colour
LIGHT = (0.25, 0.55, 0.2)  # weights of red, green and blue


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownWindow:
    """A part of a picture, with as much around it as is asked about it."""

    # Of pixels (H, W, C). Of an orthophoto four: logarithms of light, of red and of blue over green, and how rough it
    # is. Of a canopy one: metres.
    channels: Singles
    known: NDArray[np.bool_]  # (H, W), whether the picture shows anything there
    first_px: tuple[int, int]  # column and row of the picture, at which the pixels begin
    own_px: tuple[int, int, int, int]  # first and last column and row of the picture that are the window's own
    ground_from_pixel: Floats  # (2, 3), of the picture
    cell_m: float  # side of its pixels


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownTile:
    """A window at the scale of one radius, turned so that the sun is at its upper edge."""

    channels: Singles  # (C, H, W) with a margin, as those of a window, but how rough it is as a logarithm too
    seen: NDArray[np.bool_]  # (h, w), without the margin, whether the window has the place and shows anything there
    pixel_from_cell: Floats  # (2, 3): column, row and 1 without the margin to column and row of the picture


def cut_windows(
    picture: Raster, largest_m: float, side_px: int = WINDOW_PX, max_windows: int | None = None
) -> Iterator[CrownWindow]:
    """The parts of a picture, of nearly the same size.

    Args:
        picture: (H, W, 3) linear colours, NaN where nothing is seen; or (H, W) heights of a canopy, metres.
        largest_m: Radius of the largest crowns that are looked for.
        side_px: Side of a part, at most.
        max_windows: So many parts and no more, evenly chosen; None for all.
    """
    height, width = picture.values.shape[:2]
    mean = _mean_light(picture)
    reach = int(np.ceil(((MARGIN + 1) / CELLS + 4 * BLUR) * largest_m / picture.cell_m)) + 3
    columns, rows = (
        np.linspace(0, size, int(np.ceil(size / side_px)) + 1).round().astype(int) for size in (width, height)
    )
    numbers = np.arange((len(rows) - 1) * (len(columns) - 1))
    if max_windows is not None and len(numbers) > max_windows:
        numbers = numbers[((np.arange(max_windows) + 0.5) * len(numbers) / max_windows).astype(int)]
    for number in numbers.tolist():
        row, column = divmod(number, len(columns) - 1)
        left, right, top, bottom = columns[column], columns[column + 1], rows[row], rows[row + 1]
        first = max(left - reach, 0), max(top - reach, 0)
        values = np.asarray(
            picture.values[first[1] : min(bottom + reach, height), first[0] : min(right + reach, width)], np.float32
        )
        if values.ndim == 2:
            known = np.asarray(np.isfinite(values))
            channels = np.where(known, values, 0)[..., None]
        else:
            known = np.asarray(np.isfinite(values).all(axis=-1))
            channels = _color_channels(np.where(known[..., None], values, mean), mean, picture.cell_m)
        yield CrownWindow(
            channels=np.asarray(channels, np.float32),
            known=known,
            first_px=(int(first[0]), int(first[1])),
            own_px=(int(left), int(right), int(top), int(bottom)),
            ground_from_pixel=picture.ground_from_pixel,
            cell_m=picture.cell_m,
        )


def cut_tiles(window: CrownWindow, radius_m: float, suns_deg: Sequence[float]) -> Iterator[CrownTile]:
    """A window at the scale of a radius, turned to each sun.

    Args:
        window: Cut for crowns that are at least so large.
        radius_m: Of the crowns that are looked for.
        suns_deg: Azimuths of suns, clockwise from north; any one for a canopy.
    """
    channels, halved = _halved(window.channels, BLUR * radius_m / window.cell_m)
    for sun_deg in suns_deg:
        yield _cut_tile(window, channels, halved, radius_m, sun_deg)


def tile_places(tile: CrownTile, mask: NDArray[np.bool_]) -> tuple[Singles, NDArray[np.int32], NDArray[np.int32]]:
    """What is asked of a tile for the cells of a mask (h, w): its channels, places in them, and ways to the rings."""
    width = tile.channels.shape[2]
    row, column = np.nonzero(mask)
    away, turn = np.array(RINGS)[:, None], 2 * np.pi * np.arange(ANGLES) / ANGLES
    offsets = np.round(away * np.sin(turn)) - width * np.round(away * np.cos(turn))
    return tile.channels, ((row + MARGIN) * width + column + MARGIN).astype(np.int32), offsets.astype(np.int32)


def tile_facts(tile: CrownTile, mask: NDArray[np.bool_]) -> Singles:
    """(N, K) what is known of the cells of a mask (h, w): light and colour on rings, against what is around.

    What lies to both sides of the light is the same, and is taken together. Colour is how far along the way from the
    outside to the inside a place is, whatever the two are.
    """
    return _native.crown_facts(*tile_places(tile, mask), threads=0)


def middles_m(picture: Raster, tile: CrownTile, mask: NDArray[np.bool_]) -> Floats:
    """(N, 2) places of the middles of the cells of a mask (h, w) on the ground."""
    cells = np.argwhere(mask)[:, ::-1] + 0.5
    return to_ground(picture, cells @ tile.pixel_from_cell[:, :2].T + tile.pixel_from_cell[:, 2])


def _cut_tile(window: CrownWindow, channels: Singles, halved: int, radius_m: float, sun_deg: float) -> CrownTile:
    """One tile of channels, each pixel of which is so many pixels of the window along a side."""
    left, right, top, bottom = window.own_px
    corners_px = np.array([[left, top], [right, top], [left, bottom], [right, bottom]], np.float64)
    from_pixel = window.ground_from_pixel
    sun = np.radians(sun_deg)
    axes = np.array([[-np.cos(sun), np.sin(sun)], [-np.sin(sun), -np.cos(sun)]]).T  # of columns, and of rows
    cell_m = radius_m / CELLS
    linear = np.linalg.inv(from_pixel[:, :2])
    # Places far from the origin lose digits, so count from the first corner.
    bounds = (corners_px - corners_px[0]) @ from_pixel[:, :2].T @ axes / cell_m
    low = bounds.min(axis=0)
    width, height = np.maximum(np.ceil(bounds.max(axis=0) - low - 1e-9), 1).astype(int).tolist()
    pixel_from_cell = np.column_stack([linear @ axes * cell_m, corners_px[0] + linear @ axes @ low * cell_m])
    # Middles of cells and of pixels are at half of their sides; OpenCV counts from the middle of the first.
    matrix = pixel_from_cell.copy()
    matrix[:, 2] += pixel_from_cell[:, :2] @ np.full(2, 0.5 - MARGIN) - window.first_px
    to = (width + 2 * MARGIN, height + 2 * MARGIN)
    turned = cv2.warpAffine(
        channels,
        matrix / halved - np.array([0, 0, 0.5]),
        to,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    planes = np.ascontiguousarray(np.moveaxis(turned.reshape(*turned.shape[:2], -1), -1, 0))
    if len(planes) > 1:
        planes[3] = np.log(planes[3] + np.float32(0.01))
    own = np.zeros(window.known.shape, np.uint8)
    rows, columns = (
        slice(top - window.first_px[1], bottom - window.first_px[1]),
        slice(left - window.first_px[0], right - window.first_px[0]),
    )
    own[rows, columns] = window.known[rows, columns]
    seen = cv2.warpAffine(own, matrix - np.array([0, 0, 0.5]), to, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
    return CrownTile(
        channels=planes,
        seen=seen[MARGIN:-MARGIN, MARGIN:-MARGIN].astype(bool),
        pixel_from_cell=pixel_from_cell,
    )


def _mean_light(picture: Raster) -> float:
    """Mean of a few of the colours that are seen; 0 of none."""
    if picture.values.ndim == 2:
        return 0.0
    height, width = picture.values.shape[:2]
    some = picture.values[:: max(1, height // 256), :: max(1, width // 256)]
    known = some[np.isfinite(some)]
    return float(known.mean()) if len(known) else 0.0


def _halved(channels: Singles, blur_px: float) -> tuple[Singles, int]:
    """Channels blurred by so many pixels, and how many pixels are one of them along a side."""
    pixels, square = 1, blur_px**2
    while np.sqrt(square) / pixels > 2 * FINE_BLUR_PX and min(channels.shape[:2]) > 3:
        height, width = channels.shape[:2]
        even = cv2.copyMakeBorder(channels, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
        channels = cv2.resize(even, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        square -= pixels**2 / 4  # the variance of a mean of two
        pixels *= 2
    left_px = np.sqrt(max(square, 0.0)) / pixels
    return np.asarray(cv2.GaussianBlur(channels, (0, 0), left_px) if left_px > 0.3 else channels), pixels


def _color_channels(colors: Singles, mean: float, cell_m: float) -> Singles:
    """(H, W, 4) as those of a window."""
    logs = np.log(np.maximum(colors, 0) + np.float32(DARK * mean + 1e-6))
    light = logs @ np.array(LIGHT, np.float32)
    rough = np.abs(light - cv2.GaussianBlur(light, (0, 0), max(LEAVES_M / cell_m, 1.0)))
    return np.stack([light, logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1], rough], axis=-1)
