"""Make a tree from one photograph and strokes over it, and write an asset.

A stroke goes around the leaves of the tree, and one goes from its root up into the crown. More strokes may follow other
branches; those that the photograph shows are found from there. Branches and leaves that nobody sees grow by the species
until the tree fills its silhouette, as deep as it is wide.

    usdfoliage sketch cherry.jpg --strokes cherry.strokes.json -o assets/cherry --height 6

The strokes are a JSON file: {"image", "width", "height", "crown": [[x, y], ...], "branches": [[[x, y], ...], ...]} in
pixels of the photograph; the first branch begins at the root. Several trees are a list "trees" of such crowns and
branches, and become the assets OUT/tree_01, OUT/tree_02, and so on. usdfoliage view PHOTO is a window to draw them in.
Its sliders are kept in the table "settings" of the file; an option that is given comes before them.
"""

import argparse
from pathlib import Path

from usdfoliage.cli.options.access import given, parts_of_photograph
from usdfoliage.cli.options.leaf_commands import (
    accept_negative_numbers,
    add_output,
    add_representation,
    add_run,
)
from usdfoliage.cli.options.motion import add_motion
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.branch.foliage.species import GENERIC
    from usdfoliage.jobs.branches.surfaces import MIN_MAX_FACES
    from usdfoliage.jobs.sketch.model import MAX_DENSITY, MIN_DENSITY, SketchModelSettings
    from usdfoliage.sketch.growth import SketchGrowthSettings
    from usdfoliage.sketch.reconstruct import SketchSettings

    files = parser.add_argument_group("input and output")
    files.add_argument(
        "photo",
        metavar="PHOTO",
        type=Path,
        help="The input is a photograph of a whole tree (JPEG, HEIC, raw, PNG, TIFF or EXR).",
    )
    add_output(files)
    files.add_argument(
        "--strokes",
        metavar="FILE",
        type=Path,
        help="This JSON file has the strokes over the photograph. The default is PHOTO's name with .strokes.json, "
        "beside it; where there is none, strokes are proposed and kept in the asset as strokes.json.",
    )
    files.add_argument(
        "--mask",
        metavar="FILE",
        type=Path,
        help="This image has the size of the photograph and is white on the crown. It takes the place of the crown's "
        "stroke.",
    )
    files.add_argument(
        "--color-space",
        metavar="NAME",
        help="The photograph has this colour space. The default is the one that the file states, or else sRGB, and "
        "linear for floating-point files.",
    )
    tree = parser.add_argument_group("the tree")
    size = tree.add_mutually_exclusive_group()
    size.add_argument(
        "--height",
        metavar="METRES",
        type=float,
        default=None,
        help="The tree has this height in metres from its root to its top, above 0; the default is "
        f"{SketchSettings.height_m:g}.",
    )
    size.add_argument(
        "--tape",
        metavar=("X1", "Y1", "X2", "Y2", "METRES"),
        type=float,
        nargs=5,
        help="Two places of the photograph, in pixels, are so many metres apart.",
    )
    tree.add_argument(
        "--depth",
        metavar="FACTOR",
        type=float,
        help="The crown is deeper than it is wide by this factor, from 0.1 to 5; the default is "
        f"{SketchSettings.depth:g}.",
    )
    tree.add_argument(
        "--gravity",
        metavar="FACTOR",
        type=float,
        help="Branches that the photograph does not show hang at 1 and rise at -1; the default is "
        f"{SketchGrowthSettings.gravity:g}.",
    )
    tree.add_argument(
        "--species",
        metavar="NAME",
        default="",
        help="This species of the library is written into the asset, and decides angles, thickness and leaves. Without "
        f"this option these are those of {GENERIC}.",
    )
    tree.add_argument(
        "--species-file", metavar="FILE", type=Path, help="This TOML file has species that change the library's."
    )
    tree.add_argument(
        "--most-faces",
        dest="max_faces",
        metavar="N",
        type=int,
        default=SketchModelSettings.max_faces,
        help=f"The surface of the branches has at most this many faces, {MIN_MAX_FACES} or more; the default is "
        "%(default)s.",
    )
    leaves = parser.add_argument_group("leaves")
    leaves.add_argument(
        "--leaves",
        choices=("auto", "on", "off"),
        default="auto",
        help="on gives the tree leaves, off none, auto where the photograph shows them. The default is %(default)s.",
    )
    leaves.add_argument(
        "--leaf",
        metavar="FILE|ASSET",
        type=Path,
        help="Leaves have the form and the pattern of this one, in the photograph's colours: a picture of one leaf, "
        "its base below, transparent beside it, or an asset with leaves, of which the average leaf is taken. The "
        "default is a leaf of the species.",
    )
    leaves.add_argument(
        "--density",
        metavar="FACTOR",
        type=float,
        help="The tree has so many times the leaves of its species, from "
        f"{MIN_DENSITY:g} to {MAX_DENSITY:g}; the default is {SketchModelSettings.density:g}.",
    )
    leaves.add_argument(
        "--leaf-length",
        metavar="METRES",
        type=float,
        help="Leaves have this mean length in metres, above 0; the default is found by the photograph's texture.",
    )
    leaves.add_argument(
        "--most-leaves",
        dest="max_leaves",
        metavar="N",
        type=int,
        default=SketchModelSettings.max_leaves,
        help="The tree has this many leaves at most, 1 or more; the default is %(default)s.",
    )
    add_representation(leaves)
    leaves.add_argument("--no-crown", action="store_true", help="The asset has no crown for the distance.")
    add_motion(parser.add_argument_group("motion"))
    run_options = parser.add_argument_group("this run")
    add_run(run_options, SketchSettings.seed, 31, is_setting=True)
    accept_negative_numbers(parser)


def declare(options: argparse.Namespace) -> Access:
    photo = (options.photo,) if options.strokes is not None else parts_of_photograph(options.photo)
    return Access(
        reads=(*photo, *given(options.strokes, options.mask, options.species_file, options.leaf)),
        replaces=(options.output,),
    )


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.options.sketch import read_sketch_request
    from usdfoliage.cli.plant_results import print_published
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.jobs.sketch.run import make_sketch_asset, plan_sketch_asset

    handle_interrupts()
    request = read_sketch_request(options)
    if options.dry_run:
        print(plan_sketch_asset(request))
        return 0
    with StepBar() as bar:
        made = make_sketch_asset(request, bar.show)
    print_published(made, "sketch", as_json=options.json)
    return 0
