"""Write a new asset that has the edits of a look in its leaves.

The edits of ASSET become part of the 21 numbers of each leaf, so that every representation of the new asset has the
same leaves. Jitter is none of these numbers and stays an edit: mesh has it exactly, subdiv approximately, and nurbs has
the slow part of it. DIR may be the folder of ASSET, which is then replaced.

    usdfoliage bake looks/drooping.usda -o assets/drooping
"""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.leaf_commands import add_representation, add_resolution, add_writing
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "asset", metavar="ASSET", type=Path, help="The input is the folder of an asset, its .usda file, or a look."
    )
    files.add_argument(
        "-o", "--output", metavar="DIR", type=Path, required=True, help="The new asset is written to this folder."
    )
    files.add_argument(
        "--name",
        help="The new asset has this name. The default is the name of the folder DIR, or that of ASSET if DIR is its "
        "folder.",
    )
    leaves = parser.add_argument_group("leaves")
    add_representation(leaves, "those that ASSET has")
    add_resolution(leaves)
    leaves.add_argument(
        "--from",
        dest="source",
        choices=("bezier", "nurbs"),
        default="bezier",
        help="The leaves come from this representation. nurbs fits leaves to patches that were changed in another "
        "program. The default is %(default)s.",
    )
    run_options = parser.add_argument_group("this run")
    add_writing(run_options)
    add_json(run_options)


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.asset.access import bake_access

    return bake_access(options.asset, options.output)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.bake import read_bake_request
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import print_remarks, render_for
    from usdfoliage.jobs.edits.bake import bake_asset, plan_bake

    handle_interrupts()
    request = read_bake_request(options)
    if options.dry_run:
        print(plan_bake(request, render_for("bake")))
        return 0
    with StepBar() as bar:
        made = bake_asset(request, bar.show)
    if options.json:
        print(format_made(asset=made.asset, report=None, facts=(), remarks=made.remarks))
        return 0
    print_remarks(made.remarks, "bake")
    for line in made.lines:
        print(line)
    print(f"asset: {made.asset}")
    return 0
