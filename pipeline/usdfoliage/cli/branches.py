"""Trace the branches of a tree or bush through its cloud, and make an asset of them.

CLOUD is a file (PLY, LAS, LAZ or text with x y z a line) or the folder of a capture. The asset holds the skeleton with
radii, where each branch springs from and of which order it is, and one closed surface over all branches.
"""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("cloud", metavar="CLOUD", type=Path, help="a point cloud, or the folder of a capture")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, required=True, help="the asset's folder")
    parser.add_argument("--name", help="name of the asset (OUT's basename)")
    parser.add_argument(
        "--roots",
        default="auto",
        metavar="auto|K|X,Y,Z",
        help="where stems come out of the ground: found, the K densest places, or points in the cloud's coordinates, "
        "with ; between them (%(default)s)",
    )
    parser.add_argument(
        "--internode", metavar="METRES", type=float, help="length of an internode (0.005 of the plant's height)"
    )
    parser.add_argument(
        "--cloud-leaves",
        default="auto",
        choices=("auto", "on", "off"),
        help="whether the cloud has leaves, which are then left out (what the cloud shows)",
    )
    parser.add_argument(
        "--up", default="auto", metavar="AXIS", help="of the cloud: X, Y, Z, -X, -Y, -Z (what the cloud shows)"
    )
    parser.add_argument("--unit", default="auto", help="of the cloud: m, cm, mm or ft (what the file says)")
    parser.add_argument(
        "--most-points", metavar="N", type=int, default=400_000, help="that branches are traced through (%(default)s)"
    )
    parser.add_argument("--species", default="", help="written into the asset")
    parser.add_argument("--seed", type=int, default=0, help="of every random choice (%(default)s)")
    parser.add_argument("--no-preview", action="store_true", help="leave the pictures of the asset out of the report")
    parser.add_argument("--force", action="store_true", help="replace OUT though it is not an asset of ours")
    parser.add_argument("--dry-run", action="store_true", help="check the input, say what would be done, write nothing")


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.jobs.branches import BranchesRequest, make_branches_asset, plan_branches_asset

    handle_interrupts()
    request = BranchesRequest.from_options(options)
    if options.dry_run:
        print(plan_branches_asset(request))
        return 0
    with StepBar() as bar:
        made = make_branches_asset(request, bar.show)
    for note in made.notes:
        print(f"note: {note}")
    for row in made.measures:
        print(f"{row.name}: {row.value}")
    print("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in made.seconds.items()))
    print(f"asset: {made.asset}")
    print(f"report: {made.report}")
    return 0
