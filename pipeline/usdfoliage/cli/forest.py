"""Plant a forest on a terrain, from rasters of its ground and of what stands on it.

DEM is a raster of the ground's heights, or a mesh (.obj) of the ground, or a scan (.las, .laz, .e57, .ply, .pts), in
which the ground is found. Trees are found in the canopy height, else in the scan, or in the orthophoto where there is
neither; --trunks gives their places instead. Shrubs and grass are drawn where --vegetation has their class, or where
the pictures show them. plants.toml lists the species, their assets, heights and shares, and what they look like from
above.

    usdfoliage forest dem.tif --plants plants.toml --orthophoto photo.tif --canopy canopy.tif -o forests/valley

The forest references the assets of its plants, and opens wherever these are.

    usdfoliage forest dem.tif --plants plants.toml --canopy canopy.tif --camera shot010.usda -o forests/valley

With --camera the variant level=shot010 has what that camera sees, each plant in the form that its distance asks
for at each frame.

    usdfoliage forest dem.tif --plants plants.toml --canopy canopy.tif --tile 500 -o forests/valley --jobs 4
    usdfoliage forest dem.tif --plants plants.toml --canopy canopy.tif --tile 500 -o forests/valley --bundle valley_job

With --jobs, --scheduler, --work or --step the forest is made of tasks: the step planting plants all of it, a chunk of
the step tiles writes each tile, and the step publish writes the asset. The results of tasks are kept, so the same
command continues a run that was stopped. With --template or --bundle only a job for a render farm is written.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.options.access import given
from usdfoliage.cli.options.build import add_job, add_machines, add_openjd, add_step, add_where, add_work
from usdfoliage.cli.options.leaf_commands import add_output, add_run
from usdfoliage.cli.options.steps import LIST, PLAN, PUBLISH, print_steps, report_step, require_no_chunk, run_chunks
from usdfoliage.files.write_gate import Access

if TYPE_CHECKING:
    from usdfoliage.cli.options.openjd_lines import OpenjdLines
    from usdfoliage.jobs.forest.request import ForestRequest


FOREST = "forest"  # this command, and what it makes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.forest.grass import GrassSettings
    from usdfoliage.forest.ground_settings import GroundFilterSettings
    from usdfoliage.forest.planting import PlantingSettings
    from usdfoliage.forest.shots import ShotSettings
    from usdfoliage.forest.tree_tops import TreeTopSettings
    from usdfoliage.jobs.forest.request import ForestRequest

    files = parser.add_argument_group("input and output")
    files.add_argument(
        "dem",
        metavar="DEM",
        type=Path,
        help="The input is a raster of the ground's heights, as a GeoTIFF in a coordinate system in metres or feet. It "
        "may also be an OBJ mesh of the ground with easting, northing and height as x, y and z, or a scan in LAS, LAZ, "
        "E57, PLY or PTS.",
    )
    add_output(files)
    files.add_argument(
        "--ground-spacing",
        metavar="METRES",
        type=float,
        help="The heights of a mesh or a cloud are taken at this distance in metres. Without this option it follows "
        "from the spacing of the points.",
    )
    files.add_argument(
        "--widest-object",
        metavar="METRES",
        type=float,
        default=GroundFilterSettings.widest_object_m,
        help="In a cloud without classes the ground is found below what is no wider than this, in metres; the default "
        "is %(default)g.",
    )
    files.add_argument(
        "--plants",
        metavar="FILE",
        type=Path,
        required=True,
        help="This TOML file lists the plants, a [[plant]] row for each.",
    )
    files.add_argument(
        "--orthophoto",
        metavar="FILE",
        type=Path,
        help="This raster shows the ground and its plants from above, in red, green and blue.",
    )
    files.add_argument(
        "--canopy", metavar="FILE", type=Path, help="This raster has the height of the plants above the ground."
    )
    files.add_argument(
        "--vegetation",
        metavar="FILE",
        type=Path,
        help="This raster has a class for each place: 0 none, 1 trees, 2 shrubs, 3 grass. [classes] of the plants' "
        "file names others.",
    )
    files.add_argument(
        "--trunks",
        metavar="CSV",
        type=Path,
        help="This file has the easting and northing of a tree on each line. Trees are not looked for then.",
    )
    planting = parser.add_argument_group("of the plants, their ground and its light")
    low_m, high_m = TreeTopSettings.radius_m
    planting.add_argument(
        "--crown-radius",
        metavar=("LEAST", "GREATEST"),
        type=float,
        nargs=2,
        default=(low_m, high_m),
        help=f"Crowns with radii in this range are found, in metres; the default is {low_m:g} {high_m:g}.",
    )
    planting.add_argument(
        "--trees-per-ha",
        metavar="N",
        type=float,
        default=PlantingSettings.trees_per_ha,
        help="So many trees stand on a hectare of their class where nothing shows them singly; the default is "
        "%(default)g.",
    )
    planting.add_argument(
        "--no-find-vegetation",
        action="store_true",
        help="Shrubs and grass are drawn only where --vegetation has their class. Without this option and without "
        "--vegetation, the orthophoto and the canopy height show where they are, and what is a roof or a lawn.",
    )
    planting.add_argument(
        "--no-clear-ground",
        action="store_true",
        help="The orthophoto lies on the ground as it is, with the crowns that it shows. Without this option the "
        "ground below trees that stand where they are seen has the colours of the ground beside them.",
    )
    planting.add_argument(
        "--max-ground-cover",
        metavar="N",
        type=int,
        default=PlantingSettings.max_ground_cover,
        help="There are at most so many shrubs and tufts of grass; the default is %(default)s.",
    )
    near_m, far_m = ForestRequest.lod_distance_m
    planting.add_argument(
        "--lod-distance",
        metavar=("NEAR", "FAR"),
        type=float,
        nargs=2,
        default=(near_m, far_m),
        help="Plants change from their near to their far form between these distances from a camera, in metres; the "
        f"default is {near_m:g} {far_m:g}.",
    )
    planting.add_argument(
        "--max-terrain-quads",
        metavar="N",
        type=int,
        default=ForestRequest.max_terrain_quads,
        help="The mesh of the ground has at most so many faces; the default is %(default)s.",
    )
    planting.add_argument(
        "--tile",
        metavar="METRES",
        type=float,
        help="The forest is in square tiles of this side in metres, each behind a payload of its own. Without this "
        "option it is in one piece.",
    )
    planting.add_argument(
        "--sky",
        metavar=("AZIMUTH", "ELEVATION"),
        type=float,
        nargs=2,
        help="The forest has the light of a clear sky, whose sun stands so many degrees clockwise from north, and so "
        "many above the horizon, from 1 to 90. Without this option it has no lights.",
    )
    shots = parser.add_argument_group("of shots")
    shots.add_argument(
        "--camera",
        metavar="SHOT",
        type=Path,
        action="append",
        default=[],
        help="This USD file has the camera of a shot, in the frame of the forest. The variant level=shot_NAME has the "
        "plants that it sees, and switches them between their forms as it moves. The option can be given several "
        "times.",
    )
    shots.add_argument(
        "--camera-prim",
        metavar="PATH",
        help="The camera has this path in each file of --camera. Without it the file has one camera.",
    )
    shots.add_argument(
        "--near-level",
        choices=("leaves", "relief", "crown"),
        help="Near plants of shots, and of the level auto, are drawn so; the default is leaves where the forest has "
        "that level. crown is what every renderer draws.",
    )
    shots.add_argument(
        "--far-level",
        choices=("leaves", "relief", "crown"),
        help="Far plants of shots, and of the level auto, are drawn so; the default is relief where the forest has "
        "that level.",
    )
    shots.add_argument(
        "--max-full-plants",
        metavar="N",
        type=int,
        default=ShotSettings.max_full,
        help="So many of the plants that the camera comes nearest to are drawn whole, with their branches and leaves, "
        "in the whole shot; the default is %(default)s.",
    )
    shots.add_argument(
        "--no-grass",
        action="store_true",
        help="The forest has no grass near cameras, and no hues of grass on its ground. Without this option blades of "
        "grass stand on vegetated ground near the camera of a shot.",
    )
    shots.add_argument(
        "--grass-distance",
        metavar="METRES",
        type=float,
        default=GrassSettings.distance_m,
        help="Blades of grass stand up to this distance from the camera, in metres; the default is %(default)g.",
    )
    shots.add_argument(
        "--max-grass-clumps",
        metavar="N",
        type=int,
        default=GrassSettings.max_clumps,
        help="A shot has at most so many clumps of blades. Where there would be more, they end nearer to the camera; "
        "the default is %(default)s.",
    )
    tasks = parser.add_argument_group("of tasks, on this machine or a farm")
    add_where(tasks, has_threads=False)
    add_work(tasks)
    add_step(tasks, required=False)
    add_openjd(tasks)
    farm = parser.add_argument_group("a job for a render farm")
    add_job(farm)
    add_machines(farm)
    run_options = parser.add_argument_group("this run")
    add_run(run_options, PlantingSettings.seed, 31)


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.cli.options.forest_tasks import is_job, is_of_tasks
    from usdfoliage.cli.submit import declare_job
    from usdfoliage.jobs.plant.work_folder import find_work_folder

    reads = given(options.dem, options.plants, options.orthophoto, options.canopy, options.vegetation, options.trunks)
    reads += tuple(options.camera)
    if is_job(options):
        return declare_job(options, reads)
    fills = (find_work_folder(options.work, options.output),) if is_of_tasks(options) else ()
    return Access(reads=reads, replaces=(options.output,), fills=fills)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.options.forest import read_forest_request
    from usdfoliage.cli.options.forest_tasks import check_task_options, is_job, is_of_tasks
    from usdfoliage.cli.plant_results import print_published
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.jobs.forest.run import make_forest_asset, plan_forest_asset

    check_task_options(options)
    request = read_forest_request(options)
    if options.dry_run:
        handle_interrupts()
        print(plan_forest_asset(request))
        return 0
    if is_job(options):
        return _write_job(request, options)
    if options.step is not None:
        return _run_step(request, options)
    if is_of_tasks(options):
        return _run_tasks(request, options)
    handle_interrupts()
    with StepBar() as bar:
        made = make_forest_asset(request, bar.show)
    print_published(made, FOREST, as_json=options.json)
    return 0


def _run_tasks(request: "ForestRequest", options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.options.build import read_where
    from usdfoliage.cli.plant_results import print_published, report_fault
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.jobs.forest_tasks.build import build_of
    from usdfoliage.jobs.forest_tasks.run import InternalFault, build_forest
    from usdfoliage.jobs.plant.work_folder import find_work_folder

    where = read_where(options)
    build = build_of(request, find_work_folder(options.work, options.output))
    handle_interrupts()
    try:
        with StepBar() as bar:
            made = build_forest(build, where, request.render_setting, bar.show)
    except InternalFault as fault:
        print(report_fault(str(fault), f"a task of {request.name}", debug=options.debug), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("error: interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    print_published(made, FOREST, as_json=options.json)
    return 0


def _run_step(request: "ForestRequest", options: argparse.Namespace) -> int:
    def run_step(lines: "OpenjdLines") -> int:
        from usdfoliage.cli.interrupts import handle_interrupts
        from usdfoliage.cli.plant_results import print_published
        from usdfoliage.jobs.forest_tasks import run as forest_run
        from usdfoliage.jobs.forest_tasks.build import build_of
        from usdfoliage.jobs.plant.work_folder import find_work_folder

        build = build_of(request, find_work_folder(options.work, options.output))
        handle_interrupts()
        require_no_chunk(options)
        if options.step == LIST:
            print_steps(forest_run.find_steps(build), as_json=options.json)
            return 0
        lines.begin(f"{request.name}: {options.step}")
        if options.step == PLAN:
            print_steps(forest_run.plan_step(build), as_json=options.json)
            lines.progress(1.0)
            return 0
        if options.step == PUBLISH:
            made = forest_run.publish_forest(build, request.render_setting)
            print_published(made, FOREST, as_json=options.json)
            lines.progress(1.0)
            return 0
        asked, of = options.chunk or (options.chunks, None)
        chunks = forest_run.find_chunks(build, options.step, asked, of)
        return run_chunks(chunks, forest_run.run_chunk, lines, debug=options.debug)

    return report_step(options, run_step)


def _write_job(request: "ForestRequest", options: argparse.Namespace) -> int:
    from usdfoliage.cli.options.build import given_flags
    from usdfoliage.cli.options.forest_tasks import FLAGS, SWITCHES, list_parameters
    from usdfoliage.cli.submit import write_farm_job
    from usdfoliage.jobs.forest_tasks.build import build_of
    from usdfoliage.jobs.forest_tasks.run import find_steps
    from usdfoliage.jobs.forest_tasks.tasks import PLANTING
    from usdfoliage.jobs.plant.work_folder import find_work_folder

    parser = argparse.ArgumentParser()
    add_arguments(parser)
    work = find_work_folder(options.work, options.output)
    write_farm_job(
        options,
        name=request.name,
        steps=find_steps(build_of(request, work)),
        parameters=list_parameters(options, parser, request.name, work),
        flags=given_flags(options, FLAGS),
        switches=given_flags(options, SWITCHES),
        what=FOREST,
        command=FOREST,
        heavy=(PLANTING,),
    )
    return 0
