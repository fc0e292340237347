"""What a user asks for of the leaves of photographs, or of a cloud."""

from dataclasses import dataclass
from pathlib import Path

from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.jobs.leaves.settings import LeavesRunSettings
from usdfoliage.remarks import RenderSetting, as_plan_setting


@dataclass(frozen=True, kw_only=True)
class LeavesRequest:
    """What the user asked for, checked."""

    capture: Path
    output: Path
    name: str
    settings: LeavesRunSettings
    depth: str = "auto"
    views: str | None = None  # None: all
    hold_back: int = 0  # of every so many photographs one makes nothing, and measures the asset; 0: of none
    representations: tuple[str, ...] | None = None  # None: as many as the number of leaves allows
    up: str | None = None  # an axis of the cloud, where leaves are found in one alone; None: estimated
    unit: str | None = None  # of such a cloud, of UNITS; None: read from the file
    species: str = ""
    seed: int = 0
    report_views: int = 12
    preview: bool = True
    times: bool = True  # whether the report lists how long each step took
    force: bool = False
    keep_old: bool = False  # what is replaced stays in a folder beside the new asset
    render_setting: RenderSetting = as_plan_setting  # how the report writes settings

    @property
    def origin(self) -> AssetOrigin:
        """Of the asset."""
        return AssetOrigin(name=self.name, command="leaves", source=self.capture.resolve().name)
