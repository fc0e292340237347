"""Options that commands share which read a point cloud."""

import argparse


def add_cloud(parser: argparse._ActionsContainer) -> None:
    """What the user knows of a cloud."""
    from usdfoliage.jobs.work.settings_file import AUTO

    parser.add_argument(
        "--roots",
        default=AUTO,
        metavar="auto|K|X,Y,Z",
        help="Stems leave the ground here: auto finds the places, a number takes so many of the densest ones, and "
        "X,Y,Z are coordinates of the cloud, with ; between places. Write --roots=-1,0,2 if the first number is "
        "negative. The first root is the origin of the asset. The default is %(default)s.",
    )
    add_orientation(parser)


def add_orientation(parser: argparse._ActionsContainer) -> None:
    """Which way is up in a cloud, and its unit."""
    from usdfoliage.capture.cloud_files.units import UNITS
    from usdfoliage.jobs.work.settings_file import AUTO

    parser.add_argument(
        "--up",
        default=AUTO,
        metavar="AXIS",
        help="This axis of the cloud is up: X, Y or Z, or a negative one as in --up=-Z. auto decides by the cloud. The "
        "default is %(default)s.",
    )
    parser.add_argument(
        "--unit",
        default=AUTO,
        metavar="UNIT",
        help=f"The cloud has this unit: {', '.join(UNITS)}. auto takes the unit that the file states. The default is "
        "%(default)s.",
    )


def add_cloud_leaves(parser: argparse._ActionsContainer) -> None:
    """Whether the cloud has leaves."""
    from usdfoliage.branch.tracing.settings import BranchSettings

    parser.add_argument(
        "--cloud-leaves",
        default=BranchSettings.leaves,
        choices=("auto", "on", "off"),
        help="on: the cloud has leaves, which tracing leaves out; off: it has none; auto decides by the cloud. The "
        "default is %(default)s.",
    )
