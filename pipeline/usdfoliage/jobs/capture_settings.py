"""What a user says of how photographs become a cloud, checked."""

import argparse
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from usdfoliage.capture.clear_sky import ClearSkySettings
from usdfoliage.capture.cloud import CloudSettings
from usdfoliage.capture.dense_depth import DenseDepthSettings, Quality, Round
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.leaves_settings import set_everywhere
from usdfoliage.jobs.settings_file import read_settings_file

DenseChoice = Literal["own", "colmap"]
MaskChoice = Literal["auto", "given", "none"]


@dataclass(frozen=True, kw_only=True)
class CaptureRunSettings:
    """Everything that decides the cloud of a capture."""

    dense: DenseChoice = "own"  # colmap: by COLMAP's PatchMatch, which needs CUDA
    mask: MaskChoice = "auto"  # given masks, and without one the sky is left out; given: only those; none: nothing is
    sky: ClearSkySettings = field(default_factory=ClearSkySettings)
    depth: DenseDepthSettings = field(default_factory=DenseDepthSettings)
    cloud: CloudSettings = field(default_factory=CloudSettings)


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
NORMAL: Quality = "normal"
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
    if options.dense is not None:
        settings = dataclasses.replace(settings, dense=options.dense)
    if options.seed is not None:
        if not 0 <= options.seed < 2**31:  # that of OpenCV and COLMAP is an int
            raise FoliageError(f"the seed must be 0 or more and below 2^31, not {options.seed}")
        settings = set_everywhere(settings, "seed", options.seed)
    return settings
