"""What the options of usdfoliage leaves set, checked."""

import argparse
import dataclasses
import logging

import numpy as np

from usdfoliage.asset.leaf_representations import read_representations
from usdfoliage.asset.plant import asset_name
from usdfoliage.capture.folder.hold_back import check_hold_back
from usdfoliage.cli.options.leaf_commands import name_option
from usdfoliage.cli.remarks import LEAVES_OF_A_CLOUD, render_for
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.leaves.cloud_run import names_cloud
from usdfoliage.jobs.leaves.request import LeavesRequest
from usdfoliage.jobs.leaves.run import ESTIMATED
from usdfoliage.jobs.leaves.settings import LeavesRunSettings
from usdfoliage.jobs.plant_cloud import read_unit, read_up
from usdfoliage.jobs.work.settings_file import AUTO, read_settings_file, set_everywhere
from usdfoliage.remarks import Setting

logger = logging.getLogger(__name__)

_OLD_ESTIMATED = "sweep"


def read_leaves_request(options: argparse.Namespace) -> LeavesRequest:
    """The request that a command line makes; FoliageError for values that cannot be."""
    if options.capture is None:
        raise FoliageError(
            "no capture is named", "give its folder or a cloud's file, as in: usdfoliage leaves CAPTURE -o OUT"
        )
    if options.output is None:
        raise FoliageError("no output is named", "give the asset's folder with -o OUT")
    if options.report_views < 0:
        raise FoliageError(f"--report-views must be 0 or more, not {options.report_views}")
    _check_kind(options)
    return LeavesRequest(
        capture=options.capture,
        output=options.output,
        name=asset_name(options.name or options.output.resolve().name),
        settings=read_leaves_settings(options),
        depth=_read_depth(options.depth),
        views=options.views,
        hold_back=_read_hold_back(options.hold_back),
        representations=read_representations(options.representation) if options.representation else None,
        up=name_option(read_up, options.up),
        unit=name_option(read_unit, options.unit),
        species=options.species,
        seed=options.seed or 0,
        report_views=options.report_views,
        preview=not options.no_preview,
        times=not options.reproducible,
        force=options.force,
        keep_old=options.keep_old,
        render_setting=render_for(LEAVES_OF_A_CLOUD if names_cloud(options.capture) else "leaves"),
    )


def _read_depth(words: str) -> str:
    """The word or folder of --depth; the old word for depth of photographs counts for one more version."""
    if words != _OLD_ESTIMATED:
        return words
    logger.warning("--depth %s is called %s now, and the next version will not know the old word", words, ESTIMATED)
    return ESTIMATED


def _read_hold_back(every: int) -> int:
    try:
        check_hold_back(every)
    except ValueError as error:
        raise FoliageError(f"--hold-back: {error}") from error
    return every


def _check_kind(options: argparse.Namespace) -> None:
    """FoliageError for options of photographs where the input is a cloud alone, and the other way round."""
    is_cloud = names_cloud(options.capture)
    of_photographs = {
        "--depth": options.depth != LeavesRequest.depth,
        "--views": options.views is not None,
        "--method": options.method is not None,
        "--plane-threshold": options.plane_threshold is not None,
    }
    of_clouds = {"--up": options.up != AUTO, "--unit": options.unit != AUTO}
    for name, is_given in (of_photographs if is_cloud else of_clouds).items():
        if is_given:
            kind, other = ("a cloud alone", "photographs") if is_cloud else ("photographs", "a cloud alone")
            raise FoliageError(f"{name} is for {other}, and {options.capture} is {kind}", f"leave {name} out")


def read_leaves_settings(options: argparse.Namespace) -> LeavesRunSettings:
    """The settings of a command line: the defaults, then the file of --settings, then the options.

    Raises:
        FoliageError: A value cannot be, or the file cannot be used.
    """
    settings = LeavesRunSettings()
    if options.settings is not None:
        settings = read_settings_file(options.settings, settings)
    if options.seed is not None and not 0 <= options.seed < 2**63:  # an asset records it as int64
        raise FoliageError(f"the seed must be 0 or more and below 2^63, not {options.seed}")
    if options.method is not None:
        settings = dataclasses.replace(settings, method=options.method)
    if options.min_confidence is not None:
        try:
            settings = dataclasses.replace(settings, min_confidence=options.min_confidence)
        except ValueError as error:
            remedy = ("give another number with ", Setting(name="leaves.min_confidence"))
            raise FoliageError(str(error), remedy) from error
    if options.plane_threshold is not None:
        settings = set_everywhere(settings, "plane_threshold_m", _read_plane_threshold(options.plane_threshold))
    if options.threads is not None:
        if options.threads < 0:
            raise FoliageError(f"--threads must be 0, for all cores, or more, not {options.threads}")
        settings = set_everywhere(settings, "threads", options.threads)
    return settings if options.seed is None else set_everywhere(settings, "seed", options.seed)


def _read_plane_threshold(words: str) -> float | None:
    if words == AUTO:
        return None
    try:
        number = float(words)
    except ValueError:
        number = float("nan")
    if not (np.isfinite(number) and number > 0):
        raise FoliageError(f"--plane-threshold must be a number of metres above 0, or {AUTO}, not {words}")
    return number
