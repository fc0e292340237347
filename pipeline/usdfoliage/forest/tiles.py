"""Tiles of a terrain: squares of easting and northing, each with the ground and the plants that lie in it alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_TILES = 1_000
MIN_QUADS = 2  # of the ground's mesh, along a tile


@dataclass(frozen=True, kw_only=True, eq=False)
class TileGrid:
    """Squares in rows from south to north, numbered from the south-west."""

    origin_m: NDArray[np.float64]  # (2,), easting and northing of the south-west corner
    tile_m: float
    columns: int
    rows: int

    def __len__(self) -> int:
        return self.columns * self.rows

    def number(self, ground_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """(N,) tile of each place (N, 2): one on an edge is in the tile to the east or north; the last has its end."""
        cell = np.floor((ground_m - self.origin_m) / self.tile_m).astype(np.int64)
        cell = np.clip(cell, 0, [self.columns - 1, self.rows - 1])
        return np.asarray(cell[:, 1] * self.columns + cell[:, 0])

    def name(self, number: int) -> str:
        """Of a tile, by its column and row, an identifier."""
        row, column = divmod(number, self.columns)
        digits = len(str(max(self.columns, self.rows) - 1))
        return f"tile_{column:0{digits}}_{row:0{digits}}"


def tile_ground(places_m: NDArray[np.float64], tile_m: float) -> TileGrid:
    """The tiles of ground (N, 2 or more), at whole multiples of their size, so that neighbours on other DEMs fit.

    Raises:
        ValueError: There would be more than MAX_TILES.
    """
    low_m, high_m = places_m[:, :2].min(axis=0), places_m[:, :2].max(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        first = np.floor(low_m / tile_m)
        counts = np.maximum(np.ceil(high_m / tile_m) - first, 1)
    if not counts.prod() <= MAX_TILES:
        raise ValueError(f"tiles of {tile_m:g} m would be {counts.prod():,.0f}, and {MAX_TILES:,} are allowed")
    columns, rows = counts.astype(np.int64).tolist()
    return TileGrid(origin_m=first * tile_m, tile_m=tile_m, columns=columns, rows=rows)


def split_mesh(
    faces: NDArray[np.int32], places_m: NDArray[np.float64], grid: TileGrid
) -> dict[int, tuple[NDArray[np.int64], NDArray[np.int32]]]:
    """The points (K,) and faces (F', 4) of each tile that has a face: each face is in one, by its middle.

    Args:
        faces: (F, 4).
        places_m: (V, 3), easting, northing and height.
        grid: Of the tiles.
    """
    of_face = grid.number(places_m[faces, :2].mean(axis=1))
    order = np.argsort(of_face, kind="stable")
    numbers, first = np.unique(of_face[order], return_index=True)
    split = {}
    for number, own in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
        points, corners = np.unique(faces[own], return_inverse=True)
        split[number] = (points.astype(np.int64), corners.reshape(-1, 4).astype(np.int32))
    return split
