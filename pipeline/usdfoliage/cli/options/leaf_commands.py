"""Options that commands share, with one help for all of them."""

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from usdfoliage.cli.json_output import add_json
from usdfoliage.errors import FoliageError

T = TypeVar("T")

_NEGATIVE_NUMBER = re.compile(r"-\.?\d")


def add_representation(parser: argparse._ActionsContainer, default: str | None = None) -> None:
    """Which representations are written.

    Args:
        parser: Where the option goes.
        default: Which ones are written without the option; None: as many as the number of leaves allows.
    """
    from usdfoliage.asset.leaf_representations import MAX_LEAVES_OF_ALL
    from usdfoliage.asset.variants import REPRESENTATIONS

    by_number = f"all up to {MAX_LEAVES_OF_ALL} leaves, and bezier alone beyond"
    parser.add_argument(
        "--representation",
        metavar="NAME",
        nargs="+",
        help=f"The leaves are written in these forms: {', '.join(REPRESENTATIONS)}. bezier is always written. "
        f"The default is {default or by_number}.",
    )


def add_resolution(parser: argparse._ActionsContainer) -> None:
    from usdfoliage.asset.leaf_representations import MAX_CELLS
    from usdfoliage.leaf.shape.mesh import LeafMeshSettings

    parser.add_argument(
        "--resolution",
        metavar=("ACROSS", "ALONG"),
        type=int,
        nargs=2,
        help="In the representation mesh each leaf has this many cells across, an even number of 4 or more, and along, "
        f"2 or more; {MAX_CELLS} at most. The default is {LeafMeshSettings.across} {LeafMeshSettings.along}.",
    )


def add_hold_back(parser: argparse._ActionsContainer) -> None:
    """How many photographs measure the asset in place of making it."""
    from usdfoliage.cli.options.setting_help import describe_setting
    from usdfoliage.jobs.plant.plant_settings import PlantSettings

    settings = PlantSettings()
    parser.add_argument(
        "--hold-back",
        metavar="N",
        type=int,
        default=settings.hold_back,
        help=describe_setting(settings, "hold_back"),
    )


def add_output(parser: argparse._ActionsContainer, metavar: str = "OUT") -> None:
    """The folder of an asset, and the asset's name."""
    parser.add_argument(
        "-o", "--output", metavar=metavar, type=Path, required=True, help="The asset is written to this folder."
    )
    add_name(parser, metavar)


def add_name(parser: argparse._ActionsContainer, metavar: str = "OUT") -> None:
    parser.add_argument("--name", help=f"The asset has this name. The default is the name of the folder {metavar}.")


def add_writing(parser: argparse._ActionsContainer, *, of_asset: bool = True) -> None:
    """What every command has that writes; of_asset: the folder of an asset."""
    if of_asset:
        add_replacing(parser)
    else:
        parser.add_argument(
            "--force", action="store_true", help="Replace the output even if it was not written by usdfoliage."
        )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="Check the input and print what the command would do. Nothing is written.",
    )


def add_replacing(parser: argparse._ActionsContainer) -> None:
    """What of an earlier asset may be replaced, and what becomes of it."""
    parser.add_argument(
        "--force",
        action="store_true",
        help="Replace an asset of another name or origin too, or one whose record is lost. Files that are not the "
        "asset's always stay.",
    )
    parser.add_argument(
        "--keep-old",
        action="store_true",
        help="Keep the asset that is replaced, in a folder beside the new one. The name of the folder is printed.",
    )


def add_run(parser: argparse._ActionsContainer, seed: int, powers: int = 63, *, is_setting: bool = False) -> None:
    """What every command has that makes an asset with a report; the parameters are those of add_seed."""
    add_seed(parser, seed, powers, is_setting=is_setting)
    add_no_preview(parser)
    add_reproducible(parser)
    add_writing(parser)
    add_json(parser)


def add_seed(parser: argparse._ActionsContainer, default: int, powers: int = 63, *, is_setting: bool = False) -> None:
    """The seed of all random choices.

    Args:
        parser: Where the option goes.
        default: That of the settings.
        powers: It is below 2 to this power.
        is_setting: Whether a settings file may have another one, which stays where the option is not given.
    """
    parser.add_argument(
        "--seed",
        metavar="N",
        type=int,
        default=None if is_setting else default,
        help=f"Every random choice starts from this number, from 0 to below 2^{powers}; the default is {default}.",
    )


def add_threads(parser: argparse._ActionsContainer, default: int, *, is_setting: bool = False) -> None:
    """How many threads work; the parameters are those of add_seed."""
    parser.add_argument(
        "--threads",
        metavar="N",
        type=int,
        default=None if is_setting else default,
        help="At most this many threads work, 0 or more; the result is the same with any number. "
        f"The default is {default}, which is one per core.",
    )


def add_jitter_map(parser: argparse._ActionsContainer) -> None:
    parser.add_argument(
        "--jitter-map",
        metavar="FILE",
        type=Path,
        help="The first row of this image is one cycle of the jitter's wave. The default is a procedural wave.",
    )


def add_report_views(parser: argparse._ActionsContainer, default: int) -> None:
    parser.add_argument(
        "--report-views",
        metavar="N",
        type=int,
        default=default,
        help="The report shows this many photographs, 0 or more; the default is %(default)s.",
    )


def add_no_preview(parser: argparse._ActionsContainer) -> None:
    parser.add_argument("--no-preview", action="store_true", help="Leave the pictures by Storm out of the report.")


def add_reproducible(parser: argparse._ActionsContainer) -> None:
    """Whether equal runs give the same bytes in all files."""
    parser.add_argument(
        "--reproducible",
        action="store_true",
        help="Leave out report/timings.js, which has how long the run took. Equal runs then give the same bytes.",
    )


def add_views(parser: argparse._ActionsContainer) -> None:
    parser.add_argument(
        "--views",
        metavar="SPEC",
        help="Only these photographs are used: names, numbers from 0 in the order of the names, or start:stop:step, "
        "with commas between them. The default is all of them.",
    )


def add_settings_file(parser: argparse._ActionsContainer) -> None:
    """A file with settings, and the settings that hold."""
    parser.add_argument(
        "--settings",
        metavar="FILE",
        type=Path,
        help="This TOML file has any of the settings, as --print-settings prints them. Options override it.",
    )
    parser.add_argument(
        "--print-settings",
        action="store_true",
        help="Print every setting as --settings and the options set it, and stop.",
    )


def accept_negative_numbers(parser: argparse.ArgumentParser) -> None:
    """Let option values be any negative number: argparse takes -1e-3 for an option before Python 3.14."""
    parser._negative_number_matcher = _NEGATIVE_NUMBER


def name_option(read: Callable[[Any], T], value: Any) -> T:
    """What a job reads of an option's value; its error begins with the setting's name, which is that of the option.

    Raises:
        FoliageError: The value cannot be.
    """
    try:
        return read(value)
    except FoliageError as error:
        raise FoliageError(f"--{error.text}", error.remedy) from error


def read_resolution(options: argparse.Namespace) -> tuple[int, int] | None:
    """The cells of --resolution, if it is given; FoliageError for a mesh that cannot be."""
    from usdfoliage.asset.leaf_representations import read_settings

    if not options.resolution:
        return None
    across, along = options.resolution
    name_option(lambda cells: read_settings(("bezier",), cells), (across, along))
    return across, along
