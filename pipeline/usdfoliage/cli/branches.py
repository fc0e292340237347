"""Trace the branches of a plant through its point cloud, and write an asset.

CLOUD is a file (PLY, LAS, LAZ, E57, or text with x y z on each line) or the folder of a capture. The asset has the
skeleton with radii, parents and orders of the branches, and one closed surface over all branches. With --foliage it
also has leaves on its twigs, which can be edited as in any other asset.

    usdfoliage branches scan.laz -o assets/ash
    usdfoliage branches scan.laz -o assets/maple --species maple --foliage template
"""

import argparse
from pathlib import Path

from usdfoliage.cli.json_output import add_json
from usdfoliage.cli.options.access import given
from usdfoliage.cli.options.cloud import add_cloud, add_cloud_leaves
from usdfoliage.cli.options.leaf_commands import (
    add_no_preview,
    add_output,
    add_representation,
    add_reproducible,
    add_resolution,
    add_seed,
    add_writing,
)
from usdfoliage.cli.options.motion import add_motion
from usdfoliage.cli.options.setting_help import state_default
from usdfoliage.files.write_gate import Access


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from usdfoliage.jobs.branches.run import BranchesRequest

    files = parser.add_argument_group("input and output")
    files.add_argument(
        "cloud", metavar="CLOUD", type=Path, help="The input is a point cloud, or the folder of a capture."
    )
    add_output(files)
    cloud = parser.add_argument_group("the cloud")
    add_cloud(cloud)
    add_cloud_leaves(cloud)
    cloud.add_argument(
        "--any-cloud",
        action="store_true",
        help="Trace branches also through a cloud that looks like a building, a wall, bare ground or a hedge. Without "
        "this option such a cloud is an error, unless --roots names places of stems.",
    )
    _add_tracing(parser.add_argument_group("branches"))
    _add_species(parser.add_argument_group("species"))
    _add_leaves(parser.add_argument_group("leaves"))
    add_motion(parser.add_argument_group("motion"))
    run_options = parser.add_argument_group("this run")
    add_seed(run_options, BranchesRequest.seed, 62)
    add_no_preview(run_options)
    add_reproducible(run_options)
    add_writing(run_options)
    add_json(run_options)


def _add_tracing(parser: argparse._ActionsContainer) -> None:
    from usdfoliage.asset.parts.branch_part import BranchAssetSettings
    from usdfoliage.branch.tracing.settings import BranchSettings
    from usdfoliage.jobs.branches.regrowth import MAX_SPREAD, MAX_VARIATIONS, METHODS, RegrowthRequest
    from usdfoliage.jobs.branches.surfaces import FACES_A_POINT, MAX_FACES, MIN_FACES, MIN_MAX_FACES
    from usdfoliage.jobs.plant_cloud import MIN_POINTS, PlantCloudRequest

    parser.add_argument(
        "--method",
        choices=METHODS,
        default=RegrowthRequest.method,
        help="trace lets branches follow the points; grow lets them grow from the roots through the points. The "
        "default is %(default)s.",
    )
    parser.add_argument(
        "--internode",
        metavar="METRES",
        type=float,
        help="An internode has this length in metres, above 0. The default is "
        f"{BranchSettings.internode_of_height:g} of the plant's height; grow also takes it from the points' "
        "spacing.",
    )
    parser.add_argument(
        "--most-points",
        dest="max_points",
        metavar="N",
        type=int,
        default=PlantCloudRequest.max_points,
        help=f"Branches are traced through this many points at most, {MIN_POINTS} or more; the default is %(default)s.",
    )
    parser.add_argument(
        "--most-faces",
        dest="max_faces",
        metavar="N",
        type=int,
        help=f"The surface has this many faces at most, {MIN_MAX_FACES} or more. The default is {FACES_A_POINT} for "
        f"each point of the cloud, from {MIN_FACES} to {MAX_FACES}.",
    )
    parser.add_argument(
        "--fill",
        action="store_true",
        help="Let branches grow on into what they leave of the cloud. foliage:inferred of the skeleton is 1 for "
        "branches that are grown so.",
    )
    parser.add_argument(
        "--fill-hidden",
        action="store_true",
        help="Grow branches also inside the crown, where its foliage hides them from the cloud.",
    )
    parser.add_argument(
        "--variations",
        metavar="N",
        type=int,
        default=RegrowthRequest.variations,
        help=f"So many further plants like this one grow, from 0 to {MAX_VARIATIONS}; the default is %(default)s.",
    )
    parser.add_argument(
        "--variation-spread",
        metavar="FACTOR",
        type=float,
        default=RegrowthRequest.variation_spread,
        help="Variations differ in height, crown, limbs and stem by this factor of what trees of one kind and age "
        f"differ by, from 0 to {MAX_SPREAD:g}; the default is %(default)g. With 0 they keep the outline of the plant.",
    )
    parser.add_argument(
        "--bark-color",
        metavar=("R", "G", "B"),
        type=float,
        nargs=3,
        help="The branches have this linear colour, from 0 to 1 each. The default is a brown, "
        f"{state_default(BranchAssetSettings.color)}.",
    )


