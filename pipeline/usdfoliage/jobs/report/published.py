"""What a command has put in its place."""

from dataclasses import dataclass
from pathlib import Path

from usdfoliage.jobs.report.table import Row
from usdfoliage.remarks import Remark


@dataclass(frozen=True, kw_only=True)
class PublishedAsset:
    """An asset in its place, and what the user should know of it."""

    asset: Path
    report: Path
    preview: Path | None
    remarks: tuple[Remark, ...]
    rows: tuple[Row, ...]
