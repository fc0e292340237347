"""A terrain planted: the tiles of a forest before any layer is written, and all that holds them together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.materials.ground import GroundMaterial
from usdfoliage.asset.packages.forest_package import ForestTile, names_of_levels, tile_folder, times_of
from usdfoliage.asset.packages.planted_assets import PlantedAsset
from usdfoliage.asset.parts.part import MAPS
from usdfoliage.asset.parts.terrain import TerrainPrim
from usdfoliage.asset.provenance import Provenance, combined_sha256
from usdfoliage.errors import CaptureError
from usdfoliage.files.hashing import hash_bytes, hash_file
from usdfoliage.forest.kinds import PlantKind
from usdfoliage.forest.planting import Planting, plant_forest
from usdfoliage.forest.raster import Raster, upright_grid
from usdfoliage.forest.terrain import GroundMesh, Terrain, mesh_terrain, middle_of
from usdfoliage.forest.tiles import MIN_QUADS, TileGrid, split_mesh, tile_ground
from usdfoliage.jobs.forest.grass import ShotGrass, grass_rows, grow_grass
from usdfoliage.jobs.forest.ground import write_ground_maps
from usdfoliage.jobs.forest.inputs import ReadForest, read_forest
from usdfoliage.jobs.forest.leaves import RowLeaf, read_row_leaves, write_row_leaves
from usdfoliage.jobs.forest.levels import count_rows, levels_of, make_level, measure_plants
from usdfoliage.jobs.forest.report import (
    ForestPicture,
    count_heights,
    list_pictures,
    list_shot_pictures,
    write_forest_map,
)
from usdfoliage.jobs.forest.request import ForestRequest, describe_settings
from usdfoliage.jobs.forest.shots import auto_plants, plan_planted_shot, read_cameras, remark_units, shot_rows
from usdfoliage.jobs.forest.tiles import split_forest
from usdfoliage.jobs.report.table import Histogram, Row
from usdfoliage.progress import StepProgress, follow_step
from usdfoliage.remarks import Argument, Remark, remark

PLANTING_STEPS = ("read", "plants", "planting", "levels")  # of plant_tiles, in their order


@dataclass(frozen=True, kw_only=True, eq=False)
class ForestOutline:
    """What is known of a planted forest but its tiles: enough to write all of the asset but their layers."""

    tiles: Sequence[str]  # their names, in their order; one empty name where the forest is in one piece
    levels: Sequence[str]  # variants, of which the first is the default
    times: Mapping[str, float]  # metadata of layers, from the first to the last frame of all shots
    ground: GroundMaterial  # its pictures are in the folder that the forest was planted into
    has_grass: bool  # whether a shot has some
    asset_from_terrain: NDArray[np.float64]  # (4, 4), column vectors: easting, northing and height as the file has them
    provenance: Provenance
    rows: Sequence[Row]  # figures, for report and terminal
    remarks: Sequence[Remark]
    legend: Sequence[Row]  # of the map in the report
    histograms: Sequence[Histogram]
    pictures: Sequence[ForestPicture]  # that the report may have


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantedForest:
    """A forest in memory."""

    tiles: Sequence[ForestTile]
    outline: ForestOutline


def plant_tiles(
    request: ForestRequest, folder: Path, seconds: dict[str, float], progress: StepProgress | None = None
) -> PlantedForest:
    """Plant a terrain, and write the pictures that need all of it.

    Args:
        request: What is planted.
        folder: Gets maps/ and report/ of the asset, with the pictures of the ground and the map of the plants.
        seconds: By step; those of its steps are put there.
        progress: Called with the steps.

    Raises:
        FoliageError: A file cannot be used, or a picture cannot be written.
    """
    with follow_step("read", seconds, progress):
        read = read_forest(request.files)
        cameras = read_cameras(request.shots)
    with follow_step("plants", seconds, progress):
        assets = measure_plants(read.planted.plants, request.output)
        row_leaves = read_row_leaves(read.planted.plants, assets, request.output)
    with follow_step("planting", seconds, progress):
        planting = plant_forest(read.planted, request.planting)
    remarks = [*read.remarks, *remark_units(request.shots.files, cameras), *describe_planting(planting)]
    with follow_step("levels", seconds, progress):
        origin_m = middle_of(read.planted.terrain)
        asset_from_ground = frame_of(origin_m)
        look = write_ground_maps(
            folder,
            request.name,
            read.planted,
            planting,
            grass=request.grass.grown,
            clear=request.clear_ground,
            seed=request.planting.seed,
        )
        ground = look.material
        (folder / "report").mkdir(exist_ok=True)
        legend = write_forest_map(folder / "report", read.planted, planting)
        mesh = mesh_terrain(read.planted.terrain, request.max_terrain_quads)
        points = np.column_stack([mesh.places_m, np.ones(len(mesh.places_m))]) @ asset_from_ground.T
        terrain = TerrainPrim(points_m=points[:, :3], faces=mesh.faces, st=mesh.st)
        grid = grid_of(request, mesh)
        layers = tile_folder(request.output.absolute() / "payload", "" if grid is None else grid.name(0))
        maps = MAPS if grid is None else f"../../{MAPS}"
        leaves = write_row_leaves(folder, request.name, row_leaves, maps)
        levels = [
            make_level(
                name,
                planting,
                read.planted.plants,
                assets,
                layers,
                asset_from_ground,
                request.planting.seed,
                request.lod_distance_m,
                leaves,
            )
            for name in levels_of(assets)
        ]
        bounds = _picture_bounds(read.planted.terrain.heights, origin_m)
        if look.orthophoto:
            seen_from_layers = look.orthophoto if grid is None else f"../../{look.orthophoto}"
            levels = [replace(level, orthophoto=seen_from_layers, orthophoto_bounds_m=bounds) for level in levels]
        may_be_full = np.array([asset.full is not None for asset in assets])[planting.row]
        by_name = {level.name: level for level in levels}
        shots = [
            plan_planted_shot(file, camera, by_name, may_be_full, request.shots)
            for file, camera in zip(request.shots.files, cameras, strict=True)
        ]
        grass: list[ShotGrass | None] = [None] * len(shots)
        if request.grass.grown and planting.vegetated is not None:
            grass = [
                grow_grass(
                    read.planted,
                    planting.vegetated,
                    look,
                    mesh,
                    shot.camera.path,
                    asset_from_ground,
                    request.planting.seed,
                    request.shots.settings.margin,
                    request.grass.settings,
                )
                for shot in shots
            ]
        planted = [
            replace(shot.planted, grass=None if each is None else each.prim)
            for shot, each in zip(shots, grass, strict=True)
        ]
        auto = auto_plants(request.shots, by_name, request.lod_distance_m)
        whole = ForestTile(terrain=terrain, levels=levels, auto=auto, shots=planted)
        grass_m = [np.zeros((0, 2)) if each is None else each.ground_m for each in grass]
        tiles = [whole] if grid is None else split_forest(whole, mesh, planting, grid, grass_m)
    outline = ForestOutline(
        tiles=[tile.name for tile in tiles],
        levels=names_of_levels(tiles[0]),
        times=times_of(tiles[0].shots),
        ground=ground,
        asset_from_terrain=asset_from_ground
        @ np.diag([read.metres_per_unit, read.metres_per_unit, read.metres_per_height, 1.0]),
        provenance=_provenance(request, assets, row_leaves),
        has_grass=any(grass),
        rows=(
            *forest_rows(planting, read),
            *shot_rows(shots, len(planting)),
            *grass_rows([shot.planted.name for shot in shots], grass, planting.vegetated, request.grass),
        ),
        remarks=tuple(remarks),
        legend=legend,
        histograms=count_heights(planting),
        pictures=(*list_pictures(terrain, levels), *list_shot_pictures(shots)),
    )
    return PlantedForest(tiles=tiles, outline=outline)


def list_tiles(request: ForestRequest, terrain: Terrain) -> tuple[str, ...]:
    """The names of the tiles that plant_tiles makes of a terrain; one empty name for a forest in one piece.

    Raises:
        CaptureError: There would be too many, or their ground would have hardly a face.
    """
    if request.tile_m is None:
        return ("",)
    mesh = mesh_terrain(terrain, request.max_terrain_quads)
    grid = grid_of(request, mesh)
    assert grid is not None
    return tuple(grid.name(number) for number in sorted(split_mesh(mesh.faces, mesh.places_m, grid)))


def frame_of(origin_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4), column vectors: (easting, northing, height) in metres to (x, y, z), Y up, north to -Z, about an origin.

    Positions in single precision keep their millimetres that way.
    """
    turn = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    move = np.eye(4)
    move[:3, 3] = -origin_m
    return np.asarray(turn @ move)


