"""Options that build, batch, submit, task and forest share."""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.options.leaf_commands import add_replacing, add_reproducible
from usdfoliage.cli.options.setting_help import describe_setting
from usdfoliage.jobs.plant.work_folder import BESIDE_ASSET, WORK_VARIABLE, find_work_folder

if TYPE_CHECKING:
    from usdfoliage.jobs.plant.call import BuildRequest
    from usdfoliage.jobs.plant.executor_choice import ExecutorChoice
    from usdfoliage.jobs.plant.settings import BuildSettings


def add_plan(parser: argparse._ActionsContainer) -> None:
    """What decides the plant."""
    from usdfoliage.jobs.plant.plant_settings import PlantSettings, SeedSettings

    parser.add_argument(
        "--plan",
        metavar="FILE",
        type=Path,
        help="This TOML file has the settings of every stage, as usdfoliage build --print-plan prints them. "
        "Settings that it leaves out keep their defaults.",
    )
    parser.add_argument("--species", metavar="NAME", help=describe_setting(PlantSettings(), "species"))
    parser.add_argument("--hold-back", metavar="N", type=int, help=describe_setting(PlantSettings(), "hold_back"))
    parser.add_argument("--sway", metavar="FRAMES", type=int, help=describe_setting(PlantSettings(), "sway_frames"))
    parser.add_argument("--growth", metavar="FRAMES", type=int, help=describe_setting(PlantSettings(), "growth_frames"))
    parser.add_argument("--seed", metavar="N", type=int, help=describe_setting(SeedSettings(), "seed"))
    parser.add_argument(
        "--profile",
        metavar="FILE",
        type=Path,
        help="This TOML file has the studio's rules for validation. The default comes with usdfoliage.",
    )


def add_work(parser: argparse._ActionsContainer) -> None:
    """Where results of tasks are kept."""
    parser.add_argument(
        "--work",
        metavar="FOLDER",
        type=Path,
        help="The results of tasks are kept in this folder. Many plants may share it, and you may delete it when no "
        f"run uses it. The default is the folder in ${WORK_VARIABLE}, or else {BESIDE_ASSET} beside the asset.",
    )


def add_where(parser: argparse._ActionsContainer, *, has_threads: bool = True) -> None:
    """Where tasks run; has_threads: whether the user may choose how many threads each has."""
    from usdfoliage.jobs.plant.executor_choice import ExecutorChoice

    parser.add_argument(
        "--jobs",
        type=int,
        default=ExecutorChoice.jobs,
        metavar="N",
        help="This many processes of this machine work at the same time, 1 or more; the default is %(default)s.",
    )
    parser.add_argument(
        "--scheduler",
        default=ExecutorChoice.scheduler,
        metavar="tcp://HOST:PORT",
        help="The workers of this Dask scheduler run the tasks, instead of this machine.",
    )
    if not has_threads:
        return
    parser.add_argument(
        "--threads",
        type=int,
        default=ExecutorChoice.threads,
        metavar="N",
        help="Each task uses at most this many threads; the result is the same with any number. The default is "
        "%(default)s: all cores, shared among the processes.",
    )


def add_step(parser: argparse._ActionsContainer, *, required: bool) -> None:
    """Which step runs, and which of its chunks."""
    parser.add_argument(
        "--step",
        required=required,
        metavar="STEP",
        help="This step runs. The step list prints all steps with their numbers of chunks."
        if required
        else "Only this step runs, as a render farm does it. The step list prints all steps with their numbers of "
        "chunks.",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--chunk",
        type=read_chunk,
        metavar="K/N",
        help="Only chunk K of N runs, as in 3/10. The default is all chunks.",
    )
    which.add_argument(
        "--chunks",
        type=read_chunks,
        metavar="A-B",
        help="Only the chunks from A to B run, counted from 1, as in 3-5. The default is all chunks.",
    )


def add_openjd(parser: argparse._ActionsContainer) -> None:
    parser.add_argument(
        "--openjd", action="store_true", help="Print progress and errors as lines of Open Job Description."
    )


def add_job(parser: argparse._ActionsContainer) -> None:
    """Where the files of a job go."""
    parser.add_argument(
        "--template",
        metavar="JOB.yaml",
        type=Path,
        help=(
            "The job template is written to this file, and the values of its parameters beside it: as JSON where the "
            "file's name ends in .json, else as YAML."
        ),
    )
    parser.add_argument("--bundle", metavar="FOLDER", type=Path, help="A job bundle is written to this folder.")


def given_flags(options: argparse.Namespace, flags: Sequence[str]) -> list[str]:
    """Those of the flags that the user has given."""
    return [flag for flag in flags if getattr(options, flag[2:].replace("-", "_"))]


