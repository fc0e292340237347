"""Write an asset for other applications: a plain USD file, a usdz, an Unreal assembly.

The edits of ASSET, and those of a look, are in the export. It needs no plug-in and no shader of usdfoliage, names no
file outside itself, and appears only when it keeps the rules of its profile.

    usdfoliage export assets/shrub --profile usdz -o shrub.usdz
"""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.leaf_commands import add_resolution, add_writing
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.jobs.export.request import LEAF_FORMS, LODS, MAX_SHAPES, PROFILES, SIDES, ExportSettings

    settings = ExportSettings()
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "asset", metavar="ASSET", type=Path, help="The input is the folder of an asset, its .usda file, or a look."
    )
    files.add_argument(
        "--profile",
        choices=PROFILES,
        required=True,
        help="standalone: one USD file that every renderer draws. usdz: a package for AR. unreal: a Nanite assembly on "
        "joints.",
    )
    files.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        type=Path,
        required=True,
        help="The export is written to this folder; with --profile usdz to this file, whose name ends with .usdz.",
    )
    files.add_argument("--name", help="The export has this name. The default is that of OUT, without a suffix.")
    plant = parser.add_argument_group("plant")
    plant.add_argument(
        "--lod",
        choices=LODS,
        help="This form of the plant is exported. The default is leaves, or crown where the asset has no leaves.",
    )
    plant.add_argument(
        "--leaves",
        choices=LEAF_FORMS,
        default=settings.leaves,
        help="mesh: all leaves are one mesh, each with its own shape. instances: they repeat a few shapes, in a "
        "PointInstancer. unreal always repeats, usdz never. The default is %(default)s.",
    )
    plant.add_argument(
        "--shapes",
        metavar="N",
        type=int,
        default=settings.shapes,
        help=f"Leaves that repeat have at most this many shapes, from 1 to {MAX_SHAPES}; the default is %(default)s.",
    )
    plant.add_argument(
        "--sides",
        type=int,
        choices=SIDES,
        help="Each side of a leaf has its own faces with 2, for applications that draw only the front of a face, such "
        "as three.js. With 1 both sides share a face. The default is 2 with --profile usdz, else 1. Leaves that repeat "
        "have 1.",
    )
    add_resolution(plant)
    run_options = parser.add_argument_group("this run")
    add_writing(run_options)
    add_json(run_options)


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.asset.access import export_access

    return export_access(options.asset, options.output)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.export import read_export_request
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import print_remarks, render_for
    from usdfoliage.jobs.export.run import export_asset, plan_export

    handle_interrupts()
    request = read_export_request(options)
    if options.dry_run:
        print(plan_export(request, render_for("export")))
        return 0
    with StepBar() as bar:
        made = export_asset(request, bar.show)
    if options.json:
        print(
            format_made(asset=made.asset, report=None, facts=made.facts, remarks=made.remarks, profile=request.profile)
        )
        return 0
    print_remarks(made.remarks, "export")
    for fact in made.facts:
        print(f"{fact.name}: {fact.value}")
    print(f"export: {made.asset}")
    return 0
