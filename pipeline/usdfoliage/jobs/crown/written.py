"""What the commands of crowns have made."""

from dataclasses import dataclass
from pathlib import Path

from usdfoliage.asset.packages.leaf_package import AssetSettings
from usdfoliage.jobs.report.table import Row
from usdfoliage.remarks import Remark


@dataclass(frozen=True, kw_only=True)
class WrittenCrown:
    """What was written, and what the user should know of it."""

    asset: Path
    report: Path
    preview: Path | None
    remarks: tuple[Remark, ...]
    measures: tuple[Row, ...]


def describe_mesh_size(settings: AssetSettings, map_size: int) -> str:
    """The option --mesh-size that gives the same mesh again; auto where it is chosen by the silhouettes."""
    return "auto" if settings.crown_mesh_size is None else str(min(settings.crown_mesh_size, map_size))
