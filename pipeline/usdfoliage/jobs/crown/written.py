"""What the commands of crowns have made."""

from dataclasses import dataclass
from pathlib import Path

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
