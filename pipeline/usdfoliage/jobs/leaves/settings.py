"""Everything that decides which leaves of a capture are found."""

from dataclasses import dataclass, field

from usdfoliage.capture.mvs.view_depths import PhotographDepthSettings
from usdfoliage.leaf.reconstruct import ReconstructionSettings
from usdfoliage.leaf.reconstruct_cloud import CloudReconstructionSettings


@dataclass(frozen=True, kw_only=True)
class LeavesSettings(ReconstructionSettings):
    """Everything that decides the leaves of a capture with depth, and of a cloud."""

    cloud: CloudReconstructionSettings = field(default_factory=CloudReconstructionSettings)  # of clouds alone


@dataclass(frozen=True, kw_only=True)
class LeavesRunSettings(LeavesSettings):
    """The same where leaves are found without a build, which has a stage for depth."""

    capture: PhotographDepthSettings = field(default_factory=PhotographDepthSettings)  # of captures without depth
