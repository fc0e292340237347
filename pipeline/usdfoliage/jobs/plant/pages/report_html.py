"""The quality report of a whole plant as a page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from usdfoliage.asset.publish_file import publish_text
from usdfoliage.asset.validation.findings import SEVERITIES, Finding
from usdfoliage.jobs.plant.pages.report import (
    Comparison,
    Picture,
    PlantReport,
    StageReport,
    State,
    Variant,
    is_unusable,
    judge,
)
from usdfoliage.jobs.report.page import render_page
from usdfoliage.jobs.report.page_pictures import PagePicture, embed_picture
from usdfoliage.jobs.report.timings import TIMINGS

TURNTABLE_PX = 640
COMPARISON_PX = 1100
STAGE_PX = 1000
VARIANT_PX = 420
LISTED_FINDINGS = 200


@dataclass(frozen=True, kw_only=True)
class _Picture:
    """A picture with its caption."""

    picture: PagePicture
    caption: str


@dataclass(frozen=True, kw_only=True)
class _VariantRow:
    variant: Variant
    drawn: _Picture | None


@dataclass(frozen=True, kw_only=True)
class _ComparisonRow:
    comparison: Comparison
    photograph: PagePicture
    drawing: PagePicture


@dataclass(frozen=True, kw_only=True)
class _StageRow:
    stage: StageReport
    pictures: Sequence[_Picture]


@dataclass(frozen=True, kw_only=True)
class _Count:
    """How many findings of a severity are open, and how many were accepted."""

    severity: str
    open: int
    accepted: int


@dataclass(frozen=True, kw_only=True)
class _Badge:
    """What stands beside the name."""

    kind: State  # whose colours it has
    words: str


def write_plant_report(folder: Path, report: PlantReport) -> Path:
    """Write index.html into folder, which is made if need be; returns the page.

    It is one file, with all pictures in it, and the same bytes for the same report. A missing
    picture is reported in its place.

    Raises:
        WriteError: The page cannot be written; what was there is unchanged.
    """
    sets: dict[str, list[_VariantRow]] = {}
    for variant in report.variants:
        picture = None if variant.picture is None else _show(variant.picture, VARIANT_PX)
        sets.setdefault(variant.set, []).append(_VariantRow(variant=variant, drawn=picture))
    stages = [
        _StageRow(stage=stage, pictures=[_show(picture, STAGE_PX) for picture in stage.pictures])
        for stage in report.stages
    ]
    page = render_page(
        "plant.html",
        "plant.css",
        "plant.js",
        report=report,
        verdict=judge(report),
        badge=_choose_badge(report),
        # Python sorts stably: within a kind, the order of the stages.
        warnings=sorted(report.warnings, key=lambda warning: not warning.severe),
        anchors={stage.title: number for number, stage in enumerate(report.stages)},
        frames=[drawn for frame in report.turntable if (drawn := embed_picture(frame, TURNTABLE_PX)).uri],
        sets=sets,
        comparisons=[_show_comparison(comparison) for comparison in report.comparisons],
        stages=stages,
        counts=count_findings(report.findings),
        open_findings=[finding for finding in report.findings if not finding.accepted],
        accepted_findings=[finding for finding in report.findings if finding.accepted],
        max_findings=LISTED_FINDINGS,
        total_bytes=sum(file.size_bytes for file in report.files),
        changed=sum(line.changed for picture in report.settings for line in picture.lines),
        timings=TIMINGS,
    )
    index = folder / "index.html"
    publish_text(index, page)
    return index


def count_findings(findings: Sequence[Finding]) -> list[_Count]:
    """By severity, the worst first."""
    counts = []
    for severity in SEVERITIES:
        of_severity = [finding for finding in findings if finding.severity == severity]
        accepted = sum(bool(finding.accepted) for finding in of_severity)
        counts.append(_Count(severity=severity, open=len(of_severity) - accepted, accepted=accepted))
    return counts


def _choose_badge(report: PlantReport) -> _Badge:
    if report.state == "failed":
        return _Badge(kind="failed", words="failed")
    if is_unusable(report):
        return _Badge(kind="failed", words="built, not usable")
    if report.state == "warnings" or report.warnings:
        return _Badge(kind="warnings", words="built, with warnings")
    return _Badge(kind=report.state, words="built" if report.state == "done" else report.state)


def _show(picture: Picture, longest_px: int) -> _Picture:
    return _Picture(picture=embed_picture(picture.image, longest_px), caption=picture.caption)


def _show_comparison(comparison: Comparison) -> _ComparisonRow:
    return _ComparisonRow(
        comparison=comparison,
        photograph=embed_picture(comparison.photograph, COMPARISON_PX),
        drawing=embed_picture(comparison.drawing, COMPARISON_PX),
    )
