"""Rasters over the ground: heights, colours or classes by pixel, and where their pixels lie."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Raster:
    """Values by pixel. Column and row count from the corner of the first pixel, so its middle is at (0.5, 0.5)."""

    values: NDArray[np.floating]  # (H, W) or (H, W, C); NaN where nothing is known
    ground_from_pixel: Floats  # (2, 3): column, row and 1 to easting and northing, metres
    crs: str = ""  # well-known text; empty where the file has none

    @property
    def cell_m(self) -> float:
        """Side of a square that is as large as a pixel, metres."""
        return float(np.sqrt(abs(np.linalg.det(self.ground_from_pixel[:, :2]))))


def to_ground(raster: Raster, pixels: NDArray[np.floating]) -> Floats:
    """(N, 2) easting and northing of places (N, 2) given by column and row."""
    return np.asarray(pixels @ raster.ground_from_pixel[:, :2].T + raster.ground_from_pixel[:, 2], np.float64)


def to_pixels(raster: Raster, ground_m: Floats) -> Floats:
    """(N, 2) column and row of places (N, 2) given by easting and northing."""
    return np.asarray(np.linalg.solve(raster.ground_from_pixel[:, :2], (ground_m - raster.ground_from_pixel[:, 2]).T).T)


def pixel_grid(raster: Raster) -> Floats:
    """(H, W, 2) easting and northing of the middle of every pixel."""
    height, width = raster.values.shape[:2]
    row, column = np.arange(height)[:, None] + 0.5, np.arange(width) + 0.5
    grid_m = np.empty((height, width, 2))
    for axis, (across, down, first) in enumerate(raster.ground_from_pixel.tolist()):
        np.add(across * column + first, down * row, out=grid_m[..., axis])
    return grid_m


def upright_grid(raster: Raster) -> Raster:
    """Pixels of the same size whose rows go south and columns east, over all of a raster; itself where it lies so.

    Returns:
        With zeros as values (H, W) where it is not the raster itself.
    """
    matrix = raster.ground_from_pixel
    if not (matrix[0, 1] or matrix[1, 0] or matrix[0, 0] < 0 or matrix[1, 1] > 0):
        return raster
    height, width = raster.values.shape[:2]
    corners_m = to_ground(raster, np.array([[0, 0], [width, 0], [0, height], [width, height]]))
    low_m, high_m = corners_m.min(axis=0), corners_m.max(axis=0)
    columns, rows = np.maximum(np.ceil((high_m - low_m) / raster.cell_m - 1e-6), 1).astype(np.int64).tolist()
    across_m, down_m = (high_m - low_m) / [columns, rows]
    return Raster(
        values=np.broadcast_to(0.0, (rows, columns)),
        ground_from_pixel=np.array([[across_m, 0.0, low_m[0]], [0.0, -down_m, high_m[1]]]),
        crs=raster.crs,
    )


def is_inside(raster: Raster, ground_m: Floats) -> NDArray[np.bool_]:
    """(N,) which places (N, 2) lie in the raster."""
    height, width = raster.values.shape[:2]
    column, row = to_pixels(raster, ground_m).T
    return np.asarray((column >= 0) & (column < width) & (row >= 0) & (row < height))


def sample_bilinear(raster: Raster, ground_m: Floats) -> Floats:
    """(N,) or (N, C) values at places (N, 2), read bilinearly between the middles of pixels.

    Beyond the middles of the outermost pixels their values continue.
    """
    column, row = to_pixels(raster, ground_m).T - 0.5
    layers = raster.values[..., None] if raster.values.ndim == 2 else raster.values
    sampled = np.stack(
        [map_coordinates(layer, [row, column], order=1, mode="nearest") for layer in np.moveaxis(layers, -1, 0)],
        axis=-1,
    )
    return np.asarray(sampled[:, 0] if raster.values.ndim == 2 else sampled, np.float64)


def sample_nearest(raster: Raster, ground_m: Floats) -> NDArray[np.floating]:
    """(N,) or (N, C) values of the pixels in which places (N, 2) lie; those outside read the nearest pixel."""
    height, width = raster.values.shape[:2]
    column, row = np.floor(to_pixels(raster, ground_m)).astype(np.int64).T
    return raster.values[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
