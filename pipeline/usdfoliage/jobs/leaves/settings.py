"""Everything that decides which leaves of a capture are found."""

from dataclasses import dataclass, field

from usdfoliage.capture.mvs.plane_sweep import PlaneSweepSettings
from usdfoliage.leaf.reconstruct import ReconstructionSettings
from usdfoliage.leaf.reconstruct_cloud import CloudReconstructionSettings


@dataclass(frozen=True, kw_only=True)
class LeavesSettings(ReconstructionSettings):
    """Everything that decides the leaves of a capture."""

    sweep: PlaneSweepSettings = field(default_factory=PlaneSweepSettings)  # of captures without depth
    cloud: CloudReconstructionSettings = field(default_factory=CloudReconstructionSettings)  # of clouds alone
