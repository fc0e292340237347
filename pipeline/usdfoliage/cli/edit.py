"""Write a look: a layer that edits all leaves of an asset.

The asset itself does not change. The look acts in every scene that sublayers it, wherever the scene refers to the
asset; mute it, and the original is back. ASSET may itself be a look. Each option then acts on the edited leaves: with
--width 2 over a look of --width 1.5, leaves become three times as wide. --jitter replaces an earlier jitter.

    usdfoliage edit assets/spray --width 1.3 --bend 0.3 -o looks/drooping.usda

A leaf of several lobes, as usdfoliage lobed makes it, has --bend, --turn and --twist, in degrees:

    usdfoliage edit assets/oak_leaf --bend 40 --branch 0 -o looks/bent.usda

Lengths are in leaf lengths: the base is at (0, 0, 0), the apex at (0, 1, 0), width along x, height along z. No edit
moves base or apex.
"""

import argparse
import shlex
from dataclasses import asdict
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.leaf_commands import accept_negative_numbers, add_jitter_map, add_writing
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    accept_negative_numbers(parser)
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "asset", metavar="ASSET", type=Path, help="The input is the folder of an asset, its .usda file, or a look."
    )
    files.add_argument(
        "-o",
        "--output",
        metavar="LOOK",
        type=Path,
        required=True,
        help="The look is written to this file, whose name ends in .usda.",
    )
    files.add_argument(
        "--prim",
        metavar="PATH",
        help="Only the asset at this prim of a scene is edited. The default is every placement of the asset.",
    )
    files.add_argument(
        "--look",
        metavar="FILE",
        type=Path,
        help="The edits in this layer are taken, whoever wrote it, and the extents that they need are added. Other "
        "edits act on top of them. Other opinions of the layer are not taken.",
    )
    _add_edits(parser.add_argument_group("edits, in leaf lengths"))
    _add_rotations(parser.add_argument_group("edits of a leaf of several lobes"))
    run_options = parser.add_argument_group("this run")
    add_writing(run_options, of_asset=False)
    add_json(run_options)


def _add_edits(edits: argparse._ActionsContainer) -> None:
    edits.add_argument("--width", metavar="F", type=float, help="Leaves become this many times as wide, 0 or more.")
    edits.add_argument(
        "--asymmetry",
        metavar=("X", "Y"),
        type=float,
        nargs=2,
        help="Both control points of the axis move by this much in the plane of the leaf.",
    )
    edits.add_argument(
        "--axis1",
        metavar=("X", "Y", "Z"),
        type=float,
        nargs=3,
        help="The control point of the axis nearer to the base moves by this much.",
    )
    edits.add_argument(
        "--axis2",
        metavar=("X", "Y", "Z"),
        type=float,
        nargs=3,
        help="The control point of the axis nearer to the apex moves by this much.",
    )
    edits.add_argument(
        "--bend",
        metavar=("Z1", "Z2"),
        type=float,
        nargs="+",
        help="Both control points of the axis rise by Z1, or the second one by Z2 if that is given. A positive number "
        "lets the tip droop. Of a leaf of several lobes this is one number: every branch bends down by this many "
        "degrees from its begin to its tip.",
    )
    edits.add_argument(
        "--silhouette",
        metavar=("POINT", "V X Z"),
        type=float,
        nargs="+",
        action="append",
        help="Point 1, 2 or 3 of the silhouette, counted from the base, moves by V along the axis, by X away from it "
        "and by Z up. Z may be left out. Give this option once for each point.",
    )
    edits.add_argument(
        "--curl",
        metavar=("INNER", "OUTER", "SILHOUETTE"),
        type=float,
        nargs=3,
        help="The inner curve, the outer curve and the silhouette rise by these three numbers, on both halves.",
    )
    edits.add_argument(
        "--jitter",
        metavar=("A", "F"),
        type=float,
        nargs=2,
        help="The silhouette becomes a wave of amplitude A with F cycles from base to apex. A = 0 removes it.",
    )
    add_jitter_map(edits)


def _add_rotations(edits: argparse._ActionsContainer) -> None:
    edits.add_argument(
        "--turn",
        metavar="DEGREES",
        type=float,
        help="Every branch turns to the left by this many degrees from its begin to its tip. The default is 0.",
    )
    edits.add_argument(
        "--twist",
        metavar="DEGREES",
        type=float,
        help="Every branch twists about itself by this many degrees from its begin to its tip. The default is 0.",
    )
    edits.add_argument(
        "--branch",
        metavar="N",
        type=int,
        help="Only this branch is bent, turned or twisted: 0 is the axis. What grows on it moves along. The default "
        "is every branch.",
    )


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.asset.access import look_access

    return look_access(options.output, options.asset, options.jitter_map, options.look)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.asset.looks.lobed import find_lobed_leaf
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.edit import read_edit_request, read_lobed_request
    from usdfoliage.cli.remarks import print_remarks
    from usdfoliage.jobs.edits.edit import EditRequest, plan_look, write_look
    from usdfoliage.jobs.edits.lobed import LobedEditRequest, plan_lobed_look, write_lobed_edit

    handle_interrupts()
    lobed = find_lobed_leaf(options.asset)
    request: EditRequest | LobedEditRequest
    if lobed is not None:
        request = read_lobed_request(options, lobed)
        planned = plan_lobed_look(request) if options.dry_run else write_lobed_edit(request)
    else:
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
    if planned.jitter_map:
        print(f"jitter map: {planned.jitter_map}")
    if options.dry_run:
        print(f"would {'replace' if request.output.exists() else 'write'}: {request.output}")
        return 0
    print(f"look: {request.output}")
    print("to use it, sublayer it into a scene that refers to the asset, or draw it:")
    print(f"    usdfoliage preview {shlex.quote(str(request.output))} -o {shlex.quote(f'{request.output.stem}.png')}")
    return 0
