"""Everything that decides which leaves of a capture are found."""

from dataclasses import dataclass, field

from usdfoliage.capture.mvs.plane_sweep import PlaneSweepSettings
from usdfoliage.leaf.reconstruct import ReconstructionSettings


@dataclass(frozen=True, kw_only=True)
class LeavesSettings(ReconstructionSettings):
    """Everything that decides the leaves of a capture."""

    sweep: PlaneSweepSettings = field(default_factory=PlaneSweepSettings)  # of captures without depth
