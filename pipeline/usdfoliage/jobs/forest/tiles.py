"""A forest in tiles: the ground, the plants and the shots of each."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from usdfoliage.asset.packages.forest_package import ForestTile
from usdfoliage.asset.parts.terrain import TerrainPrim
from usdfoliage.forest.planting import Planting
from usdfoliage.forest.terrain import GroundMesh
from usdfoliage.forest.tiles import TileGrid, split_mesh


def split_forest(whole: ForestTile, mesh: GroundMesh, planting: Planting, grid: TileGrid) -> list[ForestTile]:
    """The tiles of a forest that have ground; each plant stands in one of them.

    Args:
        whole: All of it.
        mesh: Its ground, in easting, northing and height.
        planting: Its plants, as they stand in all levels.
        grid: Of the tiles.
    """
    ground = split_mesh(mesh.faces, mesh.places_m, grid)
    present = np.array(sorted(ground))
    # Beside the last tile with ground, as with turned DEMs, a plant belongs to the nearest that has some.
    of_plant = grid.number(planting.ground_m)
    beside = np.flatnonzero(~np.isin(of_plant, present))
    if len(beside):
        middle = np.stack([present % grid.columns, present // grid.columns], axis=-1) + 0.5
        nearest = cKDTree(grid.origin_m + grid.tile_m * middle).query(planting.ground_m[beside])[1]
        of_plant[beside] = present[nearest]
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
        for shot in whole.shots:
            seen = [level.take(np.flatnonzero(np.isin(level.ids, ids))) for level in shot.levels]
            shots.append(replace(shot, levels=[level for level in seen if len(level.ids)]))
        tiles.append(ForestTile(name=grid.name(number), terrain=terrain, levels=levels, shots=shots))
    return tiles
