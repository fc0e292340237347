"""Make an asset of the crown of a tree or shrub, from one photograph, a capture or a cloud.

PHOTO shows the whole of a dense crown from the side; without --mask a mask is proposed and kept in the asset as
<name>_mask_proposal.png: look at it, correct it, and give it with --mask. CAPTURE is the folder of a capture with
photographs, cameras and the cloud that `usdfoliage capture` makes of them: the crown then is where the points are and
the photographs show it. CLOUD is a point cloud alone: the crown is where its points are, in their colours. The asset
gets a crown mesh, a radius and a colour cubemap (EXR), a report and, where the preview interpreter is installed,
pictures.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from usdfoliage.cli.json_output import add_json

if TYPE_CHECKING:
    from usdfoliage.jobs.crown.written import WrittenCrown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "photo",
        metavar="PHOTO|CAPTURE|CLOUD",
        type=Path,
        help="JPEG, PNG, TIFF or EXR; the folder of a capture; or PLY, LAS, LAZ, XYZ, ...",
    )
    parser.add_argument("-o", "--output", metavar="OUT", type=Path, required=True, help="the asset's folder")
    parser.add_argument("--name", help="name of the asset (OUT's basename)")
    parser.add_argument("--size", type=int, default=256, help="texels a side of a cubemap face (%(default)s)")
    _add_photo_options(parser.add_argument_group("of a photograph"))
    _add_capture_options(parser.add_argument_group("of a capture or a cloud"))
    parser.add_argument("--mesh-size", type=int, default=129, help="vertices along an edge of the mesh (%(default)s)")
    parser.add_argument("--species", default="", help="written into the asset")
    parser.add_argument("--seed", type=int, default=0, help="of every random choice (%(default)s)")
    parser.add_argument("--threads", type=int, default=0, help="at most this many; the result is the same (all cores)")
    parser.add_argument("--no-preview", action="store_true", help="leave the pictures out of the report")
    parser.add_argument("--force", action="store_true", help="replace OUT though it is not an asset of ours")
    parser.add_argument(
        "--dry-run", action="store_true", help="check the input, print what would be done, write nothing"
    )
    add_json(parser)


def _add_photo_options(parser: argparse._ArgumentGroup) -> None:
    parser.add_argument("--mask", type=Path, help="image of the same size, white = crown (proposed when absent)")
    parser.add_argument(
        "--height", metavar="METRES", type=float, default=5.0, help="of the crown, seen from the front (%(default)s)"
    )
    parser.add_argument(
        "--tangent",
        metavar="K",
        default="auto",
        help="slope of the surface at the silhouette: a number (2 inflates a disc to a ball), an image, a formula in "
        "i (from the left) and j (from the top) such as '1 + 2*j', or auto, as deep as wide (%(default)s)",
    )
    parser.add_argument("--relief", metavar="RHO", type=float, default=0.12, help="its weight, 0 to 1 (%(default)s)")
    parser.add_argument(
        "--laplacian", action="store_true", help="relief from a Laplacian instead of a Gaussian pyramid"
    )
    parser.add_argument(
        "--copies", type=int, default=1, help="1 to 4 turned copies of the surface, for flat crowns (%(default)s)"
    )
    parser.add_argument("--color-space", help="of PHOTO, if the file does not state it (sRGB; linear for floats)")


def _add_capture_options(parser: argparse._ArgumentGroup) -> None:
    parser.add_argument(
        "--roots",
        default="auto",
        metavar="auto|K|X,Y,Z",
        help="where stems come out of the ground, as for branches: the first one is the asset's origin (%(default)s)",
    )
    parser.add_argument("--up", default="auto", metavar="AXIS", help="axis of the cloud that is up (%(default)s)")
    parser.add_argument("--unit", default="auto", help="unit of the cloud, if its file does not state it (%(default)s)")
    parser.add_argument(
        "--report-views",
        type=int,
        default=6,
        metavar="N",
        help="photographs that the report shows, of a capture (%(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    from usdfoliage.capture.cloud_files.read import is_cloud_input
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.crown import read_captured_crown_request, read_crown_request
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import print_remarks

    made: WrittenCrown
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
    if options.json:
        print(format_made(asset=made.asset, report=made.report, facts=made.measures, remarks=made.remarks))
        return 0
    print_remarks(made.remarks, "crown")
    for row in made.measures:
        print(f"{row.name}: {row.value}")
    print(f"asset: {made.asset}")
    if made.preview:
        print(f"preview: {made.preview}")
    print(f"report: {made.report}")
    return 0
