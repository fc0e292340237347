"""From a DEM and what lies over it to a forest on disk."""

from collections.abc import Sequence
from pathlib import Path

from usdfoliage import __version__
from usdfoliage.asset.materials.grass import GRASS_SHADER, GrassMaterial
from usdfoliage.asset.packages.forest_package import ForestParts, WrittenTile, write_forest_asset, write_forest_tile
from usdfoliage.asset.parts.part import SHADERS
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.forest.terrain import mesh_terrain
from usdfoliage.jobs.forest.inputs import describe_files, read_forest
from usdfoliage.jobs.forest.leaves import read_row_leaves
from usdfoliage.jobs.forest.levels import levels_of, measure_plants
from usdfoliage.jobs.forest.planted import PLANTING_STEPS, ForestOutline, grid_of, plant_tiles
from usdfoliage.jobs.forest.report import ForestReport, draw_forest, write_forest_report
from usdfoliage.jobs.forest.request import ForestRequest, describe_settings
from usdfoliage.jobs.forest.shots import choose_levels, read_cameras, remark_units
from usdfoliage.jobs.forest.sky import write_sky
from usdfoliage.jobs.report.published import PublishedAsset
from usdfoliage.progress import StepProgress, follow_step
from usdfoliage.remarks import label_remarks

STEPS = (*PLANTING_STEPS, "tiles", "asset", "preview")


def make_forest_asset(request: ForestRequest, progress: StepProgress | None = None) -> PublishedAsset:
    """Plant a terrain and publish it as an asset; the old asset stays until the new one is whole.

    Raises:
        FoliageError: A file cannot be used, or the output cannot be written; nothing was changed.
    """
    seconds: dict[str, float] = {}
    with publish_folder(
        request.output, force=request.force, origin=request.origin, keep_old=request.keep_old
    ) as folder:
        planted = plant_tiles(request, folder, seconds, progress)
        with follow_step("tiles", seconds, progress) as report:
            tiles = []
            for tile in planted.tiles:
                tiles.append(write_forest_tile(folder, request.name, tile))
                report(len(tiles), len(planted.tiles))
        return finish_forest(request, folder, planted.outline, tiles, seconds, progress)


def finish_forest(
    request: ForestRequest,
    folder: Path,
    outline: ForestOutline,
    tiles: Sequence[WrittenTile],
    seconds: dict[str, float],
    progress: StepProgress | None = None,
) -> PublishedAsset:
    """Write all of a forest but the layers of its tiles, inside publish_folder.

    Args:
        request: What the user asked for.
        folder: Of the asset, with what plant_tiles wrote into it, and the layers of all tiles.
        outline: Of the forest.
        tiles: Those that the outline names.
        seconds: By step, for the report; that of its own is put there.
        progress: Called with the steps.

    Raises:
        FoliageError: A file cannot be written.
    """
    with follow_step("asset", seconds, progress):
        parts = ForestParts(
            tiles=tiles,
            levels=outline.levels,
            times=outline.times,
            ground=outline.ground,
            grass=GrassMaterial(shader=f"{SHADERS}/{GRASS_SHADER}") if outline.has_grass else None,
            sky=None if request.sky is None else write_sky(folder, request.name, request.sky),
            asset_from_terrain=outline.asset_from_terrain,
        )
        interface = write_forest_asset(folder, request.name, parts, outline.provenance)
    report_folder = folder / "report"
    report_folder.mkdir(exist_ok=True)
    remarks = list(outline.remarks)
    drawn = draw_forest(interface if request.preview else None, report_folder, outline.pictures, remarks, progress)
    report = ForestReport(
        name=request.name,
        dem=request.files.dem.name,
        generator=f"usdfoliage {__version__}",
        rows=outline.rows,
        legend=outline.legend,
        histograms=outline.histograms,
        settings=describe_settings(request),
        remarks=tuple(remarks),
        render_setting=request.render_setting,
        seconds=seconds if request.times else {},
    )
    write_forest_report(report_folder, report, drawn)
    return PublishedAsset(
        asset=request.output / interface.name,
        report=request.output / "report" / "index.html",
        preview=request.output / "report" / drawn[0].file if drawn else None,
        remarks=tuple(remarks),
        rows=tuple(outline.rows),
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
    choose_levels(request.shots, levels)
    grid = None
    if request.tile_m is not None:
        grid = grid_of(request, mesh_terrain(read.planted.terrain, request.max_terrain_quads))
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
