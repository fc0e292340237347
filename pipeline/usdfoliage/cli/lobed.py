"""Make a leaf of several lobes from one scan, and write an asset.

SCAN is a picture of a leaf that lies flat, as a flatbed scanner makes it. With --mask the leaf is what is white there.
Without it the alpha of the picture cuts the leaf out. In a picture without alpha the leaf is what differs in colour
from the paper or ground around it, also on ruled paper. The leaf keeps its silhouette, its skeleton and its railroad
ties as numbers, and every lobe can be turned, bent and twisted by itself.

    usdfoliage lobed oak_scan.png --mask oak_mask.png -o assets/oak_leaf --dpi 300

Of a scan with several leaves each becomes an asset: OUT/leaf_01, OUT/leaf_02 and so on, from left to right. The report
shows how the leaf was made, and the leaf deformed in six ways if the preview interpreter is installed.
"""

import argparse
from pathlib import Path

from usdfoliage.cli.options.access import given
from usdfoliage.cli.options.leaf_commands import add_output, add_run
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.jobs.lobed.request import DEFAULT_HEIGHT_M, LobedRequest

    files = parser.add_argument_group("input and output")
    files.add_argument("scan", metavar="SCAN", type=Path, help="The input is a picture of one leaf or of several.")
    add_output(files)
    files.add_argument(
        "--mask",
        metavar="FILE",
        type=Path,
        help="This image has the size of the scan and is white on the leaf. The default is the alpha of the scan, or "
        "else what differs in colour from the ground of the scan.",
    )
    files.add_argument(
        "--species", metavar="NAME", default=LobedRequest.species, help="This species is written into the asset."
    )
    files.add_argument(
        "--color-space",
        metavar="NAME",
        help="The scan has this colour space. The default is the one that the file states, or else sRGB, and linear "
        "for floating-point files.",
    )
    size = parser.add_argument_group("the leaf")
    size.add_argument(
        "--dpi",
        metavar="N",
        type=float,
        help="The scan has this many pixels an inch, above 0. The default is to take a width or a height instead.",
    )
    size.add_argument(
        "--width",
        metavar="METRES",
        type=float,
        help="The largest leaf of the scan has this width in metres, above 0, from left to right. The default is what "
        "follows from --dpi or --height.",
    )
    size.add_argument(
        "--height",
        metavar="METRES",
        type=float,
        help="The largest leaf of the scan has this height in metres, above 0, from top to bottom. The default is "
        f"what follows from --dpi or --width, or else {DEFAULT_HEIGHT_M:g}.",
    )
    size.add_argument(
        "--subdivision",
        action="store_true",
        help="Write a subdivision surface with the midrib as a crease, instead of polygons.",
    )
    add_run(parser.add_argument_group("this run"), LobedRequest.seed)


def declare(options: argparse.Namespace) -> Access:
    return Access(reads=(options.scan, *given(options.mask)), replaces=(options.output,))


def run(options: argparse.Namespace) -> int:
    from usdfoliage.asset.parts.lobed_leaf import LobedAssetSettings
    from usdfoliage.asset.plant import asset_name
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.plant_results import print_leaves, print_published
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import render_for
    from usdfoliage.errors import FoliageError
    from usdfoliage.jobs.lobed.request import LeafSize, LobedRequest
    from usdfoliage.jobs.lobed.run import make_lobed_assets, plan_lobed_assets

    handle_interrupts()
    try:
        request = LobedRequest(
            scan=options.scan,
            mask=options.mask,
            output=options.output,
            name=asset_name(options.name or options.output.resolve().name),
            size=LeafSize(dpi=options.dpi, width_m=options.width, height_m=options.height),
            asset_settings=LobedAssetSettings(subdivision=options.subdivision),
            color_space=options.color_space,
            species=options.species,
            seed=options.seed,
            force=options.force,
            keep_old=options.keep_old,
            preview=not options.no_preview,
            times=not options.reproducible,
            render_setting=render_for("lobed"),
        )
    except ValueError as error:
        raise FoliageError(str(error)) from error
    if options.dry_run:
        print(plan_lobed_assets(request))
        return 0
    with StepBar() as bar:
        made = make_lobed_assets(request, bar.show)
    if len(made) == 1:
        print_published(made[0], "lobed", as_json=options.json)
    else:
        print_leaves(made, "lobed", as_json=options.json)
    return 0
