"""Compute cameras, depth and a coloured cloud from a folder of photographs.

PHOTOS is a folder of photographs, a video, or a capture: a folder with images/, and with cameras/ (a COLMAP model) if
the poses are known. masks/ and capture.toml are optional. The capture gets depth/, normals/, confidence/, cloud.ply and
capture.usda.

    usdfoliage capture photographs/ -o captures/shrub

If a run is stopped, the same command continues it: each result is kept under the hash of its inputs, in .usdfoliage/
inside the capture. You may delete that folder when no run uses it.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.access import given, parts_of_capture
from usdfoliage.cli.options.leaf_commands import (
    add_report_views,
    add_reproducible,
    add_seed,
    add_settings_file,
    add_threads,
    add_views,
    add_writing,
)
from usdfoliage.cli.options.setting_help import describe_setting
from usdfoliage.files.write_gate import Access

if TYPE_CHECKING:
    from usdfoliage.jobs.capture.run import MadeCapture
    from usdfoliage.jobs.capture.settings import CaptureRunSettings
    from usdfoliage.jobs.report.table import Row

QUALITIES = ("draft", "normal", "high")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.jobs.capture.run import CaptureRequest
    from usdfoliage.jobs.capture.settings import CaptureRunSettings

    settings = CaptureRunSettings()
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "source",
        metavar="PHOTOS",
        type=Path,
        nargs="?",
        help="The input is a folder of photographs, a video, or a capture.",
    )
    files.add_argument(
        "-o",
        "--output",
        metavar="CAPTURE",
        type=Path,
        help="The results are written to this capture. The default is PHOTOS if that is a capture.",
    )
    add_views(files)
    _add_matching(parser.add_argument_group("how photographs are matched"), settings)
    _add_poses(parser.add_argument_group("poses, and what is estimated where they are not known"), settings)
    all_settings = parser.add_argument_group("all settings")
    add_settings_file(all_settings)
    add_seed(all_settings, settings.depth.seed, 31, is_setting=True)
    run_options = parser.add_argument_group("this run")
    add_threads(run_options, CaptureRequest.threads, is_setting=True)
    run_options.add_argument(
        "--resume",
        action="store_true",
        help="Only continue an earlier run; without one the command ends. Earlier results are used in any case.",
    )
    run_options.add_argument(
        "--fresh", action="store_true", help="Forget the results of earlier runs, and begin again."
    )
    add_report_views(run_options, CaptureRequest.report_views)
    run_options.add_argument("--no-report", action="store_true", help="Write no report.")
    add_reproducible(run_options)
    add_writing(run_options, of_asset=False)
    add_json(run_options)


def _add_matching(parser: argparse._ActionsContainer, settings: "CaptureRunSettings") -> None:
    from usdfoliage.jobs.capture.settings import PRESETS

    sides = ", ".join(f"{quality} {preset.depth.max_side_px}" for quality, preset in PRESETS.items())
    parser.add_argument(
        "--quality",
        choices=QUALITIES,
        default="normal",
        help="Photographs are matched at this quality. Their longer side then has at most so many pixels: "
        f"{sides}. The default is %(default)s.",
    )
    parser.add_argument("--mask", choices=("auto", "given", "none"), help=describe_setting(settings, "mask"))
    parser.add_argument("--dense", choices=("own", "colmap"), help=describe_setting(settings, "dense"))


def _add_poses(parser: argparse._ActionsContainer, settings: "CaptureRunSettings") -> None:
    estimation, world = settings.pose_estimation, settings.world
    parser.add_argument("--poses", choices=("auto", "known", "estimate"), help=describe_setting(settings, "poses"))
    parser.add_argument(
        "--scale",
        metavar="SCALE",
        help=f"{describe_setting(world, 'times')} Or PHOTO,PHOTO,METRES: the distance in metres between the cameras of "
        "two photographs. scale_bar or known_distance in capture.toml can take its place.",
    )
    parser.add_argument(
        "--up",
        metavar="UP",
        help=f"{describe_setting(world, 'up')} Or X,Y,Z: the up direction in the world as it is without this option.",
    )
    parser.add_argument(
        "--camera",
        choices=("auto", "one", "several"),
        help="one gives all photographs one camera, several gives each its own; auto shares one among photographs of "
        f"the same size, make, model and focal length. The default is {estimation.one_camera}.",
    )
    parser.add_argument(
        "--matching",
        choices=("auto", "exhaustive", "sequential", "retrieval"),
        help=describe_setting(estimation, "matching"),
    )


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.capture.folder.listing import IMAGES
    from usdfoliage.jobs.capture.find_photographs import is_same_file
    from usdfoliage.jobs.capture.results import written_names

    folder = options.output or options.source
    if options.source is None or folder is None:
        return Access()
    is_capture = (options.source / IMAGES).is_dir()
    if not is_capture and (options.output is None or is_same_file(options.source, folder)):
        return Access()  # it has no place for results, which the command reports
    replaced = tuple(folder / name for name in written_names())
    return Access(reads=(*given(options.settings), *parts_of_capture(options.source)), replaces=replaced)


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
