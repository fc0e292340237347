"""Trace the branches of a tree or bush through its cloud, and make an asset of them.

CLOUD is a file (PLY, LAS, LAZ or text with x y z a line) or the folder of a capture. The asset holds the skeleton with
radii, where each branch springs from and of which order it is, and one closed surface over all branches; with --foliage
leaves on its twigs too, to be edited as those of any asset of leaves.
"""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.leaf_commands import add_representation, add_resolution


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("cloud", metavar="CLOUD", type=Path, help="a point cloud, or the folder of a capture")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, required=True, help="the asset's folder")
    parser.add_argument("--name", help="name of the asset (OUT's basename)")
    parser.add_argument(
        "--roots",
        default="auto",
        metavar="auto|K|X,Y,Z",
        help="where stems come out of the ground: found, the K densest places, or points in the cloud's coordinates, "
        "with ; between them; --roots=-1,0,2 where the first number is negative (%(default)s)",
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
        "--up",
        default="auto",
        metavar="AXIS",
        help="of the cloud: X, Y, Z, or down as in --up=-Z (what the cloud shows)",
    )
    parser.add_argument("--unit", default="auto", help="unit of the cloud: m, cm, mm or ft (what the file states)")
    parser.add_argument(
        "--most-points",
        dest="max_points",
        metavar="N",
        type=int,
        default=400_000,
        help="that branches are traced through (%(default)s)",
    )
    parser.add_argument(
        "--species",
        default="",
        metavar="NAME",
        help="of the library: written into the asset, how thickness follows from length, and how leaves stand; "
        "it adds no leaves by itself (none; leaves are then those of a generic one)",
    )
    parser.add_argument(
        "--species-file", metavar="FILE", type=Path, help="TOML of species that change the library's or add to them"
    )
    parser.add_argument(
        "--foliage",
        choices=("none", "template", "fitted"),
        help="leaves on the twigs: none, of the species' proportions, or those that usdfoliage leaves fitted to a "
        "capture (fitted with --leaves, else none)",
    )
    parser.add_argument(
        "--leaves",
        metavar="ASSET",
        type=Path,
        help="asset of fitted leaves: their shape, colour and length are drawn",
    )
    parser.add_argument(
        "--leaf-length", metavar="METRES", type=float, help="of a leaf (the species', or that of the fitted ones)"
    )
    parser.add_argument(
        "--most-leaves",
        dest="max_leaves",
        metavar="N",
        type=int,
        default=60_000,
        help="more are thinned evenly (%(default)s)",
    )
    parser.add_argument(
        "--bark-color", metavar=("R", "G", "B"), type=float, nargs=3, help="of the branches, linear, 0 to 1 (a brown)"
    )
    add_representation(parser, "of leaves: all four up to 2000 of them, beyond that bezier")
    add_resolution(parser)
    parser.add_argument(
        "--method",
        choices=("trace", "grow"),
        default="trace",
        help="branches follow the points, or grow through them from the roots, as a plant might have (%(default)s)",
    )
    parser.add_argument(
        "--fill-hidden",
        action="store_true",
        help="grow branches inside the crown as well, where its foliage hid them from the cloud",
    )
    parser.add_argument(
        "--variations",
        metavar="N",
        type=int,
        default=0,
        help="further plants, grown through the same cloud with slightly other parameters (%(default)s)",
    )
    parser.add_argument(
        "--rig", action="store_true", help="joints that turn the branches (UsdSkel), in a variant: rig=skel"
    )
    parser.add_argument(
        "--rig-order",
        metavar="N",
        type=int,
        help="of the last branches with a joint; others follow the one that they spring from (2)",
    )
    parser.add_argument("--sway", metavar="FRAMES", type=int, help="a gentle sway of the rig in a loop; implies --rig")
    parser.add_argument(
        "--growth",
        metavar="FRAMES",
        type=int,
        help="the growth of the plant in so many frames, in a variant: growth=growing",
    )
    parser.add_argument("--seed", type=int, default=0, help="of every random choice (%(default)s)")
    parser.add_argument("--no-preview", action="store_true", help="leave the pictures of the asset out of the report")
    parser.add_argument("--force", action="store_true", help="replace OUT though it is not an asset of ours")
    parser.add_argument(
        "--dry-run", action="store_true", help="check the input, print what would be done, write nothing"
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.branches import read_branches_request
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import print_remarks
    from usdfoliage.jobs.branches.run import make_branches_asset, plan_branches_asset

    handle_interrupts()
    request = read_branches_request(options)
    if options.dry_run:
        print(plan_branches_asset(request))
        return 0
    with StepBar() as bar:
        made = make_branches_asset(request, bar.show)
    if options.json:
        variations = [str(each) for each in made.variations]
        print(
            format_made(
                asset=made.asset,
                report=made.report,
                facts=made.measures,
                remarks=made.remarks,
                variations=variations,
            )
        )
        return 0
    print_remarks(made.remarks, "branches")
    for row in made.measures:
        print(f"{row.name}: {row.value}")
    print("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in made.seconds.items()))
    print(f"asset: {made.asset}")
    for variation in made.variations:
        print(f"variation: {variation}")
    print(f"report: {made.report}")
    return 0
