"""What the options of usdfoliage crown set, checked."""

import argparse

import numpy as np

from usdfoliage.asset.packages.leaf_package import AssetSettings
from usdfoliage.asset.plant import asset_name
from usdfoliage.cli.options.leaf_commands import name_option
from usdfoliage.cli.remarks import render_for
from usdfoliage.crown.reconstruct import CapturedCrownSettings
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.crown.photograph import CrownSettings
from usdfoliage.jobs.crown.run_capture import CapturedCrownRequest
from usdfoliage.jobs.crown.run_photograph import CrownRequest
from usdfoliage.jobs.crown.tangent import read_tangent
from usdfoliage.jobs.plant_cloud import PlantCloudRequest, read_roots, read_unit, read_up
from usdfoliage.jobs.work.settings_file import AUTO

# Of the command line: options that only a photograph has, those that only a capture has, and their defaults.
PHOTO_OPTIONS: dict[str, object] = {
    "mask": None,
    "height": CrownSettings.height_m,
    "tangent": AUTO,
    "relief": CrownSettings.relief,
    "laplacian": CrownSettings.band_pass,
    "copies": CrownSettings.copies,
    "color_space": None,
}
CAPTURE_OPTIONS: dict[str, object] = {
    "roots": AUTO,
    "up": AUTO,
    "unit": AUTO,
    "report_views": CapturedCrownRequest.report_views,
}


def read_crown_request(options: argparse.Namespace) -> CrownRequest:
    """The request of a photograph; FoliageError for values that cannot be."""
    refuse_options(options, CAPTURE_OPTIONS, f"{options.photo} is no folder and no cloud, and taken for a photograph")
    tangent = name_option(read_tangent, options.tangent)
    try:
        settings = CrownSettings(
            size=options.size,
            height_m=options.height,
            tangent=tangent if isinstance(tangent, float) else None,
            relief=options.relief,
            band_pass=options.laplacian,
            copies=options.copies,
            seed=options.seed,
            threads=options.threads,
        )
        asset_settings = AssetSettings(crown_mesh_size=options.mesh_size)
    except ValueError as error:
        raise FoliageError(str(error)) from error
    return CrownRequest(
        photo=options.photo,
        mask=options.mask,
        output=options.output,
        name=asset_name(options.name or options.output.resolve().name),
        settings=settings,
        tangent=options.tangent,
        tangent_map=tangent if isinstance(tangent, np.ndarray) else None,
        asset_settings=asset_settings,
        leaf=options.leaf,
        color_space=options.color_space,
        species=options.species,
        force=options.force,
        keep_old=options.keep_old,
        preview=not options.no_preview,
        times=not options.reproducible,
        render_setting=render_for("crown"),
    )


def read_captured_crown_request(options: argparse.Namespace) -> CapturedCrownRequest:
    """The request of a capture or a cloud; FoliageError for values that cannot be."""
    kind = "a folder: a capture" if options.photo.is_dir() else "a cloud"
    refuse_options(options, PHOTO_OPTIONS, f"{options.photo} is {kind}, not one photograph")
    if not options.photo.is_dir():
        text = f"{options.photo} is a cloud alone, without photographs"
        refuse_options(options, {"report_views": CAPTURE_OPTIONS["report_views"]}, text)
    roots, given = name_option(read_roots, options.roots)
    if options.report_views < 0:
        raise FoliageError(f"--report-views must be 0 or more, not {options.report_views}")
    try:
        settings = CapturedCrownSettings(size=options.size, seed=options.seed, threads=options.threads)
        asset_settings = AssetSettings(crown_mesh_size=options.mesh_size)
    except ValueError as error:
        raise FoliageError(str(error)) from error
    return CapturedCrownRequest(
        cloud=PlantCloudRequest(
            path=options.photo,
            roots=roots,
            given_roots=given,
            up=name_option(read_up, options.up),
            unit=name_option(read_unit, options.unit),
        ),
        output=options.output,
        name=asset_name(options.name or options.output.resolve().name),
        settings=settings,
        asset_settings=asset_settings,
        leaf=options.leaf,
        species=options.species,
        force=options.force,
        keep_old=options.keep_old,
        preview=not options.no_preview,
        times=not options.reproducible,
        report_views=options.report_views,
        render_setting=render_for("crown"),
    )


def refuse_options(options: argparse.Namespace, others: dict[str, object], text: str) -> None:
    """FoliageError for an option that is given and has no meaning for what is read."""
    given = [name for name, default in others.items() if getattr(options, name, default) != default]
    if given:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise FoliageError(f"{text}", f"{names} {'has' if len(given) == 1 else 'have'} no meaning there: leave it out")
