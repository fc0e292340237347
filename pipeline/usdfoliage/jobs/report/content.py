"""What the report of one part of a plant has besides the part itself."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from usdfoliage.jobs.report.table import ReportView
from usdfoliage.remarks import Remark, RenderSetting


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportContent:
    """What the report has besides what it is about."""

    name: str
    capture: str
    generator: str
    remarks: Sequence[Remark]  # what the reader should know first
    render_setting: RenderSetting
    settings: Mapping[str, str]
    views: Sequence[ReportView]
    seconds: Mapping[str, float]  # by step; none where the report does not show them
