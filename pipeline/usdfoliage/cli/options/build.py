"""Options that build, batch, submit and task share."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.jobs.plant.work_folder import WORK_VARIABLE, find_work_folder

if TYPE_CHECKING:
    from usdfoliage.jobs.plant.call import BuildRequest
    from usdfoliage.jobs.plant.run import ExecutorChoice
    from usdfoliage.jobs.plant.settings import BuildSettings


def add_plan(parser: argparse.ArgumentParser) -> None:
    """What decides the plant."""
    parser.add_argument(
        "--plan",
        metavar="FILE",
        type=Path,
        help="TOML with the settings of every stage, as --print-plan shows them; what it leaves out stays as it is",
    )
    parser.add_argument("--species", help="written into the asset; a known one gives allometry and leaves")
    parser.add_argument("--seed", type=int, help="of every random choice (0)")
    parser.add_argument(
        "--work",
        metavar="FOLDER",
        type=Path,
        help="where results of tasks are kept by their hashes; may be shared by many plants, and deleted whenever no "
        f"run uses it (${WORK_VARIABLE}, else .usdfoliage beside the asset)",
    )
    parser.add_argument(
        "--profile", metavar="FILE", type=Path, help="the studio's rules for validation, TOML (those shipped)"
    )


def add_where(parser: argparse.ArgumentParser) -> None:
    """Where tasks run."""
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes of this machine that work at once (%(default)s)"
    )
    parser.add_argument(
        "--scheduler", default="", metavar="tcp://HOST:PORT", help="a Dask scheduler whose workers do the tasks instead"
    )
    parser.add_argument(
        "--threads", type=int, default=0, metavar="N", help="of each task; the result is the same (all cores, shared)"
    )


def add_ending(parser: argparse.ArgumentParser) -> None:
    """What happens at the end, or does not."""
    parser.add_argument(
        "--dry-run", action="store_true", help="print the tasks, what is done already, how long the rest takes"
    )
    add_publishing(parser)


def add_publishing(parser: argparse.ArgumentParser) -> None:
    """What may be put in its place, and what may be lost there."""
    parser.add_argument(
        "--keep-invalid",
        action="store_true",
        help="put an asset in its place though validation finds errors in it; the exit code is 3 nevertheless",
    )
    parser.add_argument("--force", action="store_true", help="replace a folder that is not an asset of ours")


def read_settings(options: argparse.Namespace) -> "BuildSettings":
    """The settings of a command line: the defaults, then --plan, then the options; FoliageError for bad ones."""
    from dataclasses import replace

    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.settings import BuildSettings, with_seed
    from usdfoliage.jobs.work.settings_file import read_settings_file

    settings = BuildSettings()
    if options.plan is not None:
        settings = read_settings_file(options.plan, settings)
    try:
        if options.species is not None:
            settings = replace(settings, plant=replace(settings.plant, species=options.species))
        return with_seed(settings, settings.seed if options.seed is None else options.seed)
    except ValueError as error:
        raise FoliageError(f"--{error}") from error


def read_where(options: argparse.Namespace) -> "ExecutorChoice":
    """Where tasks run, by the options of a command; FoliageError for values that cannot be."""
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.run import ExecutorChoice

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
        keep_invalid=getattr(options, "keep_invalid", False),
    )
