"""Make a crown from one photograph, a capture or a point cloud, and write an asset.

PHOTO shows a whole dense crown from the side. Without --mask the command proposes a mask and keeps it in the asset as
NAME_mask_proposal.png: check it, correct it, and pass it with --mask. CAPTURE is the folder of a capture with
photographs, cameras and a cloud, as usdfoliage capture makes them: the crown is where the points are and the
photographs show it. CLOUD is a point cloud alone: the crown is where its points are, and has their colours.

    usdfoliage crown oak.jpg --mask oak_mask.png -o assets/oak --height 7.5
    usdfoliage crown scan.laz -o assets/ash_crown --leaf ash_leaf.png

The asset has a mesh of the crown, cubemaps of its radius and its colour (EXR), and a report, with pictures if the
preview interpreter is installed.
"""

import argparse
from pathlib import Path

from usdfoliage.cli.options.access import given
from usdfoliage.cli.options.cloud import add_cloud
from usdfoliage.cli.options.leaf_commands import (
    add_output,
    add_report_views,
    add_run,
    add_threads,
)
from usdfoliage.files.write_gate import Access


def read_mesh_size(text: str) -> int | None:
    """Vertices along an edge of the cube; None for auto."""
    return None if text == "auto" else int(text)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.asset.packages.leaf_package import AssetSettings
    from usdfoliage.jobs.crown.photograph import MAX_SIZE, MIN_SIZE, CrownSettings
    from usdfoliage.jobs.crown.run_capture import CapturedCrownRequest
    from usdfoliage.jobs.crown.run_photograph import CrownRequest

    files = parser.add_argument_group("input and output")
    files.add_argument(
        "photo",
        metavar="PHOTO|CAPTURE|CLOUD",
        type=Path,
        help="The input is a photograph (JPEG, HEIC, raw, PNG, TIFF or EXR), the folder of a capture, or a point cloud "
        "(PLY, LAS, LAZ, E57, XYZ, ...).",
    )
    add_output(files)
    files.add_argument(
        "--species", metavar="NAME", default=CrownRequest.species, help="This species is written into the asset."
    )
    files.add_argument(
        "--size",
        metavar="TEXELS",
        type=int,
        default=CrownSettings.size,
        help=f"A face of the cubemaps has this many texels a side, from {MIN_SIZE} to {MAX_SIZE}; the default is "
        "%(default)s.",
    )
    files.add_argument(
        "--mesh-size",
        metavar="N",
        type=read_mesh_size,
        default=AssetSettings.crown_mesh_size,
        help="The cage has this many vertices along an edge of the cube, 3 or more; the default is auto: as few as "
        "keep the silhouettes of the crown.",
    )
    files.add_argument(
        "--leaf",
        metavar="FILE|ASSET",
        type=Path,
        help="The leaves of the form leaves look like this: a picture of one leaf, its base below, transparent beside "
        "it, or an asset with leaves, of which the average leaf is taken. The default is a plain leaf.",
    )
    _add_photo_options(parser.add_argument_group("of a photograph"))
    cloud = parser.add_argument_group("of a capture or a cloud")
    add_cloud(cloud)
    add_report_views(cloud, CapturedCrownRequest.report_views)
    run_options = parser.add_argument_group("this run")
    add_run(run_options, CrownSettings.seed)
    add_threads(run_options, CrownSettings.threads)


def _add_photo_options(parser: argparse._ActionsContainer) -> None:
    from usdfoliage.jobs.crown.photograph import CrownSettings
    from usdfoliage.jobs.crown.tangent import FLATTEST, STEEPEST
    from usdfoliage.jobs.work.settings_file import AUTO

    parser.add_argument(
        "--mask",
        metavar="FILE",
        type=Path,
        help="This image has the size of the photograph and is white on the crown. The default is a proposal.",
    )
    parser.add_argument(
        "--height",
        metavar="METRES",
        type=float,
        default=CrownSettings.height_m,
        help="The crown has this height in metres, above 0, seen from the front; the default is %(default)g.",
    )
    parser.add_argument(
        "--tangent",
        metavar="K",
        default=AUTO,
        help="The surface has this slope at the silhouette: a number from "
        f"{FLATTEST:g} to {STEEPEST:g} (2 makes a ball of a disc), an image, or a formula in i (from the left) and j "
        "(from the top) such as '1 + 2*j'. auto makes the crown as deep as wide. The default is %(default)s.",
    )
    parser.add_argument(
        "--relief",
        metavar="RHO",
        type=float,
        default=CrownSettings.relief,
        help="Light foliage stands out and dark foliage recedes by this weight, from 0 to 1; the default is "
        "%(default)g.",
    )
    parser.add_argument(
        "--laplacian",
        action="store_true",
        help="Compute the relief from a Laplacian pyramid instead of a Gaussian one.",
    )
    parser.add_argument(
        "--copies",
        metavar="N",
        type=int,
        default=CrownSettings.copies,
        help="The crown has this many turned copies of the surface, from 1 to 4, for crowns that would be flat; the "
        "default is %(default)s.",
    )
    parser.add_argument(
        "--color-space",
        metavar="NAME",
        help="The photograph has this colour space. The default is the one that the file states, or else sRGB, and "
        "linear for floating-point files.",
    )


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.capture.folder.listing import parts_of_input

    kept = given(options.mask)  # of one in OUT the asset gets a copy, as of a proposal that was corrected
    kept = kept if kept and kept[0].name.endswith("_mask_proposal.png") else ()
    return Access(
        reads=(*parts_of_input(options.photo, options.output), *given(options.mask), *given(options.leaf)),
        replaces=(options.output,),
        keeps=kept,
    )


def run(options: argparse.Namespace) -> int:
    from usdfoliage.capture.cloud_files.read import is_cloud_input
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.options.crown import read_captured_crown_request, read_crown_request
    from usdfoliage.cli.plant_results import print_published
    from usdfoliage.cli.progress import StepBar

    if options.photo.is_dir() or is_cloud_input(options.photo):
        from usdfoliage.jobs.crown.run_capture import (
            make_captured_crown_asset,
            plan_captured_crown_asset,
        )

        handle_interrupts()
        captured = read_captured_crown_request(options)
        if options.dry_run:
            print(plan_captured_crown_asset(captured))
            return 0
        with StepBar() as bar:
            made = make_captured_crown_asset(captured, bar.show)
    else:
        from usdfoliage.jobs.crown.run_photograph import make_crown_asset, plan_crown_asset

        handle_interrupts()
        request = read_crown_request(options)
        if options.dry_run:
            print(plan_crown_asset(request))
            return 0
        with StepBar() as bar:
            made = make_crown_asset(request, bar.show)
    print_published(made, "crown", as_json=options.json)
    return 0
