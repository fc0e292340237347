"""Make a new asset whose leaves are as ASSET shows them: its edits become part of the 21 parameters of each leaf.

Every representation of the new asset then holds the same leaves. Jitter is no parameter: it stays an edit, which the
mesh carries exactly, subdiv approximately, and of which nurbs has the slow part. DIR may be the folder of ASSET, which
is replaced.
"""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.leaf_commands import add_representation, add_resolution, add_writing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("asset", metavar="ASSET", type=Path, help="asset folder, its .usda, or a look")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="the new asset's folder")
    parser.add_argument("--name", help="name of the new asset (ASSET's)")
    add_representation(parser, "those that ASSET has")
    add_resolution(parser)
    parser.add_argument(
        "--from",
        dest="source",
        choices=("bezier", "nurbs"),
        default="bezier",
        help="where the leaves come from: nurbs fits them to patches that a modeller changed (%(default)s)",
    )
    add_writing(parser)
    add_json(parser)


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
