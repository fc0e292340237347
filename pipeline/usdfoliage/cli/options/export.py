"""What the options of usdfoliage export set, checked."""

import argparse

from usdfoliage.cli.options.leaf_commands import read_resolution
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.export.request import ExportRequest, ExportSettings


def read_export_request(options: argparse.Namespace) -> ExportRequest:
    """The request that a command line makes; FoliageError for values that cannot be."""
    try:
        settings = ExportSettings(lod=options.lod, leaves=options.leaves, shapes=options.shapes, sides=options.sides)
    except ValueError as error:
        raise FoliageError(f"--{error}") from error
    return ExportRequest(
        asset=options.asset,
        output=options.output,
        profile=options.profile,
        name=options.name,
        resolution=read_resolution(options),
        settings=settings,
        force=options.force,
        keep_old=options.keep_old,
    )
