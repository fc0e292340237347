"""Build one whole plant from a capture: leaves, branches and crown in one asset.

CAPTURE is a folder of photographs, a video, a capture, a point cloud, or one photograph of a tree. A capture is a
folder with images/, and with cameras/, depth/, masks/ and capture.toml as far as they exist. Of one photograph a tree
is made by the strokes in NAME.strokes.json beside it, as usdfoliage sketch does. The asset has a report and is
validated.

    usdfoliage build photographs/ -o assets/shrub
    usdfoliage build cherry.jpg -o assets/cherry

The result of every task is kept under the hash of its inputs. If a run is stopped, the same command continues it. A
second run with the same input does nothing. A changed setting repeats only the tasks that depend on it.

The exit code is 0 if the asset is written, and 2 if the input cannot be used. It is 3 if validation finds errors; the
asset is then not written.
"""

import argparse
import logging
import sys
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.access import declare_build
from usdfoliage.cli.options.build import add_ending, add_plan, add_where, add_work
from usdfoliage.cli.options.leaf_commands import add_name
from usdfoliage.cli.remarks import render_for
from usdfoliage.files.write_gate import Access

logger = logging.getLogger(__name__)

STAGES = (
    *("poses", "matching", "depth", "cloud", "isolation", "branches", "leaves", "crown", "sketch"),
    *("asset", "withheld", "turntable", "comparisons", "variants", "report"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "capture",
        metavar="CAPTURE",
        type=Path,
        nargs="?",
        help="The input is a folder of photographs, a video, a capture, a point cloud, or one photograph of a tree.",
    )
    files.add_argument("-o", "--output", metavar="ASSET", type=Path, help="The asset is written to this folder.")
    add_name(files, "ASSET")
    add_work(files)
    add_plan(parser.add_argument_group("settings of the plant"))
    run_options = parser.add_argument_group("this run")
    run_options.add_argument(
        "--only",
        nargs="+",
        choices=STAGES,
        metavar="STAGE",
        default=(),
        help="Run only these stages and the stages that they need; ASSET is not written. The stages are "
        f"{', '.join(STAGES)}.",
    )
    add_where(run_options)
    add_ending(run_options)
    output = parser.add_argument_group("printed output")
    output.add_argument(
        "--print-plan",
        action="store_true",
        help="Print every setting of every stage with its meaning, as TOML, and stop.",
    )
    add_json(output)


def declare(options: argparse.Namespace) -> Access:
    return declare_build(options)


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
        print(describe_plan(request, where, render_for("build")))
        return 0
    try:
        with PlantBar() as bar:
            ((_, made),) = build_plants([request], where, bar.show)
    except KeyboardInterrupt:
        print("error: interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    if options.json:
        print(format_plant(made, "build"))
    else:
        print_plant(made, "build", debug=options.debug)
    return EXIT_CODES[made.verdict]