def add_machines(parser: argparse._ActionsContainer) -> None:
    """What a job asks of the machines of a farm."""
    from usdfoliage.jobs.plant.farm_job import FarmJob

    parser.add_argument(
        "--executable",
        metavar="NAME",
        default=FarmJob.executable,
        help="The workers start usdfoliage by this name or path; the default is %(default)s.",
    )
    parser.add_argument(
        "--cores",
        metavar="N",
        type=int,
        default=FarmJob.cores,
        help="A machine for heavy steps has at least this many cores, 1 or more; the default is %(default)s.",
    )
    parser.add_argument(
        "--memory-mib",
        metavar="MIB",
        type=int,
        default=FarmJob.memory_mib,
        help="A machine for heavy steps has at least this memory in MiB, 1 or more; the default is %(default)s.",
    )
    parser.add_argument(
        "--no-chunking",
        action="store_true",
        help="Write one task for each chunk, for farms without the extension TASK_CHUNKING.",
    )


def read_chunk(text: str) -> tuple[range, int]:
    """The chunk of K/N."""
    found = re.fullmatch(r"(\d+)/(\d+)", text)
    if not found or not 1 <= int(found[1]) <= int(found[2]):
        raise argparse.ArgumentTypeError(f"{text!r} is not K/N, a chunk and how many there are, as in 3/10")
    return range(int(found[1]), int(found[1]) + 1), int(found[2])


def read_chunks(text: str) -> range:
    """The chunks of A-B, or A."""
    found = re.fullmatch(r"(\d+)(?:-(\d+))?", text)
    first, last = (int(found[1]), int(found[2] or found[1])) if found else (0, 0)
    if not 1 <= first <= last:
        raise argparse.ArgumentTypeError(f"{text!r} is not A-B, the first and the last chunk from 1, as in 3-5")
    return range(first, last + 1)


def add_ending(parser: argparse._ActionsContainer) -> None:
    """What happens at the end, or does not."""
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="Print the tasks, how many of them are done already, and how long the others take. No task runs.",
    )
    add_publishing(parser)


def add_publishing(parser: argparse._ActionsContainer) -> None:
    """What may be put in its place, and what may be lost there."""
    parser.add_argument(
        "--keep-invalid",
        action="store_true",
        help="Write the asset even if validation finds errors in it. The exit code is still 3.",
    )
    add_reproducible(parser)
    add_replacing(parser)


def read_settings(options: argparse.Namespace) -> "BuildSettings":
    """The settings of a command line: the defaults, then --plan, then the options; FoliageError for bad ones."""
    from dataclasses import replace

    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.settings import BuildSettings, with_seed
    from usdfoliage.jobs.work.settings_file import read_settings_file

    settings = BuildSettings()
    if options.plan is not None:
        settings = read_settings_file(options.plan, settings)
    for name, option, given in (
        ("species", "--species", options.species),
        ("hold_back", "--hold-back", options.hold_back),
        ("sway_frames", "--sway", options.sway),
        ("growth_frames", "--growth", options.growth),
    ):
        if given is None:
            continue
        try:
            settings = replace(settings, plant=replace(settings.plant, **{name: given}))
        except ValueError as error:
            raise FoliageError(str(error).replace(name, option)) from error
    try:
        return with_seed(settings, settings.seed if options.seed is None else options.seed)
    except ValueError as error:
        raise FoliageError(f"--{error}") from error


def read_where(options: argparse.Namespace) -> "ExecutorChoice":
    """Where tasks run, by the options of a command; FoliageError for values that cannot be."""
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.executor_choice import ExecutorChoice

    try:
        return ExecutorChoice(
            jobs=options.jobs,
            scheduler=options.scheduler,
            threads=getattr(options, "threads", ExecutorChoice.threads),
        )
    except ValueError as error:
        raise FoliageError(f"--{error}") from error


def read_request(
    options: argparse.Namespace, capture: Path, output: Path, name: str | None, only: tuple[str, ...] = ()
) -> "BuildRequest":
    """The plant that a command line asks for; FoliageError for values that cannot be."""
    from usdfoliage.asset.plant import asset_name
    from usdfoliage.asset.validation.studio_profile import read_profile
    from usdfoliage.jobs.plant.call import BuildRequest

    if options.profile is not None:
        read_profile(options.profile)  # its errors are reported now, not when all else is done
    return BuildRequest(
        capture=capture.absolute(),
        output=output.absolute(),
        name=asset_name(name or output.absolute().name),
        settings=read_settings(options),
        work=find_work_folder(options.work, output),
        only=only,
        profile=options.profile.absolute() if options.profile else None,
        force=getattr(options, "force", False),
        keep_old=getattr(options, "keep_old", False),
        keep_invalid=getattr(options, "keep_invalid", False),
        reproducible=getattr(options, "reproducible", False),
    )
