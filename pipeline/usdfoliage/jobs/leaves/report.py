"""The report of leaves found in a capture: pictures and measures to look at before one accepts them."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.errors import AssetError
from usdfoliage.jobs.leaves.pictures import (
    SURE,
    DrawnPoints,
    draw_candidates,
    draw_fitted,
    draw_refined,
    draw_superpixels,
    prepare_points,
)
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.pictures import pick_pixels, shrink_view
from usdfoliage.jobs.report.table import (
    Histogram,
    ReportPhotograph,
    ReportPicture,
    Row,
    WrittenReport,
    list_seconds,
)
from usdfoliage.jobs.withheld.measure import MeasuredAsset
from usdfoliage.leaf.model import Leaves, mean_leaf
from usdfoliage.leaf.reconstruct import Reconstruction
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.remarks import Remark, RenderSetting, list_sentences

PICTURE_PX = 900  # longer side of a picture
BINS = 30
MEAN_LEAF_PX = 320  # from base to apex


@dataclass(frozen=True, kw_only=True, eq=False)
class LeavesReport:
    """What the report has besides the reconstruction itself."""

    name: str
    capture: str
    generator: str
    remarks: Sequence[Remark]  # what the reader should know first
    render_setting: RenderSetting
    settings: Mapping[str, str]
    seconds: Mapping[str, float]
    drawn: Sequence[int]  # which views are drawn
    numbers: Sequence[int]  # of each view, among the capture's photographs
    texture: str = ""  # file of the average leaf, as seen from the report's folder
    previews: Mapping[int, str] = field(default_factory=dict)  # view: picture of the asset, in the report's folder
    withheld: MeasuredAsset | None = None  # the asset against photographs that were withheld


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


def write_leaves_report(
    folder: Path, report: LeavesReport, reconstruction: Reconstruction, views: Sequence[View], *, threads: int = 0
) -> WrittenReport:
    """Write index.html and its pictures into folder, which exists.

    Args:
        threads: That draw pictures; 0: one per core. The pictures are the same.
    """
    leaves = reconstruction.leaves
    left_out = ""
    if len(report.drawn) < len(views):
        left_out = f"{len(report.drawn)} of {len(views)} photographs are shown, evenly chosen."
    texture = None
    if report.texture:
        caption = (
            "The average leaf that the material shows, from (0, 0) on the left below to (1, 1): the base is below, the "
            "silhouette left and right. Its alpha shows how many of the leaves that go into it reach a place of the "
            "surfaces that were fitted to them: opaque where three quarters or more do, clear (the checkers show) "
            "where a quarter or fewer do."
        )
        texture = TexturePicture(file=report.texture, caption=caption)
    drawn_points = prepare_points(reconstruction.segmentation.leaves)

    def write_photograph(number: int) -> tuple[ReportPhotograph, ReportPicture]:
        return _write_photograph(folder, report, reconstruction, drawn_points, views[number], number)

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        written = list(pool.map(write_photograph, report.drawn))
    page = render_template(
        "leaves_report.html",
        name=report.name,
        capture=report.capture,
        generator=report.generator,
        notes=list_sentences(report.remarks, report.render_setting),
        count=f"{len(leaves):,}",
        steps=reconstruction.steps,
        measures=[*measure_rows(leaves), *certainty_rows(reconstruction.certainty)],
        histograms=[*leaf_histograms(leaves), *certainty_histograms(reconstruction.certainty)],
        mean_leaf=draw_mean_leaf(leaves) if len(leaves) else None,
        texture=texture,
        withheld=report.withheld.rows() if report.withheld is not None else [],
        withheld_pictures=report.withheld.pictures() if report.withheld is not None else [],
        cloud=(),
        left_out=left_out,
        views=[photograph for photograph, _ in written],
        seconds=list_seconds(report.seconds),
        settings=[Row(name=name, value=value) for name, value in report.settings.items()],
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8")
    return WrittenReport(page=index, pictures=tuple(fitted for _, fitted in written))


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
        rows.append(Row(name="confidence", value=_spread(leaves.confidence, ""), remark="0 guessed to 1 seen whole"))
    return rows


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


def _write_photograph(
    folder: Path,
    report: LeavesReport,
    reconstruction: Reconstruction,
    drawn_points: DrawnPoints,
    view: View,
    number: int,
) -> tuple[ReportPhotograph, ReportPicture]:
    """The pictures of one photograph, and the one of them that the report of a whole plant has."""
    segmentation, leaves = reconstruction.segmentation, reconstruction.leaves
    candidates = segmentation.candidates[number]
    name = f"{report.numbers[number]:03}"
    small = shrink_view(view, PICTURE_PX)
    size = small.depth_m.shape

    def write(what: str, picture: NDArray[np.uint8]) -> str:
        return _write_jpeg(folder / f"view_{name}_{what}.jpg", picture)

    photograph = write("photograph", small.srgb)
    # Photographs are drawn by one thread each.
    fitted = write("fitted", draw_fitted(small, leaves, reconstruction.source, reconstruction.certainty, threads=1))
    pictures = [
        ReportPicture(
            file=photograph,
            over=fitted,
            caption="The photograph, and the fitted leaves laid over it, with their axes; a dot at each base, hollow "
            f"where it is a guess which end is the base (certainty below {SURE:g}). Move the bar.",
        )
    ]
    if number in report.previews:
        preview = report.previews[number]
        caption = "The photograph, and the asset drawn by Storm from the same camera. Move the bar."
        pictures.append(ReportPicture(file=photograph, over=preview, caption=caption))
    if candidates.superpixels is not None:
        superpixels = pick_pixels(candidates.superpixels, size)
        file = write("superpixels", draw_superpixels(small, superpixels))
        pictures.append(ReportPicture(file=file, caption="Superpixels that have a surface; dark where there is none."))
    labels = pick_pixels(candidates.labels, size)
    file = write("candidates", draw_candidates(small, labels, candidates.confidence))
    caption = (
        "Candidates of this view. The colour only parts neighbours; its strength is how much a candidate is like a "
        "leaf, from a trace (not at all) to full. What is left of walls and soil is dropped later."
    )
    pictures.append(ReportPicture(file=file, caption=caption))
    file = write("refined", draw_refined(small, number, drawn_points))
    pictures.append(
        ReportPicture(
            file=file,
            caption="Refined leaves of the whole scene, in the points of them that this view can see; "
            "a leaf has one colour in all views.",
        )
    )
    known = np.count_nonzero(view.depth_m) / view.depth_m.size
    facts = [
        f"depth for {100 * known:.0f} % of the pixels" if view.has_depth else "no depth",
        f"{len(candidates.confidence):,} candidates",
        f"{np.count_nonzero(segmentation.leaves.view == number):,} refined leaves are seen best here",
        f"{np.count_nonzero(_own(leaves, report.numbers[number])):,} fitted ones",
    ]
    title = f"{report.numbers[number]}: {view.name}"
    return (
        ReportPhotograph(title=title, facts="; ".join(facts) + ".", pictures=pictures),
        ReportPicture(file=fitted, caption=f"Fitted leaves over the photograph, photograph {name}"),
    )


def _own(leaves: Leaves, number: int) -> NDArray[np.bool_]:
    return np.zeros(len(leaves), np.bool_) if leaves.view is None else leaves.view == number


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


def _write_jpeg(path: Path, picture: NDArray[np.uint8]) -> str:
    good, encoded = cv2.imencode(path.suffix, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])
    if not good:
        raise AssetError(f"the picture {path.name} of the report could not be encoded")
    path.write_bytes(encoded.tobytes())
    return path.name
