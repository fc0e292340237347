"""Make an asset of a random spray of leaves, for tests and demonstrations.

Every leaf is a variation of one natural leaf, on twigs that grow from the origin. The same options and seed give the
same bytes.
"""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.leaf_commands import add_representation, add_resolution, add_writing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-n", "--count", metavar="N", type=int, required=True, help="how many leaves, 0 or more")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, required=True, help="the asset's folder")
    parser.add_argument("--name", help="name of the asset (OUT's basename)")
    parser.add_argument("--seed", type=int, default=0, help="of every random choice (%(default)s)")
    parser.add_argument("--length", metavar="METRES", type=float, default=0.08, help="of a leaf (%(default)s)")
    parser.add_argument(
        "--variation",
        metavar="SHARE",
        type=float,
        default=1.0,
        help="how much the leaves differ: 0 not at all, 1 as on a plant (%(default)s)",
    )
    add_representation(parser, "all four up to 2000 leaves, beyond that bezier")
    add_resolution(parser)
    parser.add_argument("--texture", metavar="FILE", type=Path, help="picture of a leaf, its alpha cuts it out")
    parser.add_argument(
        "--jitter-map", metavar="FILE", type=Path, help="image whose first row is one cycle of a jittered silhouette"
    )
    parser.add_argument("--color", metavar=("R", "G", "B"), type=float, nargs=3, help="of a leaf, linear, 0 to 1")
    add_writing(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.scatter import read_scatter_request
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import print_remarks, render_for
    from usdfoliage.jobs.edits.scatter import plan_spray, scatter_asset

    handle_interrupts()
    request = read_scatter_request(options)
    if options.dry_run:
        print(plan_spray(request, render_for("scatter")))
        return 0
    with StepBar() as bar:
        made = scatter_asset(request, bar.show)
    if options.json:
        print(format_made(asset=made.asset, report=None, facts=(), remarks=made.remarks))
        return 0
    print_remarks(made.remarks, "scatter")
    print(f"leaves: {made.count:,}")
    print(f"representations: {', '.join(made.representations) or 'none'}")
    print(f"asset: {made.asset}")
    return 0
