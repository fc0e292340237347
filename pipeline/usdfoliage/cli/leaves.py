"""Find single leaves in posed photographs with depth, and make an asset of them.

CAPTURE is a folder with images/, cameras/ (a COLMAP model) and depth/ (float EXR, channel Z, metres); masks/ and
capture.toml are optional. Every leaf becomes a Bézier surface that stays editable; the asset also gets the leaves'
colours, an average leaf texture, and a report that shows every step over the photographs.
"""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.leaf_commands import add_representation, add_writing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("capture", metavar="CAPTURE", type=Path, nargs="?", help="the capture's folder")
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, help="the asset's folder")
    parser.add_argument(
        "--method",
        choices=("dense", "paper"),
        help="dense: grow leaves pixel by pixel and fit them with all their edges; "
        "paper: superpixels, template matching and alternating fits, as published (dense)",
    )
    parser.add_argument(
        "--depth",
        metavar="FOLDER",
        default="auto",
        help="the folder of depth maps inside CAPTURE; sweep: computed from the photographs "
        "(the folder depth where it has any maps, else sweep)",
    )
    parser.add_argument(
        "--plane-threshold",
        metavar="METRES",
        help="δ_plane, how far neighbouring parts of one leaf may lie from each other's planes; "
        "auto takes it from the capture's own scale (auto)",
    )
    parser.add_argument(
        "--min-confidence", metavar="SHARE", type=float, help="leaves of less confidence are dropped, 0 to 1"
    )
    parser.add_argument(
        "--views",
        metavar="SPEC",
        help="only these photographs: names, numbers from 0 in the order of the names, or start:stop:step; with commas "
        "between them (all)",
    )
    parser.add_argument(
        "--settings", metavar="FILE", type=Path, help="TOML with any of the settings; the other options override it"
    )
    parser.add_argument(
        "--print-settings", action="store_true", help="print every setting, as --settings and the options have it"
    )
    parser.add_argument("--name", help="name of the asset (OUT's basename)")
    parser.add_argument("--species", default="", help="written into the asset")
    add_representation(parser, "all four up to 2000 leaves, beyond that bezier")
    parser.add_argument("--seed", type=int, help="of every random choice (0)")
    parser.add_argument("--threads", type=int, help="at most this many; the result is the same (all cores)")
    parser.add_argument(
        "--report-views", metavar="N", type=int, default=12, help="how many photographs the report shows (%(default)s)"
    )
    parser.add_argument("--no-preview", action="store_true", help="leave Storm's pictures out of the report")
    add_writing(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.leaves import read_leaves_request, read_leaves_settings
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import print_remarks
    from usdfoliage.jobs.leaves.run import make_leaves_asset, plan_leaves_asset
    from usdfoliage.jobs.work.settings_file import format_settings

    handle_interrupts()
    if options.print_settings:
        print(format_settings(read_leaves_settings(options)), end="")
        return 0
    request = read_leaves_request(options)
    if options.dry_run:
        print(plan_leaves_asset(request))
        return 0
    with StepBar() as bar:
        made = make_leaves_asset(request, bar.show)
    if options.json:
        print(format_made(asset=made.asset, report=made.report, facts=made.measures, remarks=made.remarks))
        return 0
    print_remarks(made.remarks, "leaves")
    for step in made.steps:
        print(f"{step.name}: {step.count:,}")
    for row in made.measures:
        print(f"{row.name}: {row.value}")
    print(f"representations: {', '.join(made.representations)}")
    print(f"asset: {made.asset}")
    print(f"report: {made.report}")
    return 0
