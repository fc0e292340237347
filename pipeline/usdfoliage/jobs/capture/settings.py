"""What a user sets of how photographs become a cloud, checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from usdfoliage.capture.cloud.cleaning import CleaningSettings
from usdfoliage.capture.cloud.fusion import CloudSettings
from usdfoliage.capture.cloud.visibility import VisibilitySettings
from usdfoliage.capture.mvs.rounds import MvsSettings, Quality, Round
from usdfoliage.capture.mvs.view_depths import PhotographDepthSettings
from usdfoliage.capture.poses.settings import PoseEstimationSettings
from usdfoliage.capture.poses.world_frame import WorldSettings
from usdfoliage.capture.video.settings import VideoSettings

DenseChoice = Literal["own", "colmap"]
PosesChoice = Literal["auto", "known", "estimate"]
UncertainPoses = Literal["stop", "use"]


@dataclass(frozen=True, kw_only=True)
class CaptureRunSettings(PhotographDepthSettings):
    """Everything that decides the cloud of a capture."""

    video: VideoSettings = field(default_factory=VideoSettings)
    # known takes the cameras of the folder cameras/; estimate finds them from the photographs; auto takes known ones
    # where the folder is there.
    poses: PosesChoice = "auto"
    # stop ends the run where estimated poses are probably wrong; use goes on with them.
    uncertain_poses: UncertainPoses = "stop"
    # own matches photographs with the project's PatchMatch; colmap runs that of COLMAP, which needs CUDA.
    dense: DenseChoice = "own"
    pose_estimation: PoseEstimationSettings = field(
        default_factory=PoseEstimationSettings
    )  # of poses that are estimated
    world: WorldSettings = field(default_factory=WorldSettings)  # likewise
    cloud: CloudSettings = field(default_factory=CloudSettings)
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)
    cleaning: CleaningSettings = field(default_factory=CleaningSettings)


PRESETS: Mapping[Quality, CaptureRunSettings] = {
    "draft": CaptureRunSettings(
        depth=MvsSettings(
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
    "high": CaptureRunSettings(depth=MvsSettings(max_side_px=2400, sources=9)),
}
QUALITIES: tuple[Quality, ...] = get_args(Quality)
