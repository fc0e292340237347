"""What the options of usdfoliage scatter set, checked."""

import argparse

from usdfoliage.asset.leaf_representations import (
    check_memory,
    default_representations,
    read_representations,
    read_settings,
)
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.asset.plant import asset_name
from usdfoliage.cli.options.leaf_commands import name_option, read_resolution
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.edits.given_pictures import check_pictures
from usdfoliage.jobs.edits.scatter import ScatterRequest, check_count, read_color, read_spray


def read_scatter_request(options: argparse.Namespace) -> ScatterRequest:
    """The request that a command line makes; FoliageError for values that cannot be."""
    check_count(options.count)
    if not 0 <= options.seed < 2**63:  # an asset records it as int64
        raise FoliageError(f"the seed must be 0 or more and below 2^63, not {options.seed}")
    default = default_representations(options.count)
    representations = read_representations(options.representation or default)
    appearance = LeafAppearance(
        color=read_color(options.color, "--color") if options.color else LeafAppearance().color,
        texture=options.texture,
        jitter_map=options.jitter_map,
    )
    check_pictures(appearance.texture, appearance.jitter_map)
    settings = read_settings(representations, read_resolution(options))
    check_memory(options.count, settings)
    return ScatterRequest(
        count=options.count,
        output=options.output,
        name=asset_name(options.name or options.output.resolve().name),
        seed=options.seed,
        spray=name_option(lambda length_m: read_spray(length_m, options.variation), options.length),
        settings=settings,
        appearance=appearance,
        chosen=options.representation is not None,
        force=options.force,
        keep_old=options.keep_old,
    )
