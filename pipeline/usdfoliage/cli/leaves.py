"""Find single leaves in photographs or in a cloud alone, and write an asset.

CAPTURE is a folder with images/ and cameras/ (a COLMAP model). depth/ (float EXR, channel Z, metres), masks/ and
capture.toml are optional: depth that is not given is computed from the photographs. Or it is a point cloud (PLY, LAS,
LAZ, E57, or text with x y z on each line), or a folder with a cloud and no images/. Every leaf becomes a Bézier
surface that stays editable. The asset also has the colours of the leaves, of photographs a picture of the average
leaf, and a report that shows what was found. That of a cloud holds report/points.ply, the points of the cloud with the
leaf of each.

    usdfoliage leaves captures/shrub -o assets/shrub
    usdfoliage leaves scan.laz -o assets/shrub
"""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.access import given
from usdfoliage.cli.options.cloud import add_orientation
from usdfoliage.cli.options.leaf_commands import (
    add_hold_back,
    add_name,
    add_no_preview,
    add_report_views,
    add_representation,
    add_reproducible,
    add_seed,
    add_settings_file,
    add_threads,
    add_views,
    add_writing,
)
from usdfoliage.cli.options.setting_help import describe_setting
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.jobs.leaves.request import LeavesRequest
    from usdfoliage.jobs.leaves.run import AUTO, DEFAULT_DEPTH, ESTIMATED
    from usdfoliage.jobs.leaves.settings import LeavesRunSettings

    settings = LeavesRunSettings()
    files = parser.add_argument_group("input and output")
    files.add_argument(
        "capture",
        metavar="CAPTURE",
        type=Path,
        nargs="?",
        help="The input is the folder of a capture, or a point cloud.",
    )
    files.add_argument("-o", "--output", metavar="OUT", type=Path, help="The asset is written to this folder.")
    add_name(files)
    files.add_argument(
        "--species", metavar="NAME", default=LeavesRequest.species, help="This species is written into the asset."
    )
    add_representation(files)
    add_views(files)
    files.add_argument(
        "--depth",
        metavar="FOLDER",
        default=LeavesRequest.depth,
        help=f"The depth maps are in this folder of CAPTURE; {ESTIMATED} computes depth from the photographs, as a "
        f"build does. The default is {AUTO}: the folder {DEFAULT_DEPTH} if it has any maps, or else {ESTIMATED}.",
    )
    add_hold_back(files)
    cloud = parser.add_argument_group("a cloud alone")
    add_orientation(cloud)
    method = parser.add_argument_group("how leaves are found")
    method.add_argument("--method", choices=("dense", "paper"), help=describe_setting(settings, "method"))
    method.add_argument(
        "--plane-threshold", metavar="METRES", help=describe_setting(settings.dense, "plane_threshold_m")
    )
    method.add_argument(
        "--min-confidence", metavar="SHARE", type=float, help=describe_setting(settings, "min_confidence")
    )
    all_settings = parser.add_argument_group("all settings")
    add_settings_file(all_settings)
    add_seed(all_settings, LeavesRequest.seed, is_setting=True)
    run_options = parser.add_argument_group("this run")
    add_threads(run_options, settings.threads, is_setting=True)
    add_report_views(run_options, LeavesRequest.report_views)
    add_no_preview(run_options)
    add_reproducible(run_options)
    add_writing(run_options)
    add_json(run_options)


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.capture.folder.listing import parts_of_input

    reads = (*parts_of_input(options.capture, options.output), *given(options.settings))
    return Access(reads=reads, replaces=given(options.output))


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.leaves import read_leaves_request, read_leaves_settings
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import LEAVES_OF_A_CLOUD, print_remarks
    from usdfoliage.jobs.leaves.cloud_run import make_cloud_leaves_asset, names_cloud, plan_cloud_leaves_asset
    from usdfoliage.jobs.leaves.run import make_leaves_asset, plan_leaves_asset
    from usdfoliage.jobs.work.settings_file import format_settings

    handle_interrupts()
    if options.print_settings:
        print(format_settings(read_leaves_settings(options)), end="")
        return 0
    request = read_leaves_request(options)
    is_cloud = names_cloud(request.capture)
    if options.dry_run:
        print(plan_cloud_leaves_asset(request) if is_cloud else plan_leaves_asset(request))
        return 0
    with StepBar() as bar:
        made = make_cloud_leaves_asset(request, bar.show) if is_cloud else make_leaves_asset(request, bar.show)
    if options.json:
        figures = None if made.withheld is None else made.withheld.as_json()
        print(
            format_made(
                asset=made.asset, report=made.report, facts=made.measures, remarks=made.remarks, withheld=figures
            )
        )
        return 0
    print_remarks(made.remarks, LEAVES_OF_A_CLOUD if is_cloud else "leaves")
    for step in made.steps:
        print(f"{step.name}: {step.count:,}")
    for row in made.measures:
        print(f"{row.name}: {row.value}")
    for row in made.withheld.rows() if made.withheld is not None else ():
        print(f"{row.name}: {row.value} ({row.remark})")
    print(f"representations: {', '.join(made.representations)}")
    print(f"asset: {made.asset}")
    print(f"report: {made.report}")
    return 0
