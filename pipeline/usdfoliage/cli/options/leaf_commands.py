"""Options that the leaf commands share."""

import argparse
import re
from collections.abc import Callable
from typing import Any, TypeVar

from usdfoliage.errors import FoliageError

T = TypeVar("T")

REPRESENTATIONS = ("bezier", "nurbs", "subdiv", "mesh")
_NEGATIVE_NUMBER = re.compile(r"-\.?\d")


def add_representation(parser: argparse.ArgumentParser, default: str) -> None:
    parser.add_argument(
        "--representation",
        metavar="NAME",
        nargs="+",
        help=f"which to write: {', '.join(REPRESENTATIONS)} ({default}); bezier is always there",
    )


def add_resolution(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--resolution",
        metavar=("ACROSS", "ALONG"),
        type=int,
        nargs=2,
        help="cells of a leaf of the mesh, across it, an even number, and along it (8 16)",
    )


def add_writing(parser: argparse.ArgumentParser) -> None:
    """What every command has that writes."""
    parser.add_argument("--force", action="store_true", help="replace what is there though it is not ours")
    parser.add_argument(
        "--dry-run", action="store_true", help="check the input, print what would be done, write nothing"
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
    from usdfoliage.jobs.edits.settings import read_settings

    if not options.resolution:
        return None
    across, along = options.resolution
    name_option(lambda cells: read_settings(("bezier",), cells), (across, along))
    return across, along
