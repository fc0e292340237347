"""What the options of usdfoliage sketch set, checked."""

import argparse
import math

from usdfoliage.asset.leaf_representations import read_representations
from usdfoliage.asset.plant import asset_name
from usdfoliage.branch.foliage.species import GENERIC, load_species
from usdfoliage.cli.options.motion import read_motion
from usdfoliage.cli.remarks import render_for
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.branches.surfaces import MIN_MAX_FACES
from usdfoliage.jobs.sketch.model import HAS_LEAVES, MAX_LEAVES, SketchModelSettings
from usdfoliage.jobs.sketch.run import SketchRequest
from usdfoliage.sketch.choices import SketchChoices
from usdfoliage.sketch.strokes import find_strokes


def read_sketch_request(options: argparse.Namespace) -> SketchRequest:
    """The request that a command line makes; FoliageError for values that cannot be."""
    if options.species_file is not None and not options.species:
        raise FoliageError("--species-file holds species", "name with --species which one is meant")
    if not 1 <= options.max_leaves <= MAX_LEAVES:
        raise FoliageError(f"--most-leaves must be 1 to {MAX_LEAVES:,}, not {options.max_leaves}")
    if options.max_faces < MIN_MAX_FACES:
        raise FoliageError(f"--most-faces must be at least {MIN_MAX_FACES:,}, not {options.max_faces}")
    tape = options.tape
    if tape is not None and not (all(map(math.isfinite, tape)) and tape[4] > 0 and tape[:2] != tape[2:4]):
        raise FoliageError("--tape must be two places of the photograph, and the metres between them, above 0")
    choices = SketchChoices(
        height_m=options.height,
        depth=options.depth,
        density=options.density,
        gravity=options.gravity,
        leaf_length_m=options.leaf_length,
        seed=options.seed,
    )
    strokes = options.strokes or find_strokes(options.photo)
    return SketchRequest(
        photo=options.photo,
        strokes=strokes,
        mask=options.mask,
        output=options.output,
        name=asset_name(options.name or options.output.resolve().name),
        tape_m=None if tape is None else tuple(tape),
        color_space=options.color_space,
        species=options.species,
        leaf=options.leaf,
        settings=SketchModelSettings(
            species=load_species(options.species or GENERIC, options.species_file),
            max_leaves=options.max_leaves,
            max_faces=options.max_faces,
            representations=read_representations(options.representation) if options.representation else None,
            has_leaves=HAS_LEAVES[options.leaves],
            has_crown=not options.no_crown,
            motion=read_motion(options),
        ),
        choices=choices,
        force=options.force,
        keep_old=options.keep_old,
        preview=not options.no_preview,
        times=not options.reproducible,
        render_setting=render_for("sketch"),
    )