def describe_planting(planting: Planting) -> list[Remark]:
    """Remarks on what was not planted, and why."""
    remarks = []
    for reason, count in sorted(planting.not_planted.items()):
        remarks.append(remark("plants-left-out", f"{count:,} plants are left out: {reason}"))
    if planting.found_shares:
        shares = ", ".join(f"{kind} {share:.0%}" for kind, share in planting.found_shares.items())
        text = f"no raster of vegetation is given; found in the pictures, of the ground: {shares}"
        remarks.append(remark("vegetation-found", text))
    for kind in planting.empty_kinds:
        text = f"there is ground of the class {kind}, and plants.toml has no row of that kind: it stays empty"
        remarks.append(remark("class-without-plants", text, subject=str(kind)))
    if not len(planting):
        remarks.append(remark("no-plants", "nothing shows where plants stand, and no plant is planted"))
    return remarks


def forest_rows(planting: Planting, read: ReadForest) -> tuple[Row, ...]:
    """The figures of a forest, for report and terminal."""
    terrain = read.planted.terrain
    height, width = terrain.heights.values.shape
    cell_m = terrain.heights.cell_m
    low_m, high_m = float(terrain.heights.values.min()), float(terrain.heights.values.max())
    rows = [
        Row(
            name="terrain",
            value=f"{width * cell_m:,.0f} x {height * cell_m:,.0f} m",
            remark=f"{low_m:.1f} to {high_m:.1f} m high",
        ),
        Row(name="plants", value=f"{len(planting):,}", remark=f"{int(planting.seen.sum()):,} of them placed singly"),
    ]
    rows += [
        Row(name=species, value=f"{count:,}") for species, count in count_rows(planting, read.planted.plants).items()
    ]
    trees = np.array([row.kind == PlantKind.TREE for row in read.planted.plants.rows])[planting.row]
    if trees.any():
        low, middle, high = np.percentile(planting.height_m[trees], [5, 50, 95])
        rows.append(
            Row(
                name="height of trees",
                value=f"{middle:.1f} m",
                remark=f"median; 90 % of them {low:.1f} to {high:.1f} m",
            )
        )
    return tuple(rows)


