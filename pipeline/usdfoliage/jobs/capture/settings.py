"""What a user says of how photographs become a cloud, checked."""

import argparse
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from usdfoliage.capture.clear_sky import ClearSkySettings
from usdfoliage.capture.cloud.cleaning import CleaningSettings
from usdfoliage.capture.cloud.fusion import CloudSettings
from usdfoliage.capture.cloud.visibility import VisibilitySettings
from usdfoliage.capture.mvs.rounds import DenseDepthSettings, Quality, Round
from usdfoliage.capture.poses.register import RegistrationSettings
from usdfoliage.capture.poses.world_frame import UPS, KnownDistance, WorldSettings
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.work.settings_file import read_settings_file, set_everywhere

DenseChoice = Literal["own", "colmap"]
PosesChoice = Literal["auto", "known", "estimate"]
DoubtfulPoses = Literal["stop", "use"]
MaskChoice = Literal["auto", "given", "none"]


@dataclass(frozen=True, kw_only=True)
class CaptureRunSettings:
    """Everything that decides the cloud of a capture."""

    # known takes the cameras of the folder cameras/; estimated finds them from the photographs; auto takes known ones
    # where the folder is there.
    poses: PosesChoice = "auto"
    # stop ends the run where estimated poses are probably wrong; use goes on with them.
    doubtful_poses: DoubtfulPoses = "stop"
    # own matches photographs with the project's PatchMatch; colmap runs that of COLMAP, which needs CUDA.
    dense: DenseChoice = "own"
    # given uses the masks of the folder masks/ alone; auto also leaves out the sky where a photograph has no mask;
    # none uses no mask.
    mask: MaskChoice = "auto"
    sky: ClearSkySettings = field(default_factory=ClearSkySettings)
    registration: RegistrationSettings = field(default_factory=RegistrationSettings)  # of poses that are estimated
    world: WorldSettings = field(default_factory=WorldSettings)  # likewise
    depth: DenseDepthSettings = field(default_factory=DenseDepthSettings)
    cloud: CloudSettings = field(default_factory=CloudSettings)
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)
    cleaning: CleaningSettings = field(default_factory=CleaningSettings)


PRESETS: Mapping[Quality, CaptureRunSettings] = {
    "draft": CaptureRunSettings(
        depth=DenseDepthSettings(
            max_side_px=600,
            sources=5,
            rounds=(
                Round(level=1, iterations=4, coherent=False),
                Round(level=0, iterations=2, coherent=False),
                Round(level=0, iterations=1, coherent=True, segments=True),
            ),
        )
    ),
    "normal": CaptureRunSettings(),
    "high": CaptureRunSettings(depth=DenseDepthSettings(max_side_px=2400, sources=9)),
}
_ONE_CAMERA = {"one": "yes", "several": "no", "auto": "auto"}
QUALITIES: tuple[Quality, ...] = get_args(Quality)


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
        settings = _set_registration(settings, matching=options.matching)
    if options.camera is not None:
        settings = _set_registration(settings, one_camera=_ONE_CAMERA[options.camera])
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


def _set_registration(settings: CaptureRunSettings, **changes: Any) -> CaptureRunSettings:
    return dataclasses.replace(settings, registration=dataclasses.replace(settings.registration, **changes))


def _set_world(settings: CaptureRunSettings, **changes: Any) -> CaptureRunSettings:
    try:
        return dataclasses.replace(settings, world=dataclasses.replace(settings.world, **changes))
    except ValueError as error:
        raise FoliageError(f"--scale or --up: {error}") from error


def _read_scale(words: str) -> dict[str, Any]:
    """How many times as large, or two photographs and the metres between their cameras."""
    *photographs, number = words.rsplit(",", 2)
    try:
        value = float(number)
        if len(photographs) == 2:
            known = KnownDistance(photographs=(photographs[0].strip(), photographs[1].strip()), metres=value)
            return {"known_distance": known, "scale_bar": None}
    except ValueError as error:
        raise FoliageError(f"--scale: {error}") from error
    if photographs:
        raise FoliageError(f"--scale takes a factor, or PHOTO,PHOTO,METRES, not {words}")
    return {"times": value}


def _read_up(words: str) -> dict[str, Any]:
    """A way of finding up, or its direction in the world as it is without it."""
    if words in UPS:
        return {"up": words, "up_vector": None}
    try:
        x, y, z = (float(number) for number in words.split(","))
    except ValueError as error:
        raise FoliageError(f"--up takes {', '.join(UPS)}, or X,Y,Z, not {words}") from error
    return {"up": "auto", "up_vector": (x, y, z)}
