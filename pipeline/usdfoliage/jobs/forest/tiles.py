"""A forest in tiles: the ground, the plants and the shots of each."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.asset.packages.forest_package import ForestTile
from usdfoliage.asset.parts.terrain import TerrainPrim
from usdfoliage.forest.planting import Planting
from usdfoliage.forest.terrain import GroundMesh
from usdfoliage.forest.tiles import TileGrid, split_mesh


def split_forest(
    whole: ForestTile,
    mesh: GroundMesh,
    planting: Planting,
    grid: TileGrid,
    grass_m: Sequence[NDArray[np.float64]] = (),
) -> list[ForestTile]:
    """The tiles of a forest that have ground; each plant and each clump of grass stands in one of them.

    Args:
        whole: All of it.
        mesh: Its ground, in easting, northing and height.
        planting: Its plants, as they stand in all levels.
        grid: Of the tiles.
        grass_m: (N, 2) easting and northing of the grass of each shot; (0, 2) where it has none.
    """
    ground = split_mesh(mesh.faces, mesh.places_m, grid)
    present = np.array(sorted(ground))
    of_plant = _tile_of(planting.ground_m, grid, present)
    of_grass = [_tile_of(each, grid, present) for each in grass_m]
    order = np.argsort(of_plant, kind="stable")
    bounds = np.searchsorted(of_plant[order], present), np.searchsorted(of_plant[order], present, side="right")
    tiles = []
    for number, first, last in zip(present.tolist(), *(each.tolist() for each in bounds), strict=True):
        own = np.sort(order[first:last])
        points, faces = ground[number]
        terrain = TerrainPrim(points_m=whole.terrain.points_m[points], faces=faces, st=whole.terrain.st[points])
        levels = [level.take(own) for level in whole.levels]
        ids = levels[0].ids
        shots = []
        for index, shot in enumerate(whole.shots):
            seen = [level.take(np.flatnonzero(np.isin(level.ids, ids))) for level in shot.levels]
            clumps = np.flatnonzero(of_grass[index] == number) if shot.grass is not None else np.zeros(0, np.int64)
            grass = shot.grass.take(clumps) if shot.grass is not None and len(clumps) else None
            shots.append(replace(shot, levels=[level for level in seen if len(level.ids)], grass=grass))
        tiles.append(replace(whole, name=grid.name(number), terrain=terrain, levels=levels, shots=shots))
    return tiles


def _tile_of(ground_m: NDArray[np.float64], grid: TileGrid, present: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) the tile of places (N, 2): beside the last with ground, as with turned DEMs, the nearest that has some."""
    number = grid.number(ground_m)
    beside = np.flatnonzero(~np.isin(number, present))
    if len(beside):
        middle = np.stack([present % grid.columns, present // grid.columns], axis=-1) + 0.5
        nearest = cKDTree(grid.origin_m + grid.tile_m * middle).query(ground_m[beside])[1]
        number[beside] = present[nearest]
    return number
