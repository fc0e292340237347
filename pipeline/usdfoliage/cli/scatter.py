"""Make a random spray of leaves, for tests and demonstrations.

Every leaf is a variation of one natural leaf, on twigs that grow from the origin. The same options and the same seed
give the same bytes.

    usdfoliage scatter -n 400 -o assets/spray
"""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.access import given
from usdfoliage.cli.options.leaf_commands import (
    add_jitter_map,
    add_output,
    add_representation,
    add_resolution,
    add_seed,
    add_writing,
)
from usdfoliage.cli.options.setting_help import state_default
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.asset.parts.leaf_part import LeafAppearance
    from usdfoliage.jobs.edits.scatter import LENGTHS_M, MAX_LEAVES, MAX_VARIATION
    from usdfoliage.leaf.shape.spray import SpraySettings

    spray = SpraySettings()
    files = parser.add_argument_group("output")
    add_output(files)
    add_representation(files)
    add_resolution(files)
    leaves = parser.add_argument_group("leaves")
    leaves.add_argument(
        "-n",
        "--count",
        metavar="N",
        type=int,
        required=True,
        help=f"The spray has this many leaves, from 0 to {MAX_LEAVES}.",
    )
    leaves.add_argument(
        "--length",
        metavar="METRES",
        type=float,
        default=spray.length_m,
        help=f"A leaf has this mean length in metres, from {LENGTHS_M[0]:g} to {LENGTHS_M[1]:g}; the default is "
        "%(default)g.",
    )
    leaves.add_argument(
        "--variation",
        metavar="SHARE",
        type=float,
        default=spray.variation.amount,
        help="Leaves differ by this much: 0 makes all leaves equal, 1 lets them differ as on a plant, and the maximum "
        f"is {MAX_VARIATION:g}. The default is %(default)g.",
    )
    leaves.add_argument(
        "--color",
        metavar=("R", "G", "B"),
        type=float,
        nargs=3,
        help="A leaf has this linear colour, from 0 to 1 each; the default is "
        f"{state_default(LeafAppearance().color)}.",
    )
    leaves.add_argument(
        "--texture", metavar="FILE", type=Path, help="This picture shows a leaf; its alpha cuts the leaf out."
    )
    add_jitter_map(leaves)
    add_seed(leaves, 0)
    run_options = parser.add_argument_group("this run")
    add_writing(run_options)
    add_json(run_options)


def declare(options: argparse.Namespace) -> Access:
    return Access(reads=given(options.texture, options.jitter_map), replaces=(options.output,))


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
