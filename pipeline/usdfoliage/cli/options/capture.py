"""What the options of usdfoliage capture set, checked."""

import argparse
import dataclasses
from typing import Any

from usdfoliage.capture.poses.world_frame import UPS, KnownDistance
from usdfoliage.cli.remarks import render_for
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.capture.run import CaptureRequest
from usdfoliage.jobs.capture.settings import PRESETS, CaptureRunSettings
from usdfoliage.jobs.work.settings_file import read_settings_file, set_everywhere

_ONE_CAMERA = {"one": "yes", "several": "no", "auto": "auto"}


def read_capture_request(options: argparse.Namespace) -> CaptureRequest:
    """The request that a command line makes.

    Raises:
        FoliageError: A value cannot be, or the file of settings cannot be used.
    """
    if options.source is None:
        raise FoliageError("no photographs are named", "give their folder, as in: usdfoliage capture PHOTOS -o CAPTURE")
    if options.resume and options.fresh:
        raise FoliageError("--resume goes on with an earlier run and --fresh forgets it", "use one of them")
    if options.threads is not None and options.threads < 0:
        raise FoliageError(f"--threads must be 0, for all cores, or more, not {options.threads}")
    if options.report_views < 0:
        raise FoliageError(f"--report-views must be 0 or more, not {options.report_views}")
    return CaptureRequest(
        source=options.source,
        output=options.output,
        settings=read_capture_run_settings(options),
        views=options.views,
        resume=options.resume,
        fresh=options.fresh,
        threads=options.threads or 0,
        report=not options.no_report,
        report_views=options.report_views,
        force=options.force,
        times=not options.reproducible,
        render_setting=render_for("capture"),
    )


def read_capture_run_settings(options: argparse.Namespace) -> CaptureRunSettings:
    """The settings of a command line: those of --quality, then the file of --settings, then the options.

    Raises:
        FoliageError: A value cannot be, or the file cannot be used.
    """
    settings = PRESETS[options.quality]
    if options.settings is not None:
        settings = read_settings_file(options.settings, settings)
    if options.mask is not None:
        settings = dataclasses.replace(settings, mask=options.mask)
    if options.poses is not None:
        settings = dataclasses.replace(settings, poses=options.poses)
    if options.matching is not None:
        settings = _set_pose_estimation(settings, matching=options.matching)
    if options.camera is not None:
        settings = _set_pose_estimation(settings, one_camera=_ONE_CAMERA[options.camera])
    if options.scale is not None:
        settings = _set_world(settings, **_read_scale(options.scale))
    if options.up is not None:
        settings = _set_world(settings, **_read_up(options.up))
    if options.dense is not None:
        settings = dataclasses.replace(settings, dense=options.dense)
    if options.seed is not None:
        if not 0 <= options.seed < 2**31:  # that of OpenCV and COLMAP is an int
            raise FoliageError(f"the seed must be 0 or more and below 2^31, not {options.seed}")
        settings = set_everywhere(settings, "seed", options.seed)
    return settings


def _set_pose_estimation(settings: CaptureRunSettings, **changes: Any) -> CaptureRunSettings:
    return dataclasses.replace(settings, pose_estimation=dataclasses.replace(settings.pose_estimation, **changes))


def _set_world(settings: CaptureRunSettings, **changes: Any) -> CaptureRunSettings:
    try:
        return dataclasses.replace(settings, world=dataclasses.replace(settings.world, **changes))
    except ValueError as error:
        raise FoliageError(f"--scale or --up: {error}") from error


def _read_scale(text: str) -> dict[str, Any]:
    """How many times as large, or two photographs and the metres between their cameras."""
    *photographs, number = text.rsplit(",", 2)
    try:
        value = float(number)
        if len(photographs) == 2:
            known = KnownDistance(photographs=(photographs[0].strip(), photographs[1].strip()), metres=value)
            return {"known_distance": known, "scale_bar": None}
    except ValueError as error:
        raise FoliageError(f"--scale: {error}") from error
    if photographs:
        raise FoliageError(f"--scale takes a factor, or PHOTO,PHOTO,METRES, not {text}")
    return {"times": value}


def _read_up(text: str) -> dict[str, Any]:
    """A method of finding up, or its direction in the world as it is without it."""
    if text in UPS:
        return {"up": text, "up_vector": None}
    try:
        x, y, z = (float(number) for number in text.split(","))
    except ValueError as error:
        raise FoliageError(f"--up takes {', '.join(UPS)}, or X,Y,Z, not {text}") from error
    return {"up": "auto", "up_vector": (x, y, z)}
