"""Make a dense coloured cloud, and depth for every photograph, out of a folder of photographs.

PHOTOS is a folder of photographs, or a capture: a folder with images/ and, where the poses are known, cameras/ (a
COLMAP model); masks/ and capture.toml are optional. The capture gets depth/, normals/, confidence/, cloud.ply and
capture.usda. A run that was stopped goes on where it was when the same command is given again: each result is kept by
the hash of what it was made of, in .usdfoliage/ inside the capture, which may be deleted.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.leaf_commands import add_writing

if TYPE_CHECKING:
    from usdfoliage.jobs.capture.run import MadeCapture
    from usdfoliage.jobs.report.table import Row

QUALITIES = ("draft", "normal", "high")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", metavar="PHOTOS", type=Path, nargs="?", help="a folder of photographs, or a capture")
    parser.add_argument(
        "-o", "--output", metavar="CAPTURE", type=Path, help="the capture to fill (PHOTOS where that is a capture)"
    )
    parser.add_argument(
        "--quality", choices=QUALITIES, default="normal", help="how thoroughly photographs are matched (%(default)s)"
    )
    parser.add_argument(
        "--views",
        metavar="SPEC",
        help="only these photographs: names, numbers from 0 in the order of the names, or start:stop:step; with commas "
        "between them (all)",
    )
    parser.add_argument(
        "--poses",
        choices=("auto", "known", "estimate"),
        help="known: those in cameras/, which keep their frame and unit; estimate: found from the photographs, in "
        "metres and Y up; auto: known where they are (auto)",
    )
    parser.add_argument(
        "--scale",
        metavar="SCALE",
        help="of estimated poses: how many times as large as without it, or PHOTO,PHOTO,METRES: how far apart two "
        "were taken; capture.toml may have a scale_bar or known_distance instead",
    )
    parser.add_argument(
        "--up",
        metavar="UP",
        help="of estimated poses: auto, gps, elevation, level, ground, ring, trunk, photographs, or X,Y,Z in the "
        "world as it is without it (auto)",
    )
    parser.add_argument(
        "--camera",
        choices=("auto", "one", "several"),
        help="of estimated poses: whether one camera took all photographs of a size (auto: as EXIF states)",
    )
    parser.add_argument(
        "--matching",
        choices=("auto", "exhaustive", "sequential", "retrieval"),
        help="of estimated poses: which photographs are compared (auto: all; of many, neighbours and similar ones)",
    )
    parser.add_argument(
        "--mask",
        choices=("auto", "given", "none"),
        help="auto: depth only where masks/ are white, and of photographs without one not in the sky; given: only the "
        "former; none: everywhere (auto)",
    )
    parser.add_argument(
        "--dense",
        choices=("own", "colmap"),
        help="what matches photographs: ours, or the PatchMatch of a pycolmap that is built with CUDA (own)",
    )
    parser.add_argument(
        "--settings", metavar="FILE", type=Path, help="TOML with any of the settings; the other options override it"
    )
    parser.add_argument(
        "--print-settings", action="store_true", help="print every setting, as --settings and the options have it"
    )
    parser.add_argument("--seed", type=int, help="of every random choice (0)")
    parser.add_argument("--threads", type=int, help="at most this many; the result is the same (all cores)")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="only go on with an earlier run, do not begin one (results are reused anyway)",
    )
    parser.add_argument("--fresh", action="store_true", help="forget what earlier runs did, and begin anew")
    parser.add_argument(
        "--report-views", metavar="N", type=int, default=12, help="how many photographs the report shows (%(default)s)"
    )
    parser.add_argument("--no-report", action="store_true", help="write no report")
    add_writing(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.capture import read_capture_request, read_capture_run_settings
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import print_remarks
    from usdfoliage.jobs.capture.run import make_capture, plan_capture
    from usdfoliage.jobs.work.settings_file import format_settings

    handle_interrupts()
    if options.print_settings:
        print(format_settings(read_capture_run_settings(options)), end="")
        return 0
    request = read_capture_request(options)
    if options.dry_run:
        print(plan_capture(request))
        return 0
    try:
        with StepBar() as bar:
            made = make_capture(request, bar.show)
    except KeyboardInterrupt:
        print("error: interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    facts = _list_facts(made)
    if options.json:
        seconds = dict(made.seconds)
        print(
            format_made(
                asset=None,
                report=made.report,
                facts=facts,
                remarks=made.remarks,
                cloud=str(made.cloud),
                seconds=seconds,
            )
        )
        return 0
    print_remarks(made.remarks, "capture")
    for row in facts:
        print(f"{row.name}: {row.value}")
    print(f"seconds: {', '.join(f'{name} {seconds:.1f}' for name, seconds in made.seconds.items())}")
    print(f"cloud: {made.cloud}")
    if made.report is not None:
        print(f"report: {made.report}")
    return 0


def _list_facts(made: "MadeCapture") -> "list[Row]":
    """The figures of a capture."""
    from usdfoliage.jobs.report.table import Row

    photographs = f"{made.registered:,} of {made.photographs:,} have a pose, {made.views:,} have depth"
    coverage = f"{made.coverage:.0%} of the median photograph's pixels that are not masked have depth"
    return [
        Row(name="photographs", value=photographs),
        Row(name="coverage", value=coverage),
        Row(name="points", value=f"{made.points:,}"),
    ]
