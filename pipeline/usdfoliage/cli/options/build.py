"""Options that build, batch, submit and task share."""

import argparse
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


def add_where(parser: argparse._ActionsContainer) -> None:
    """Where tasks run."""
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
    parser.add_argument(
        "--threads",
        type=int,
        default=ExecutorChoice.threads,
        metavar="N",
        help="Each task uses at most this many threads; the result is the same with any number. The default is "
        "%(default)s: all cores, shared among the processes.",
    )


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
        return ExecutorChoice(jobs=options.jobs, scheduler=options.scheduler, threads=options.threads)
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
