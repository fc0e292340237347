"""What the user asks of a scan with leaves."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.parts.lobed_leaf import LobedAssetSettings
from usdfoliage.jobs.lobed.pieces import PieceSettings
from usdfoliage.leaf.lobed.model import LobedLeafSettings
from usdfoliage.remarks import RenderSetting, as_plan_setting

DEFAULT_HEIGHT_M = 0.1
METRES_PER_INCH = 0.0254


@dataclass(frozen=True, kw_only=True)
class LeafSize:
    """How large leaves are: by one of these, or none of them."""

    dpi: float | None = None  # pixels an inch of the scan
    width_m: float | None = None  # of the largest leaf in the picture
    height_m: float | None = None

    def __post_init__(self) -> None:
        stated = [(name, value) for name, value in vars(self).items() if value is not None]
        if len(stated) > 1:
            raise ValueError("the size of leaves is stated by one of dpi, width and height, not by several")
        for name, value in stated:
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name.removesuffix('_m')} must be above 0, not {value:g}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LobedRequest:
    """A scan, and what is made of it."""

    scan: Path
    mask: Path | None = None
    output: Path
    name: str
    size: LeafSize = LeafSize()
    model: LobedLeafSettings = field(default_factory=LobedLeafSettings)
    pieces: PieceSettings = field(default_factory=PieceSettings)
    asset_settings: LobedAssetSettings = field(default_factory=LobedAssetSettings)
    color_space: str | None = None
    species: str = ""
    seed: int = 0
    force: bool = False
    keep_old: bool = False  # what is replaced stays in a folder beside the new asset
    preview: bool = True
    times: bool = True  # whether the report shows how long each step took
    render_setting: RenderSetting = as_plan_setting  # how the report writes settings

    def __post_init__(self) -> None:
        if not 0 <= self.seed < 2**63:  # an asset records it as int64
            raise ValueError(f"the seed must be 0 or positive and below 2^63, not {self.seed}")

    def origin_of(self, name: str) -> AssetOrigin:
        """Of the asset of one leaf."""
        return AssetOrigin(name=name, command="lobed", source=self.scan.resolve().name)
