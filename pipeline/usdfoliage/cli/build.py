"""Build one whole plant of a capture: leaves, branches and crown in one asset, with a report, validated.

CAPTURE is a folder of photographs, a capture (images/ with cameras/, depth/, masks/, capture.toml as far as there are
any), or a point cloud. Every task's result is kept by the hash of what it is made of, so that a run that was stopped
goes on where it was, another run of the same does nothing, and another setting does again only what it touches.

The exit code is 0 when the asset stands, 2 for input that cannot be used, 3 when validation finds errors: then the
asset is not put in its place.
"""

import argparse
import logging
import sys
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.build import add_ending, add_plan, add_where

logger = logging.getLogger(__name__)

STAGES = (
    *("poses", "matching", "depth", "cloud", "isolation", "branches", "leaves", "crown"),
    *("asset", "turntable", "comparisons", "variants", "report"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("capture", metavar="CAPTURE", type=Path, nargs="?", help="photographs, a capture, or a cloud")
    parser.add_argument("-o", "--output", metavar="ASSET", type=Path, help="the asset's folder")
    parser.add_argument("--name", help="name of the asset (ASSET's basename)")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=STAGES,
        metavar="STAGE",
        default=(),
        help=f"stop after these stages, with what they need; nothing is put into ASSET ({', '.join(STAGES)})",
    )
    parser.add_argument(
        "--print-plan", action="store_true", help="print every setting of every stage with what it means, as TOML"
    )
    add_plan(parser)
    add_where(parser)
    add_ending(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.options.build import read_request, read_settings, read_where
    from usdfoliage.cli.plant_progress import PlantBar
    from usdfoliage.cli.plant_results import EXIT_CODES, format_plant, print_plant
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.plant.plan_text import describe_plan
    from usdfoliage.jobs.plant.run import build_plants
    from usdfoliage.jobs.work.settings_file import format_settings

    handle_interrupts()
    if options.print_plan:
        print(format_settings(read_settings(options), documented=True), end="")
        return 0
    if options.capture is None or options.output is None:
        raise FoliageError("name a capture and the asset's folder, as in: usdfoliage build CAPTURE -o ASSET")
    request = read_request(options, options.capture, options.output, options.name, tuple(options.only))
    where = read_where(options)
    if options.dry_run:
        print(describe_plan(request, where))
        return 0
    try:
        with PlantBar() as bar:
            ((_, made),) = build_plants([request], where, bar.show)
    except KeyboardInterrupt:
        print("error: interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    if options.json:
        print(format_plant(made))
    else:
        print_plant(made, debug=options.debug)
    return EXIT_CODES[made.verdict]
