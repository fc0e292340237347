"""The ground: heights from a raster, holes closed, and a mesh of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from usdfoliage.errors import CaptureError
from usdfoliage.forest.raster import (
    Raster,
    is_inside,
    pixel_grid,
    sample_bilinear,
    sample_nearest,
    to_pixels,
    upright_grid,
)

Floats = NDArray[np.float64]

MAX_HOLES = 0.9  # of the pixels
LARGEST_HOLE_PX = 250_000  # that is closed smoothly; larger ones take the nearest heights


@dataclass(frozen=True, kw_only=True, eq=False)
class Terrain:
    """The ground over a rectangle of pixels."""

    heights: Raster  # (H, W), metres, finite
    known: Raster  # (H, W), 1 where the file has a height

    @property
    def hole_share(self) -> float:
        """Of the pixels that the file has no height of."""
        return float(1 - self.known.values.mean())


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundMesh:
    """A mesh of the ground, in the frame of the terrain: easting, northing and height; metres."""

    places_m: Floats  # (V, 3)
    faces: NDArray[np.int32]  # (F, 4), counter-clockwise from above
    st: Floats  # (V, 2), over the rectangle around the terrain along easting and northing: east and north
    shape: tuple[int, int]  # rows and columns of places


def make_terrain(heights: Raster, name: str = "the DEM") -> Terrain:
    """A terrain of heights, with its holes closed as a soap film would.

    Args:
        heights: (H, W), NaN where no height is known.
        name: What it is to the user, for errors.

    Raises:
        CaptureError: There are fewer than 2 x 2 pixels, or nearly none with a height.
    """
    values = np.asarray(heights.values, np.float64)
    known = np.isfinite(values)
    if values.ndim != 2 or min(values.shape) < 2:
        raise CaptureError(f"{name} has {' x '.join(map(str, values.shape))} pixels, and needs 2 x 2 in one band")
    if known.mean() < 1 - MAX_HOLES:
        raise CaptureError(
            f"{name} has heights in {known.mean():.1%} of its pixels",
            "see whether its no-data value is right, or points lie far away",
        )
    return Terrain(
        heights=Raster(values=close_holes(values), ground_from_pixel=heights.ground_from_pixel, crs=heights.crs),
        known=Raster(values=known.astype(np.float32), ground_from_pixel=heights.ground_from_pixel, crs=heights.crs),
    )


def close_holes(values: Floats) -> Floats:
    """(H, W) values with the harmonic function where they are NaN: each is the mean of its four neighbours."""
    hole = ~np.isfinite(values)
    if not hole.any():
        return values
    nearest = ndimage.distance_transform_edt(hole, return_distances=False, return_indices=True)
    closed = values[tuple(nearest)]
    label, _count = ndimage.label(hole)
    large = np.flatnonzero(np.bincount(label.reshape(-1)) > LARGEST_HOLE_PX)
    inner = hole & ~np.isin(label, large[large > 0])
    number = np.full(values.shape, -1)
    number[inner] = np.arange(inner.sum())
    row, column = np.nonzero(inner)
    own = number[row, column]
    rows, columns, weights, right = [], [], [], np.zeros(len(own))
    around = np.zeros(len(own))
    for down, across in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        y, x = row + down, column + across
        inside = (y >= 0) & (y < values.shape[0]) & (x >= 0) & (x < values.shape[1])
        around += inside
        other = np.where(inside, number[np.clip(y, 0, values.shape[0] - 1), np.clip(x, 0, values.shape[1] - 1)], -1)
        free = inside & (other >= 0)
        rows.append(own[free])
        columns.append(other[free])
        weights.append(np.full(int(free.sum()), -1.0))
        fixed = inside & (other < 0)
        right[own[fixed]] += closed[y[fixed], x[fixed]]
    rows.append(own)
    columns.append(own)
    weights.append(around)
    matrix = coo_matrix((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns)))).tocsc()
    if len(own):
        closed[inner] = spsolve(matrix, right)
    return closed


def ground_height(terrain: Terrain, ground_m: Floats) -> Floats:
    """(N,) heights of places (N, 2), bilinear between the middles of pixels; metres."""
    return sample_bilinear(terrain.heights, ground_m)


def is_known(terrain: Terrain, ground_m: Floats) -> NDArray[np.bool_]:
    """(N,) which places (N, 2) lie where the file has a height."""
    return is_inside(terrain.heights, ground_m) & (sample_nearest(terrain.known, ground_m) > 0)


def slope_deg(terrain: Terrain) -> Raster:
    """(H, W) by how much the ground slopes, degrees."""
    down, across = np.gradient(terrain.heights.values)
    per_m = np.stack([across, down], axis=-1) @ np.linalg.inv(terrain.heights.ground_from_pixel[:, :2])
    return Raster(
        values=np.degrees(np.arctan(np.linalg.norm(per_m, axis=-1))),
        ground_from_pixel=terrain.heights.ground_from_pixel,
        crs=terrain.heights.crs,
    )


def mesh_terrain(terrain: Terrain, max_quads: int) -> GroundMesh:
    """A grid of the ground with at most so many quads, whose points are at the middles of pixels or between them.

    Args:
        terrain: The ground.
        max_quads: 1 or more; a grid of one quad a pixel where that is not more.
    """
    height, width = terrain.heights.values.shape
    step = max(1.0, float(np.sqrt((height - 1) * (width - 1) / max_quads)))
    rows, columns = (max(2, int((size - 1) / step) + 1) for size in (height, width))
    if rows == 2:  # a strip
        columns = max(2, min(columns, max_quads + 1))
    elif columns == 2:
        rows = max(2, min(rows, max_quads + 1))
    # From the middle of the first pixel to that of the last.
    row, column = np.meshgrid(
        np.linspace(0.5, height - 0.5, rows), np.linspace(0.5, width - 0.5, columns), indexing="ij"
    )
    pixels = np.stack([column, row], axis=-1).reshape(-1, 2)
    matrix = terrain.heights.ground_from_pixel
    ground_m = pixels @ matrix[:, :2].T + matrix[:, 2]
    pictured = upright_grid(terrain.heights)
    place = pixels if pictured is terrain.heights else to_pixels(pictured, ground_m)
    tall, wide = pictured.values.shape
    corner = np.arange(rows * columns).reshape(rows, columns)
    faces = np.stack([corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:], corner[:-1, :-1]], axis=-1).reshape(-1, 4)
    if np.linalg.det(matrix[:, :2]) > 0:  # rows go north
        faces = faces[:, ::-1]
    return GroundMesh(
        places_m=np.column_stack([ground_m, ground_height(terrain, ground_m)]),
        faces=faces.astype(np.int32),
        st=np.stack([place[:, 0] / wide, 1 - place[:, 1] / tall], axis=-1),
        shape=(rows, columns),
    )


def mesh_height(mesh: GroundMesh, terrain: Terrain, ground_m: Floats) -> Floats:
    """(N,) heights of the mesh at places (N, 2), as it is drawn; NaN beyond its edge; metres.

    Each face is two triangles, parted from its first corner to its third, as renderers part it. What is low must stand
    on these: where the mesh is coarser than the terrain, the heights of the terrain are above it or below.
    """
    rows, columns = mesh.shape
    height, width = terrain.heights.values.shape
    pixels = (to_pixels(terrain.heights, ground_m) - 0.5) / np.maximum([width - 1, height - 1], 1)
    beyond = ((pixels < -1e-9) | (pixels > 1 + 1e-9)).any(axis=1)
    place = np.clip(pixels, 0, 1) * [columns - 1, rows - 1]
    first = np.clip(np.floor(place).astype(np.int64), 0, [columns - 2, rows - 2])
    across, down = (place - first).T
    column, row = first.T
    heights = mesh.places_m[:, 2].reshape(rows, columns)
    none = np.where(beyond, np.nan, 0.0)
    here, beside = heights[row, column], heights[row, column + 1]
    below, last = heights[row + 1, column], heights[row + 1, column + 1]
    if np.linalg.det(terrain.heights.ground_from_pixel[:, :2]) > 0:  # the first corner is here, the third is the last
        return np.asarray(
            none
            + np.where(
                across > down,
                here + across * (beside - here) + down * (last - beside),
                here + down * (below - here) + across * (last - below),
            )
        )
    return np.asarray(
        none
        + np.where(
            across + down < 1,
            here + across * (beside - here) + down * (below - here),
            last + (1 - across) * (below - last) + (1 - down) * (beside - last),
        )
    )


def middle_of(terrain: Terrain) -> Floats:
    """(3,) whole metres of easting, northing and height near the middle of the ground: the origin of an asset."""
    grid_m = pixel_grid(terrain.heights)
    middle = np.append(grid_m.reshape(-1, 2).mean(axis=0), terrain.heights.values.min())
    return np.asarray(np.floor(middle), np.float64)