def _add_species(parser: argparse._ActionsContainer) -> None:
    from usdfoliage.branch.foliage.species import GENERIC

    parser.add_argument(
        "--species",
        default="",
        metavar="NAME",
        help="This species of the library is written into the asset, and decides the thickness of branches and the "
        f"places of leaves. It adds no leaves by itself. Without this option leaves stand as those of {GENERIC}.",
    )
    parser.add_argument(
        "--species-file",
        metavar="FILE",
        type=Path,
        help="This TOML file has species that change those of the library or add to them.",
    )


def _add_leaves(parser: argparse._ActionsContainer) -> None:
    from usdfoliage.branch.foliage.place import FoliageSettings
    from usdfoliage.jobs.branches.foliage import KINDS
    from usdfoliage.jobs.edits.scatter import LENGTHS_M, MAX_LEAVES

    parser.add_argument(
        "--foliage",
        choices=KINDS,
        help="none adds no leaves; template adds leaves in the proportions of the species; fitted draws from the "
        "leaves of --leaves. The default is fitted with --leaves, and none without.",
    )
    parser.add_argument(
        "--leaves",
        metavar="ASSET",
        type=Path,
        help="Leaves get their shape, colour and length from this asset, which usdfoliage leaves made.",
    )
    parser.add_argument(
        "--leaf-length",
        metavar="METRES",
        type=float,
        help=f"A leaf has this length in metres, from {LENGTHS_M[0]:g} to {LENGTHS_M[1]:g}. The default is the length "
        "of the species, or of the leaves in --leaves.",
    )
    parser.add_argument(
        "--most-leaves",
        dest="max_leaves",
        metavar="N",
        type=int,
        default=FoliageSettings.max_leaves,
        help=f"The plant has this many leaves at most, from 1 to {MAX_LEAVES}; more are thinned evenly. The default is "
        "%(default)s.",
    )
    add_representation(parser)
    add_resolution(parser)


def declare(options: argparse.Namespace) -> Access:
    from usdfoliage.capture.folder.listing import parts_of_input

    reads = (*parts_of_input(options.cloud, options.output), *given(options.species_file))
    if options.leaves is not None:
        from usdfoliage.asset.access import find_asset

        reads += find_asset(options.leaves).reads
    return Access(reads=reads, replaces=(options.output,))


def run(options: argparse.Namespace) -> int:
    from usdfoliage.cli.interrupts import handle_interrupts
    from usdfoliage.cli.json_output import format_made
    from usdfoliage.cli.options.branches import read_branches_request
    from usdfoliage.cli.progress import StepBar
    from usdfoliage.cli.remarks import print_remarks
    from usdfoliage.jobs.branches.run import make_branches_asset, plan_branches_asset

    handle_interrupts()
    request = read_branches_request(options)
    if options.dry_run:
        print(plan_branches_asset(request))
        return 0
    with StepBar() as bar:
        made = make_branches_asset(request, bar.show)
    if options.json:
        variations = [str(each) for each in made.variations]
        print(
            format_made(
                asset=made.asset,
                report=made.report,
                facts=made.measures,
                remarks=made.remarks,
                variations=variations,
            )
        )
        return 0
    print_remarks(made.remarks, "branches")
    for row in made.measures:
        print(f"{row.name}: {row.value}")
    print("seconds: " + ", ".join(f"{name} {value:.1f}" for name, value in made.seconds.items()))
    print(f"asset: {made.asset}")
    for variation in made.variations:
        print(f"variation: {variation}")
    print(f"report: {made.report}")
    return 0
