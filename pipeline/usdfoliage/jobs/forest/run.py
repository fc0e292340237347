"""From a DEM and what lies over it to a forest on disk."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.materials.grass import GRASS_SHADER, GrassMaterial
from usdfoliage.asset.packages.forest_package import ForestParts, ForestTile, tile_folder, write_forest_asset
from usdfoliage.asset.packages.planted_assets import PlantedAsset
from usdfoliage.asset.parts.part import MAPS, SHADERS
from usdfoliage.asset.parts.terrain import TerrainPrim
from usdfoliage.asset.provenance import Provenance, combined_sha256
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.errors import CaptureError
from usdfoliage.files.hashing import hash_bytes, hash_file
from usdfoliage.forest.ground_files import is_ground_file
from usdfoliage.forest.kinds import PlantKind
from usdfoliage.forest.planting import Planting, PlantingSettings, plant_forest
from usdfoliage.forest.raster import Raster
from usdfoliage.forest.sky import SkySettings
from usdfoliage.forest.terrain import GroundMesh, mesh_terrain, middle_of
from usdfoliage.forest.tiles import MIN_QUADS, TileGrid, tile_ground
from usdfoliage.jobs.forest.grass import GrassRequest, ShotGrass, grass_rows, grow_grass
from usdfoliage.jobs.forest.ground import write_ground_maps
from usdfoliage.jobs.forest.inputs import ForestFiles, ReadForest, describe_files, read_forest
from usdfoliage.jobs.forest.leaves import RowLeaf, read_row_leaves, write_row_leaves
from usdfoliage.jobs.forest.levels import count_rows, levels_of, make_level, measure_plants
from usdfoliage.jobs.forest.report import ForestReport, draw_forest, draw_shots, write_forest_report
from usdfoliage.jobs.forest.shots import (
    ShotRequest,
    choose_levels,
    plan_planted_shot,
    read_cameras,
    remark_units,
    shot_rows,
)
from usdfoliage.jobs.forest.sky import write_sky
from usdfoliage.jobs.forest.tiles import split_forest
from usdfoliage.jobs.report.table import Row
from usdfoliage.progress import Progress, StepProgress, follow_step
from usdfoliage.remarks import Argument, Remark, RenderSetting, as_plan_setting, label_remarks, remark

STEPS = ("read", "plants", "planting", "asset", "preview")
MAX_TERRAIN_QUADS = 50_000_000


@dataclass(frozen=True, kw_only=True)
class ForestRequest:
    """What the user asked for, checked."""

    files: ForestFiles
    output: Path
    name: str
    planting: PlantingSettings = field(default_factory=PlantingSettings)
    max_terrain_quads: int = 1_000_000
    lod_distance_m: tuple[float, float] = (100.0, 200.0)  # as the thesis has it, section 7.3
    shots: ShotRequest = field(default_factory=ShotRequest)
    grass: GrassRequest = field(default_factory=GrassRequest)  # near the cameras of shots
    sky: SkySettings | None = None  # where the sun is; None for a forest without lights
    tile_m: float | None = None  # side of tiles; None for a forest in one piece
    force: bool = False
    keep_old: bool = False
    preview: bool = True
    times: bool = True
    render_setting: RenderSetting = as_plan_setting

    def __post_init__(self) -> None:
        if not 1 <= self.max_terrain_quads <= MAX_TERRAIN_QUADS:
            raise ValueError(f"max_terrain_quads must be 1 to {MAX_TERRAIN_QUADS:,}, not {self.max_terrain_quads}")
        near_m, far_m = self.lod_distance_m
        if not 0 <= near_m <= far_m < np.inf:
            raise ValueError(
                f"lod_distance must be two distances from 0 on, the nearer first, not {near_m:g} {far_m:g}"
            )
        if self.tile_m is not None and not (np.isfinite(self.tile_m) and self.tile_m > 0):
            raise ValueError(f"tile must be a length above 0, not {self.tile_m:g}")

    @property
    def origin(self) -> AssetOrigin:
        """Of the asset."""
        return AssetOrigin(name=self.name, command="forest", source=self.files.dem.resolve().name)


@dataclass(frozen=True, kw_only=True)
class WrittenForest:
    """What was written, and what the user should know of it."""

    asset: Path
    report: Path
    preview: Path | None
    remarks: tuple[Remark, ...]
    rows: tuple[Row, ...]


def make_forest_asset(request: ForestRequest, progress: StepProgress | None = None) -> WrittenForest:
    """Plant a terrain and publish it as an asset; the old asset stays until the new one is whole.

    Raises:
        FoliageError: A file cannot be used, or the output cannot be written; nothing was changed.
    """
    seconds: dict[str, float] = {}
    with publish_folder(
        request.output, force=request.force, origin=request.origin, keep_old=request.keep_old
    ) as folder:
        with follow_step("read", seconds, progress):
            read = read_forest(request.files)
            cameras = read_cameras(request.shots)
        with follow_step("plants", seconds, progress):
            assets = measure_plants(read.planted.plants, request.output)
            row_leaves = read_row_leaves(read.planted.plants, assets, request.output)
        with follow_step("planting", seconds, progress):
            planting = plant_forest(read.planted, request.planting)
        remarks = [*read.remarks, *remark_units(request.shots.files, cameras), *describe_planting(planting)]
        with follow_step("asset", seconds, progress):
            origin_m = middle_of(read.planted.terrain)
            asset_from_ground = frame_of(origin_m)
            look = write_ground_maps(folder, request.name, read.planted, planting, grass=request.grass.grown)
            ground = look.material
            mesh = mesh_terrain(read.planted.terrain, request.max_terrain_quads)
            points = np.column_stack([mesh.places_m, np.ones(len(mesh.places_m))]) @ asset_from_ground.T
            terrain = TerrainPrim(points_m=points[:, :3], faces=mesh.faces, st=mesh.st)
            grid = _tiles_of(request, mesh)
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
            if ground.texture and bounds is not None:
                seen_from_layers = ground.texture if grid is None else f"../../{ground.texture}"
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
                        look.open_sky,
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
            whole = ForestTile(terrain=terrain, levels=levels, shots=planted)
            grass_m = [np.zeros((0, 2)) if each is None else each.ground_m for each in grass]
            tiles = [whole] if grid is None else split_forest(whole, mesh, planting, grid, grass_m)
            interface = write_forest_asset(
                folder,
                request.name,
                ForestParts(
                    tiles=tiles,
                    ground=ground,
                    grass=GrassMaterial(shader=f"{SHADERS}/{GRASS_SHADER}") if any(grass) else None,
                    sky=None if request.sky is None else write_sky(folder, request.name, request.sky),
                    asset_from_terrain=asset_from_ground
                    @ np.diag([read.metres_per_unit, read.metres_per_unit, read.metres_per_height, 1.0]),
                ),
                _provenance(request, assets, row_leaves),
                _progress_of_tiles(progress),
            )
        report_folder = folder / "report"
        report_folder.mkdir(exist_ok=True)
        names = [shot.planted.name for shot in shots]
        rows = (
            *forest_rows(planting, read),
            *shot_rows(shots, len(planting)),
            *grass_rows(names, grass, planting.vegetated, request.grass),
        )
        drawn = draw_forest(interface if request.preview else None, report_folder, terrain, remarks, progress)
        if drawn:
            drawn = (*drawn, *draw_shots(interface, report_folder, shots, progress))
        report = ForestReport(
            name=request.name,
            dem=request.files.dem.name,
            generator=f"usdfoliage {__version__}",
            rows=rows,
            settings=describe_settings(request),
            remarks=tuple(remarks),
            render_setting=request.render_setting,
            seconds=seconds if request.times else {},
        )
        write_forest_report(report_folder, report, read.planted, planting, drawn)
    return WrittenForest(
        asset=request.output / interface.name,
        report=request.output / "report" / "index.html",
        preview=request.output / "report" / drawn[0].file if drawn else None,
        remarks=tuple(remarks),
        rows=rows,
    )


def plan_forest_asset(request: ForestRequest) -> str:
    """What make_forest_asset would do, in lines, after checking the input; writes nothing.

    Raises:
        FoliageError: A file cannot be used.
    """
    would = plan_folder(
        request.output, f"{request.name}.usda", request.force, origin=request.origin, keep_old=request.keep_old
    )
    read = read_forest(request.files)
    cameras = read_cameras(request.shots)
    assets = measure_plants(read.planted.plants, request.output)
    read_row_leaves(read.planted.plants, assets, request.output)
    levels = levels_of(assets)
    if cameras:
        choose_levels(request.shots, levels)
    grid = None
    if request.tile_m is not None:
        grid = _tiles_of(request, mesh_terrain(read.planted.terrain, request.max_terrain_quads))
    height, width = read.planted.terrain.heights.values.shape
    return "\n".join(
        [
            *describe_files(request.files),
            f"terrain: {width:,} x {height:,} pixels of {read.planted.terrain.heights.cell_m:.3g} m",
            *([] if grid is None else [f"tiles: {grid.columns:,} x {grid.rows:,}"]),
            f"species: {', '.join(row.species for row in read.planted.plants.rows)}",
            *(
                f"shot: {file}, {camera.prim}, frames {camera.path.frame[0]:g} to {camera.path.frame[-1]:g}"
                for file, camera in zip(request.shots.files, cameras, strict=True)
            ),
            *label_remarks((*read.remarks, *remark_units(request.shots.files, cameras)), request.render_setting),
            f"settings: {', '.join(f'{name} {value}' for name, value in describe_settings(request).items())}",
            f"steps: {', '.join(STEPS if request.preview else STEPS[:-1])}",
            would,
        ]
    )


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


def describe_settings(request: ForestRequest) -> Mapping[str, str]:
    """Every setting that decides the result, by the name of its option."""
    planting = request.planting
    low_m, high_m = planting.tree_tops.radius_m
    return {
        "seed": str(planting.seed),
        "crown-radius": f"{low_m:g} {high_m:g}",
        "trees-per-ha": f"{planting.trees_per_ha:g}",
        **({} if planting.find_classes else {"no-find-vegetation": "yes"}),
        "max-ground-cover": str(planting.max_ground_cover),
        "lod-distance": "{:g} {:g}".format(*request.lod_distance_m),
        "max-terrain-quads": str(request.max_terrain_quads),
        **({} if request.files.ground.spacing_m is None else {"ground-spacing": f"{request.files.ground.spacing_m:g}"}),
        **(
            {"widest-object": f"{request.files.ground.filter.widest_object_m:g}"}
            if is_ground_file(request.files.dem)
            else {}
        ),
        **({} if request.sky is None else {"sky": f"{request.sky.azimuth_deg:g} {request.sky.elevation_deg:g}"}),
        **({} if request.tile_m is None else {"tile": f"{request.tile_m:g}"}),
        **_describe_shots(request.shots),
        **_describe_grass(request),
    }


def _picture_bounds(heights: Raster, origin_m: NDArray[np.float64]) -> tuple[float, float, float, float] | None:
    """Least x and z, greatest x and z of the picture of the ground; None where north is not up in it."""
    matrix = heights.ground_from_pixel
    if matrix[0, 1] or matrix[1, 0] or matrix[0, 0] < 0 or matrix[1, 1] > 0:
        return None
    height, width = heights.values.shape
    west, north = matrix[:, 2] - origin_m[:2]
    return float(west), float(-north), float(west + width * matrix[0, 0]), float(-north - height * matrix[1, 1])


def _describe_shots(shots: ShotRequest) -> dict[str, str]:
    """What decides how shots are planned; nothing without a shot."""
    if not shots.files:
        return {}
    named = {"camera-prim": shots.prim, "near-level": shots.near, "far-level": shots.far}
    return {
        "max-full-plants": str(shots.settings.max_full),
        **{name: value for name, value in named.items() if value is not None},
    }


def _describe_grass(request: ForestRequest) -> dict[str, str]:
    """What decides how much grass there is."""
    if not request.grass.grown:
        return {"no-grass": "yes"}
    if not request.shots.files:
        return {}
    settings = request.grass.settings
    return {"max-grass-clumps": str(settings.max_clumps), "grass-distance": f"{settings.distance_m:g}"}


def _tiles_of(request: ForestRequest, mesh: GroundMesh) -> TileGrid | None:
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


def _progress_of_tiles(progress: StepProgress | None) -> Progress | None:
    return None if progress is None else lambda done, count: progress("asset", done / count)


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
