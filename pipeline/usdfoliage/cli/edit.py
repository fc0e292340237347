"""Write a look: a layer that edits all leaves of an asset. Nothing is baked and the asset is not touched.

The look changes the asset wherever a scene refers to it, once it is sublayered into that scene; muted, it is as if it
were not there. ASSET may itself be a look: every option acts on what ASSET shows, so with a look of --width 1.5 and
--width 2 the leaves become three times as wide. --jitter takes the place of an earlier one.

Lengths are in leaf lengths: base at (0, 0, 0), apex at (0, 1, 0), width along x, height along z. Both stay where they
are under every edit.
"""

import argparse
import shlex
from dataclasses import asdict
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.leaf_commands import accept_negative_numbers, add_writing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    accept_negative_numbers(parser)
    parser.add_argument("asset", metavar="ASSET", type=Path, help="asset folder, its .usda, or a look")
    parser.add_argument("-o", "--output", metavar="LOOK", type=Path, required=True, help="the layer to write, a .usda")
    edits = parser.add_argument_group("edits")
    edits.add_argument("--width", metavar="F", type=float, help="factor on the width")
    edits.add_argument(
        "--asymmetry", metavar=("X", "Y"), type=float, nargs=2, help="move both control points of the axis in its plane"
    )
    edits.add_argument("--axis1", metavar=("X", "Y", "Z"), type=float, nargs=3, help="move the one nearer to the base")
    edits.add_argument("--axis2", metavar=("X", "Y", "Z"), type=float, nargs=3, help="move the one nearer to the apex")
    edits.add_argument(
        "--bend",
        metavar=("Z1", "Z2"),
        type=float,
        nargs="+",
        help="raise both control points of the axis by Z1, or the second by Z2",
    )
    edits.add_argument(
        "--silhouette",
        metavar=("POINT", "V X Z"),
        type=float,
        nargs="+",
        action="append",
        help="move silhouette point 1, 2 or 3 by V along the axis, X away from it, Z up, if given; once for each point",
    )
    edits.add_argument(
        "--curl",
        metavar=("INNER", "OUTER", "SILHOUETTE"),
        type=float,
        nargs=3,
        help="raise the inner curve, the outer curve and the silhouette, on both halves",
    )
    edits.add_argument(
        "--jitter",
        metavar=("A", "F"),
        type=float,
        nargs=2,
        help="wave the silhouette: amplitude, cycles from base to apex",
    )
    edits.add_argument(
        "--jitter-map", metavar="FILE", type=Path, help="image whose first row is one cycle of the wave (procedural)"
    )
    parser.add_argument(
        "--prim", metavar="PATH", help="edit only the asset that stands at this prim of the scene (all of them)"
    )
    add_writing(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.edit import read_edit_request
    from usdfoliage.cli.remarks import print_remarks
    from usdfoliage.jobs.edits.edit import plan_look, write_look

    handle_interrupts()
    request = read_edit_request(options)
    planned = plan_look(request) if options.dry_run else write_look(request)
    if options.json:
        asset = None if options.dry_run else request.output
        changes = [asdict(change) for change in planned.changes]
        print(format_made(asset=asset, report=None, facts=(), remarks=planned.remarks, changes=changes))
        return 0
    print_remarks(planned.remarks, "edit")
    for change in planned.changes:
        print(change)
    if request.jitter_map:
        print(f"jitter map: {request.jitter_map}")
    if options.dry_run:
        print(f"would {'replace' if request.output.exists() else 'write'}: {request.output}")
        return 0
    print(f"look: {request.output}")
    print("to use it, sublayer it into a scene that refers to the asset, or draw it:")
    print(f"    usdfoliage preview {shlex.quote(str(request.output))} -o {shlex.quote(f'{request.output.stem}.png')}")
    return 0
