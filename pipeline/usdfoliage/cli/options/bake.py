"""What the options of usdfoliage bake set, checked."""

import argparse

from usdfoliage.asset.leaf_representations import read_representations
from usdfoliage.cli.options.leaf_commands import read_resolution
from usdfoliage.jobs.edits.bake import BakeRequest


def read_bake_request(options: argparse.Namespace) -> BakeRequest:
    """The request that a command line makes; FoliageError for values that cannot be."""
    chosen = read_representations(options.representation) if options.representation else None
    return BakeRequest(
        asset=options.asset,
        output=options.output,
        name=options.name,
        representations=chosen,
        resolution=read_resolution(options),
        source=options.source,
        force=options.force,
        keep_old=options.keep_old,
    )