def grid_of(request: ForestRequest, mesh: GroundMesh) -> TileGrid | None:
    """The tiles that the user asked for.

    Raises:
        CaptureError: There would be too many, or their ground would have hardly a face.
    """
    if request.tile_m is None:
        return None
    try:
        grid = tile_ground(mesh.places_m, request.tile_m)
    except ValueError as error:
        raise CaptureError(str(error), ("give a greater length to ", Argument(name="tile"))) from error
    first = mesh.places_m[mesh.faces[0], :2]
    quad_m = float(np.linalg.norm(first - np.roll(first, 1, axis=0), axis=1).max())
    if request.tile_m < MIN_QUADS * quad_m:
        raise CaptureError(
            f"tiles of {request.tile_m:g} m would have hardly a face of the ground, which are {quad_m:.3g} m wide",
            (
                "give a greater length to ",
                Argument(name="tile"),
                ", or more faces with ",
                Argument(name="max_terrain_quads"),
            ),
        )
    return grid


def _picture_bounds(heights: Raster, origin_m: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Least x and z, greatest x and z of the pictures of the ground."""
    pictured = upright_grid(heights)
    matrix = pictured.ground_from_pixel
    height, width = pictured.values.shape
    west, north = matrix[:, 2] - origin_m[:2]
    return float(west), float(-north), float(west + width * matrix[0, 0]), float(-north - height * matrix[1, 1])


def _provenance(request: ForestRequest, assets: Sequence[PlantedAsset], leaves: Sequence[RowLeaf | None]) -> Provenance:
    inputs = {f"{role}/{path.name}": hash_file(path).hex() for role, path in request.files.by_role.items()}
    inputs |= {
        f"camera_{number + 1}/{file.name}": hash_file(file).hex() for number, file in enumerate(request.shots.files)
    }
    for number, asset in enumerate(assets):
        inputs[f"plant_{number + 1}/{asset.layer.name}"] = hash_file(asset.layer).hex()
    for number, leaf in enumerate(leaves):
        if leaf is not None:
            inputs[f"plant_{number + 1}/leaf"] = hash_bytes(leaf.picture.rgba.tobytes()).hex()
    return Provenance(
        capture=request.files.dem.name,
        generator=f"usdfoliage {__version__}",
        seed=request.planting.seed,
        settings=describe_settings(request),
        input_sha256=combined_sha256(inputs),
        inputs=inputs,
    )
