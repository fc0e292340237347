"""What the reports of leaves share, whether they were found in photographs or in a cloud: figures, bars, the page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.jobs.leaves.pictures import SURE
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.table import Histogram, ReportPhotograph, ReportPicture, Row
from usdfoliage.jobs.report.timings import write_step_times
from usdfoliage.jobs.withheld.measure import MeasuredAsset
from usdfoliage.leaf.model import Leaves, count_origins, describe_origins, mean_leaf
from usdfoliage.leaf.segmentation.model import Step
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.remarks import Remark, RenderSetting, list_sentences

BINS = 30
MEAN_LEAF_PX = 320  # from base to apex


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportFrame:
    """What a report states of the run."""

    name: str  # of the asset
    source: str  # the capture, or the file of the cloud
    generator: str
    remarks: Sequence[Remark]  # what the reader should know first
    render_setting: RenderSetting
    settings: Mapping[str, str]
    seconds: Mapping[str, float]  # by step; none where the report does not list them


@dataclass(frozen=True, kw_only=True)
class Line:
    """A polyline of a drawing."""

    points: str
    color: str
    width: float


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """Lines in a box (left, top, width, height) that is drawn width by height pixels large."""

    box: str
    width: int
    height: int
    lines: Sequence[Line]


@dataclass(frozen=True, kw_only=True)
class TexturePicture:
    """The average leaf."""

    file: str
    caption: str


@dataclass(frozen=True, kw_only=True, eq=False)
class PageContent:
    """What a report shows besides: of photographs, or of a cloud."""

    rows: Sequence[Row] = ()  # before those of the leaves
    cloud: Sequence[ReportPicture] = ()
    views: Sequence[ReportPhotograph] = ()
    left_out: str = ""  # a sentence on photographs that are not shown
    texture: TexturePicture | None = None
    withheld: MeasuredAsset | None = None  # the asset against photographs that were withheld


def write_leaves_page(
    folder: Path,
    frame: ReportFrame,
    leaves: Leaves,
    certainty: NDArray[np.floating],
    steps: Sequence[Step],
    content: PageContent,
) -> Path:
    """Write index.html into folder, where the pictures are already; returns the page.

    Args:
        folder: Of the report.
        frame: What it states of the run.
        leaves: Whose figures it has.
        certainty: (N,), how sure it is which end of each is the base.
        steps: What each step of the reconstruction left.
        content: What it shows.
    """
    page = render_template(
        "leaves_report.html",
        name=frame.name,
        capture=frame.source,
        generator=frame.generator,
        notes=list_sentences(frame.remarks, frame.render_setting),
        count=f"{len(leaves):,}",
        steps=steps,
        measures=[*content.rows, *measure_rows(leaves), *certainty_rows(certainty)],
        histograms=[*leaf_histograms(leaves), *certainty_histograms(certainty)],
        mean_leaf=draw_mean_leaf(leaves) if len(leaves) else None,
        texture=content.texture,
        withheld=content.withheld.rows() if content.withheld is not None else [],
        withheld_pictures=content.withheld.pictures() if content.withheld is not None else [],
        cloud=content.cloud,
        left_out=content.left_out,
        views=content.views,
        settings=[Row(name=name, value=value) for name, value in frame.settings.items()],
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8")
    write_step_times(folder, frame.seconds)
    return index


def measure_rows(leaves: Leaves) -> list[Row]:
    """The figures of leaves, for report and terminal; none without leaves."""
    if not len(leaves):
        return []
    rows = [Row(name="length", value=_spread_of_lengths(leaves.length_m), remark="median, from the 5th to the 95th %")]
    rows.append(Row(name="width / length", value=_spread(leaf_width(leaves.parameters), "")))
    if leaves.residual_m is not None:
        rows.append(Row(name="residual", value=_spread_of_lengths(leaves.residual_m), remark="of the captured points"))
        share = 100 * leaves.residual_m / leaves.length_m
        rows.append(Row(name="residual / length", value=_spread(share, "%")))
    if leaves.confidence is not None:
        rows.append(
            Row(name="confidence", value=_spread(leaves.confidence, ""), remark="the probability that a leaf is right")
        )
    return [*rows, *origin_rows(count_origins(leaves))]


def origin_rows(counts: Mapping[str, int]) -> list[Row]:
    """How many leaves were found, completed and so on, by count_origins; none where that is unknown."""
    text = describe_origins(counts)
    return [Row(name="leaves by origin", value=text)] if text else []


def certainty_rows(certainty: NDArray[np.floating]) -> list[Row]:
    """How sure it is which end of leaves (N,) is the base, in figures; none without leaves."""
    if not len(certainty):
        return []
    guessed = int(np.count_nonzero(certainty < SURE))
    remark = f"0.5 nothing is known to 1; {guessed:,} of {len(certainty):,} leaves are below {SURE:g}, a guess"
    return [Row(name="certainty of base and apex", value=_spread(certainty, ""), remark=remark)]


def certainty_histograms(certainty: NDArray[np.floating]) -> list[Histogram]:
    """The same as bars."""
    return [_histogram(certainty, "certainty of base and apex", 0.5, 1.0)] if len(certainty) else []


def leaf_histograms(leaves: Leaves) -> list[Histogram]:
    """What is shown of leaves as bars; none without leaves."""
    if not len(leaves):
        return []
    histograms = [_histogram_of_lengths(leaves.length_m, "length")]
    if leaves.residual_m is not None:
        histograms.insert(
            0, _histogram(100 * leaves.residual_m / leaves.length_m, "residual in % of the length", 0.0, None)
        )
        histograms.insert(0, _histogram_of_lengths(leaves.residual_m, "residual"))
    if leaves.confidence is not None:
        histograms.append(_histogram(leaves.confidence, "confidence", 0.0, 1.0))
    return histograms


def draw_mean_leaf(leaves: Leaves) -> Drawing:
    """The mean leaf from above and, on the right, from its side."""
    mean = mean_leaf(leaves.parameters)
    v = np.linspace(0, 1, 49)
    curves = [(0.0, "#8a5a2b", 1.5), (1 / 3, "#999", 0.7), (2 / 3, "#999", 0.7), (1.0, "#2e7d32", 2.0)]
    above, aside = [], []
    for across, color, width in curves:
        for side in sorted({-across, across}):
            points = evaluate_points(mean[None], grid_places(side, v))[0]
            above.append((points[:, [0, 1]], color, width))
            if side >= 0:
                aside.append((points[:, [2, 1]], color, width))
    reach = max(float(np.abs(places[:, 0]).max()) for places, _, _ in above)
    heights = np.concatenate([places[:, 0] for places, _, _ in aside])
    shift = reach + 0.15 - float(heights.min())
    moved = above + [(places + np.array([shift, 0]), color, width) for places, color, width in aside]
    everything = np.concatenate([places for places, _, _ in moved])
    low, high = everything.min(axis=0) - 0.05, everything.max(axis=0) + 0.05
    size = (high - low) * MEAN_LEAF_PX
    lines = [
        Line(
            points=" ".join(
                f"{x:.1f},{y:.1f}" for x, y in (places - (low[0], high[1])) * (MEAN_LEAF_PX, -MEAN_LEAF_PX)
            ),
            color=color,
            width=width,
        )
        for places, color, width in moved
    ]
    width_px, height_px = (int(np.ceil(side)) for side in size)
    return Drawing(box=f"0 0 {width_px} {height_px}", width=width_px, height=height_px, lines=lines)


def _spread(values: NDArray[np.floating], unit: str) -> str:
    middle, low, high = np.percentile(values, (50, 5, 95))
    return f"{middle:.3g} ({low:.3g} to {high:.3g}){f' {unit}' if unit else ''}"


def _spread_of_lengths(lengths_m: NDArray[np.floating]) -> str:
    factor, unit = _length_unit(float(np.percentile(lengths_m, 95)))
    return _spread(lengths_m * factor, unit)


def _length_unit(length_m: float) -> tuple[float, str]:
    """How many of a unit are in a metre, and the unit in which so long a thing reads well."""
    return (1000.0, "mm") if length_m < 0.9995 else (1.0, "m")  # from there on it would be printed as 1e+03 mm


def _histogram_of_lengths(lengths_m: NDArray[np.floating], what: str) -> Histogram:
    factor, unit = _length_unit(float(lengths_m.max()))
    return _histogram(lengths_m * factor, f"{what} in {unit}", 0.0, None)


def _histogram(values: NDArray[np.floating], title: str, low: float, high: float | None) -> Histogram:
    top = float(values.max()) if high is None else high
    top = top if top > low else low + 1.0
    heights, _ = np.histogram(values, bins=BINS, range=(low, top))
    return Histogram(title=title, low=f"{low:.3g}", high=f"{top:.3g}", heights=[int(height) for height in heights])
