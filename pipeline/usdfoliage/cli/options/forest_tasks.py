"""How the tasks of a forest are chosen, and what a farm is given of its options."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from usdfoliage.jobs.plant.farm_job import JobParameter

WHOLE_STEPS = ("list", "plan", "publish")  # which have no chunks
FLAGS = ("--no-preview", "--reproducible", "--force", "--keep-old")  # of the last step
SWITCHES = ("--no-find-vegetation", "--no-clear-ground", "--no-grass")  # of all steps
_FILES = (
    ("plants", "the plants, TOML"),
    ("orthophoto", "what the ground and its plants look like from above"),
    ("canopy", "the height of the plants above the ground"),
    ("vegetation", "the class of each place"),
    ("trunks", "where trees stand, CSV"),
)
_VALUES = (
    ("ground_spacing", "FLOAT", ("",), "metres between heights that are taken of a mesh or a cloud"),
    ("crown_radius", "FLOAT", ("Least", "Greatest"), "metres, of crowns that are found"),
    ("trees_per_ha", "FLOAT", ("",), "where nothing shows them singly"),
    ("max_ground_cover", "INT", ("",), "shrubs and tufts of grass, at most"),
    ("lod_distance", "FLOAT", ("Near", "Far"), "metres, between which plants change their form"),
    ("max_terrain_quads", "INT", ("",), "faces of the ground, at most"),
    ("tile", "FLOAT", ("",), "side of a tile in metres"),
    ("sky", "FLOAT", ("Azimuth", "Elevation"), "degrees, of the sun"),
    ("camera_prim", "STRING", ("",), "path of the camera in each file of a shot"),
    ("near_level", "STRING", ("",), "of near plants of shots"),
    ("far_level", "STRING", ("",), "of far plants of shots"),
    ("grass_distance", "FLOAT", ("",), "metres from the camera, up to which blades of grass stand"),
    ("max_grass_clumps", "INT", ("",), "of a shot, at most"),
    ("widest_object", "FLOAT", ("",), "metres, of what stands on the ground of a cloud"),
    ("max_full_plants", "INT", ("",), "of a shot, drawn whole"),
    ("seed", "INT", ("",), "of every random choice"),
)


def is_job(options: argparse.Namespace) -> bool:
    """Whether a job for a farm is written, and nothing planted."""
    return options.template is not None or options.bundle is not None


def is_of_tasks(options: argparse.Namespace) -> bool:
    """Whether the forest is made of tasks, whose results are kept."""
    return bool(options.jobs > 1 or options.scheduler or options.work is not None or options.step is not None)


def check_task_options(options: argparse.Namespace) -> None:
    """FoliageError for options that are not for each other."""
    from usdfoliage.cli.options.build import read_where
    from usdfoliage.errors import FoliageError

    read_where(options)
    if options.step is None and (options.chunk or options.chunks or options.openjd):
        raise FoliageError("--chunk, --chunks and --openjd are for one step", "give --step, too")
    if options.step is not None and is_job(options):
        raise FoliageError(
            "--step does a step, and --template and --bundle write a job of all steps", "give one of them"
        )
    if options.json and (is_job(options) or options.step not in (None, *WHOLE_STEPS)):
        raise FoliageError(
            f"--json is for a whole forest, and for the steps {', '.join(WHOLE_STEPS)}", "leave --json out"
        )
    if options.step is not None and (options.jobs > 1 or options.scheduler):
        raise FoliageError("--step runs in this process", "leave --jobs and --scheduler out")


def list_parameters(
    options: argparse.Namespace, parser: argparse.ArgumentParser, name: str, work: Path
) -> "list[JobParameter]":
    """What whoever submits the job of a forest may change: its files, and the options that the user has given.

    Args:
        options: Of the command.
        parser: Which has read them, and knows the defaults.
        name: Of the asset.
        work: The work folder.
    """
    from usdfoliage.jobs.plant.farm_job import JobParameter

    parameters = [
        _file_parameter("Dem", options.dem, "heights of the ground, or a mesh or a cloud of it", ""),
        JobParameter(
            name="AssetDir",
            kind="PATH",
            value=str(options.output.absolute()),
            description="where the asset is put",
            option="-o",
            flow="OUT",
        ),
        JobParameter(
            name="WorkDir",
            kind="PATH",
            value=str(work),
            description="where results of tasks are kept; all workers must see it",
            option="--work",
            flow="INOUT",
        ),
        JobParameter(name="Name", kind="STRING", value=name, description="of the asset", option="--name"),
    ]
    for field, what in _FILES:
        path = getattr(options, field)
        if path is not None:
            parameters.append(_file_parameter(field.title(), path, what, f"--{field}"))
    for number, path in enumerate(options.camera):
        parameters.append(_file_parameter(f"Camera{number + 1}", path, "a shot, with its camera", "--camera"))
    for field, kind, ends, what in _VALUES:
        value = getattr(options, field)
        if value is None or value == parser.get_default(field):
            continue
        values = value if len(ends) > 1 else (value,)
        for end, each in zip(ends, values, strict=True):
            is_first = end == ends[0]
            parameters.append(
                JobParameter(
                    name=field.title().replace("_", "") + end,
                    kind=kind,
                    value=each,
                    description=what,
                    option=f"--{field.replace('_', '-')}" if is_first else "",
                )
            )
    return parameters


def _file_parameter(name: str, path: Path, what: str, option: str) -> "JobParameter":
    from usdfoliage.jobs.plant.farm_job import JobParameter

    return JobParameter(
        name=name,
        kind="PATH",
        value=str(path.absolute()),
        description=what,
        option=option,
        is_file=True,
        flow="IN",
    )
