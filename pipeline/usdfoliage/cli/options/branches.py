"""What the options of usdfoliage branches set, checked."""

import argparse
from dataclasses import replace

from usdfoliage.asset.leaf_representations import read_representations
from usdfoliage.asset.parts.branch_part import BranchAssetSettings
from usdfoliage.asset.plant import asset_name
from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.foliage.place import FoliageSettings
from usdfoliage.branch.foliage.species import GENERIC, Species, load_species
from usdfoliage.branch.tracing.radii import RadiusSettings
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.cli.options.leaf_commands import name_option, read_resolution
from usdfoliage.cli.options.motion import read_motion
from usdfoliage.cli.remarks import render_for
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.branches.foliage import FITTED, NONE, FoliageRequest
from usdfoliage.jobs.branches.regrowth import MAX_SPREAD, MAX_VARIATIONS, RegrowthRequest
from usdfoliage.jobs.branches.run import BranchesRequest
from usdfoliage.jobs.branches.surfaces import MIN_MAX_FACES
from usdfoliage.jobs.edits.scatter import LENGTHS_M, MAX_LEAVES, read_color
from usdfoliage.jobs.plant_cloud import MIN_POINTS, PlantCloudRequest, read_roots, read_unit, read_up


def read_branches_request(options: argparse.Namespace) -> BranchesRequest:
    """The request that a command line makes; FoliageError for values that cannot be."""
    if options.species_file is not None and not options.species:
        raise FoliageError("--species-file holds species", "name with --species which one is meant")
    if not 0 <= options.seed < 2**62:  # an asset records it as int64, and those of variations follow it
        raise FoliageError(f"--seed must be 0 or more and below 2^62, not {options.seed}")
    species = load_species(options.species, options.species_file) if options.species else None
    allometry = AllometrySettings(exponent=species.exponent) if species else AllometrySettings()
    try:
        settings = BranchSettings(
            internode_m=options.internode,
            leaves=options.cloud_leaves,
            radii=RadiusSettings(allometry=allometry),
        )
    except ValueError as error:
        raise FoliageError(f"--internode: {error}") from error
    bark = BranchAssetSettings()
    if options.bark_color is not None:
        bark = replace(bark, color=read_color(options.bark_color, "--bark-color"))
    return BranchesRequest(
        cloud=_read_cloud(options),
        output=options.output,
        name=asset_name(options.name or options.output.resolve().name),
        settings=settings,
        species=species.name if species else "",
        regrowth=_read_regrowth(options),
        foliage=_read_foliage(options, species),
        motion=read_motion(options),
        asset=bark,
        max_faces=_read_max_faces(options),
        seed=options.seed,
        preview=not options.no_preview,
        times=not options.reproducible,
        force=options.force,
        keep_old=options.keep_old,
        render_setting=render_for("branches"),
    )


def _read_max_faces(options: argparse.Namespace) -> int | None:
    if options.max_faces is not None and options.max_faces < MIN_MAX_FACES:
        raise FoliageError(f"--most-faces must be at least {MIN_MAX_FACES}, not {options.max_faces}")
    faces: int | None = options.max_faces
    return faces


def _read_cloud(options: argparse.Namespace) -> PlantCloudRequest:
    """The cloud that a command line names."""
    roots, given = name_option(read_roots, options.roots)
    if options.max_points < MIN_POINTS:
        raise FoliageError(f"--most-points must be at least {MIN_POINTS}, not {options.max_points}")
    return PlantCloudRequest(
        path=options.cloud,
        roots=roots,
        given_roots=given,
        up=name_option(read_up, options.up),
        unit=name_option(read_unit, options.unit),
        max_points=options.max_points,
        internode_m=options.internode,
        must_be_plant=not options.any_cloud,
    )


def _read_foliage(options: argparse.Namespace, species: Species | None) -> FoliageRequest:
    """The leaves that a command line asks for."""
    kind = options.foliage or (FITTED if options.leaves else NONE)
    if kind == FITTED and options.leaves is None:
        raise FoliageError("--foliage fitted takes leaves from an asset of leaves", "name it with --leaves")
    if kind != FITTED and options.leaves is not None:
        raise FoliageError(f"--leaves is for --foliage fitted, not {kind}", "leave one of them out")
    shortest_m, longest_m = LENGTHS_M
    if options.leaf_length is not None and not shortest_m <= options.leaf_length <= longest_m:
        raise FoliageError(f"--leaf-length must be {shortest_m:g} to {longest_m:g} metres, not {options.leaf_length:g}")
    if not 1 <= options.max_leaves <= MAX_LEAVES:
        raise FoliageError(f"--most-leaves must be 1 to {MAX_LEAVES:,}, not {options.max_leaves}")
    chosen = read_representations(options.representation) if options.representation else None
    resolution = read_resolution(options)
    return FoliageRequest(
        kind=kind,
        species=species or load_species(GENERIC),
        source=options.leaves,
        length_m=options.leaf_length,
        settings=FoliageSettings(max_leaves=options.max_leaves),
        representations=chosen,
        resolution=resolution,
    )


def _read_regrowth(options: argparse.Namespace) -> RegrowthRequest:
    """The growth that a command line asks for."""
    if not 0 <= options.variations <= MAX_VARIATIONS:
        raise FoliageError(f"--variations must be 0 to {MAX_VARIATIONS}, not {options.variations}")
    if not 0 <= options.variation_spread <= MAX_SPREAD:
        raise FoliageError(f"--variation-spread must be 0 to {MAX_SPREAD:g}, not {options.variation_spread:g}")
    return RegrowthRequest(
        method=options.method,
        fill="on" if options.fill else "off",
        hidden=options.fill_hidden,
        variations=options.variations,
        variation_spread=options.variation_spread,
        internode_m=options.internode,
    )
