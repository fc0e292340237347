"""The report of a capture: what one looks at before depth and cloud are trusted."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.capture.cloud_files.spacing import point_widths
from usdfoliage.capture.folder.listing import counted, named
from usdfoliage.files.atomic import whole_file
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.capture.map_pictures import (
    Legend,
    LegendPicture,
    depth_limits,
    draw_confidence,
    draw_depth,
    draw_normals,
    in_words,
    make_legend,
)
from usdfoliage.jobs.capture.overlap_pictures import find_groups, find_links, write_matrix, write_plan
from usdfoliage.jobs.capture.photograph import CapturePhotograph, DrawnMaps
from usdfoliage.jobs.report.cloud_pictures import (
    Direction,
    bar_length,
    draw_scale_bar,
    draw_seen,
    find_common,
    find_inside,
    find_sides,
    frame_points,
    splat_points,
    thin_cloud,
)
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.pictures import (
    TURBO,
    VIRIDIS,
    color_values,
    pick_pixels,
    shrink_camera,
    shrink_to,
    shrunk_size,
    write_picture,
)
from usdfoliage.jobs.report.table import Histogram, ReportPicture, Row, WrittenReport
from usdfoliage.jobs.report.timings import write_step_times
from usdfoliage.remarks import Remark, RenderSetting, as_plan_setting, list_sentences, remark

__all__ = ["CapturePhotograph", "CaptureReport", "DrawnMaps", "capture_rows", "check_capture", "write_capture_report"]

PICTURE_PX = 720  # longer side of a photograph and its maps
CLOUD_PX = 1000  # longest side of the pictures of the cloud
BINS = 40
FRAMING_POINTS = 300_000  # that decide what part of the cloud is drawn
HIGH_ERROR = 2.0  # times the median, from where there is a remark on a photograph's reprojection error


@dataclass(frozen=True, kw_only=True, eq=False)
class CaptureReport:
    """All that the report shows."""

    name: str
    capture: str  # name of the input, without its folder
    generator: str
    remarks: Sequence[Remark]  # what the reader should know first
    photographs: Sequence[CapturePhotograph]
    cloud: Cloud
    up: tuple[float, float, float]  # of the capture's world
    poses_given: bool
    shared: NDArray[np.floating] | None = None  # (N, N), matches between photographs; None where poses were given
    errors_px: NDArray[np.floating] | None = None  # (M,), of all observations of the cameras' model
    measures: Sequence[Row] = ()  # more of them
    drawn: Sequence[int] = ()  # which photographs are shown with their maps
    seconds: Mapping[str, float] = field(default_factory=dict)  # by step; none where the report does not show them
    settings: Mapping[str, str] = field(default_factory=dict)
    render_setting: RenderSetting = as_plan_setting  # how remedies write a setting

    def __post_init__(self) -> None:
        count = len(self.photographs)
        named_ones = [*self.drawn, *(source for photograph in self.photographs for source in photograph.sources)]
        if not all(0 <= number < count for number in named_ones):
            raise ValueError(f"photographs are called by numbers from 0 to {count - 1}")
        if self.shared is not None and self.shared.shape != (count, count):
            raise ValueError(f"shared must be {(count, count)}, not {self.shared.shape}")


@dataclass(frozen=True, kw_only=True)
class PictureRow:
    """Pictures side by side."""

    title: str
    facts: str
    pictures: Sequence[LegendPicture]


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """One photograph in the table."""

    number: int
    name: str
    status: str
    failed: bool
    error: str
    points: str
    sources: str
    coverage: float | None  # per cent
    remark: str


def write_capture_report(folder: Path, report: CaptureReport) -> WrittenReport:
    """Write index.html and its pictures into folder, which is made.

    The page is written last. Maps are read for one photograph at a time.

    Raises:
        WriteError: A file cannot be written.
    """
    cameras = [photograph.camera for photograph in report.photographs if photograph.camera is not None]
    some = thin_cloud(report.cloud, FRAMING_POINTS)
    sides = find_sides(cameras, some, np.array(report.up, np.float64))
    framed_m = some.points_m[find_common(some.points_m, cameras)]
    links = find_links(report.photographs, report.shared)
    plan = None
    if cameras:
        drawn = thin_cloud(report.cloud)
        widths_m = point_widths(drawn.points_m, cameras, len(report.cloud) / max(len(drawn), 1))
        plan = write_plan(folder, report.photographs, links, drawn, widths_m, framed_m, sides[2])
    rows, of_plant = _write_sides(folder, report.cloud, framed_m, sides, cameras)
    page = render_template(
        "capture_report.html",
        name=report.name,
        capture=report.capture,
        generator=report.generator,
        notes=list_sentences([*report.remarks, *check_capture(report)], report.render_setting),
        heading=_heading(report),
        measures=[*capture_rows(report), *report.measures],
        photographs=[_table_row(number, photograph) for number, photograph in enumerate(report.photographs)],
        poses_given=report.poses_given,
        sides=rows,
        plan=plan,
        matrix=write_matrix(folder, report.photographs, report.shared) if len(report.photographs) > 1 else None,
        histograms=error_histograms(report),
        left_out=_left_out(report),
        views=[_write_view(folder, report, number) for number in report.drawn],
        settings=[Row(name=name, value=value) for name, value in report.settings.items()],
    )
    index = folder / "index.html"
    with whole_file(index) as new:
        new.write_text(page, encoding="utf-8", errors="backslashreplace")  # file names may be any bytes
    write_step_times(folder, report.seconds)
    return WrittenReport(page=index, pictures=of_plant)


def check_capture(report: CaptureReport) -> list[Remark]:
    """Remarks on what the report's own numbers show."""
    remarks = []
    without = [photograph.name for photograph in report.photographs if photograph.camera is None]
    if without and not any(each.code == "photographs-not-registered" for each in report.remarks):
        text = f"{len(without)} of {counted(len(report.photographs), 'photograph')} have no camera: {named(without)}"
        remarks.append(remark("photographs-not-registered", text, subject=named(without)))
    errors = [
        (photograph.error_px, photograph.name) for photograph in report.photographs if photograph.error_px is not None
    ]
    if len(errors) > 2:
        middle = float(np.median([error for error, _ in errors]))
        high = [name for error, name in errors if error > HIGH_ERROR * middle]
        if high:
            text = (
                f"{counted(len(high), 'photograph')} with a reprojection error above {HIGH_ERROR * middle:.2f} px, "
                f"twice the median: {named(high)}; they may have moved, or something in them"
            )
            remarks.append(remark("reprojection-errors-high", text, subject=named(high)))
    bare = [
        photograph.name
        for photograph in report.photographs
        if photograph.camera is not None and photograph.coverage == 0
    ]
    if bare:
        text = f"{counted(len(bare), 'photograph')} without any depth: {named(bare)}"
        remarks.append(remark("photographs-without-depth", text, subject=named(bare)))
    groups = find_groups(report.photographs, find_links(report.photographs, report.shared))
    if len(groups) > 1:
        text = (
            f"the photographs fall into {len(groups)} groups that were not matched with each other, of "
            f"{', '.join(str(len(group)) for group in groups[:6])} photographs; the cloud may not be connected"
        )
        remarks.append(remark("photographs-in-groups", text))
    return remarks


def capture_rows(report: CaptureReport) -> list[Row]:
    """The figures of a capture, for report and terminal."""
    cloud, photographs = report.cloud, report.photographs
    registered = sum(photograph.camera is not None for photograph in photographs)
    rows = [Row(name="photographs", value=f"{registered} of {len(photographs)}", remark="with a camera")]
    errors = [photograph.error_px for photograph in photographs if photograph.error_px is not None]
    if report.poses_given:
        rows.append(Row(name="poses", value="given", remark="kept as they are, frame and unit included"))
    elif errors:
        rows.append(_spread(np.array(errors), "reprojection error", " px", "of the photographs' means"))
    covered = np.array([photograph.coverage for photograph in photographs if photograph.coverage is not None])
    if len(covered):
        rows.append(_spread(100 * covered, "depth", " %", "of the pixels of each photograph that are not masked"))
    rows.append(Row(name="points", value=f"{len(cloud):,}", remark="of the cloud"))
    if len(cloud):
        size = np.ptp(np.quantile(cloud.points_m, (0.002, 0.998), axis=0), axis=0)
        rows.append(
            Row(name="size", value=" × ".join(in_words(side) for side in size), remark="x, y, z of 99.6 % of them")
        )
        rows.append(_spread(cloud.views, "views of a point", "", "that saw it"))
        rows.append(_spread(cloud.confidence, "confidence", "", "of the points, 0 to 1"))
    return rows


def error_histograms(report: CaptureReport) -> list[Histogram]:
    """Reprojection errors as bars, of observations and of photographs; none where there are none."""
    histograms = [("of observations in px", report.errors_px)]
    means = [photo.error_px for photo in report.photographs if photo.error_px is not None]
    histograms.append(("of photographs, mean in px", np.array(means) if means else None))
    return [
        _histogram(np.asarray(values, np.float64), f"reprojection errors {what}")
        for what, values in histograms
        if values is not None and len(values)
    ]


def _heading(report: CaptureReport) -> str:
    return f"{len(report.cloud):,} points from {counted(len(report.photographs), 'photograph')}"


def _spread(values: NDArray[np.generic], name: str, unit: str, remark: str) -> Row:
    middle, low, high = np.percentile(np.asarray(values, np.float64), (50, 5, 95))
    text = f"{middle:.3g} ({low:.3g} to {high:.3g}){unit}"
    return Row(name=name, value=text, remark=f"{remark}; median, from the 5th to the 95th %")


def _histogram(values: NDArray[np.float64], title: str) -> Histogram:
    top = float(np.quantile(values, 0.995)) or 1.0
    heights, _ = np.histogram(np.minimum(values, top), bins=BINS, range=(0, top))
    more = "+" if values.max() > top else ""
    return Histogram(title=title, low="0", high=f"{top:.3g}{more}", heights=[int(height) for height in heights])


def _table_row(number: int, photograph: CapturePhotograph) -> TableRow:
    return TableRow(
        number=number,
        name=photograph.name,
        status="registered" if photograph.camera is not None else photograph.failure or "not registered",
        failed=photograph.camera is None,
        error="" if photograph.error_px is None else f"{photograph.error_px:.2f}",
        points="" if photograph.points is None else f"{photograph.points:,}",
        sources=" ".join(str(source) for source in photograph.sources),
        coverage=None if photograph.coverage is None else 100 * photograph.coverage,
        remark=photograph.remark,
    )


def _left_out(report: CaptureReport) -> str:
    with_maps = sum(photograph.read_maps is not None for photograph in report.photographs)
    if len(report.drawn) >= with_maps:
        return ""
    return f"{len(report.drawn)} of {with_maps} photographs with depth are shown, evenly chosen."


# Pictures


def _write_sides(
    folder: Path,
    cloud: Cloud,
    framed_m: NDArray[np.float64],
    sides: Sequence[Direction],
    cameras: Sequence[Pinhole],
) -> tuple[list[PictureRow], tuple[ReportPicture, ...]]:
    """The cloud from three sides: in its colours, by views, by confidence; and the pictures in its colours by side."""
    if not len(cloud):
        return [], ()
    windows = frame_points(framed_m, sides, CLOUD_PX, np.zeros((0, 3)))
    bar_m = bar_length(windows)
    inside = np.flatnonzero(find_inside(cloud.points_m, framed_m, sides))
    cloud = thin_cloud(cloud.take(inside))
    widths_m = point_widths(cloud.points_m, cameras, len(inside) / max(len(cloud), 1))
    seen = [splat_points(cloud.points_m, side, window, widths_m) for side, window in zip(sides, windows, strict=True)]
    highest = max(2.0, float(np.quantile(cloud.views, 0.98)))
    kinds = [
        ("colour", "As photographed; shaded where something stands before.", cloud.srgb, None),
        (
            "views",
            "How many photographs saw each point.",
            color_values(cloud.views.astype(np.float64), 1, highest, VIRIDIS),
            make_legend("1", f"{highest:.0f} views", VIRIDIS),
        ),
        (
            "confidence",
            "How sure the surest of them was.",
            color_values(cloud.confidence, 0, 1, VIRIDIS),
            make_legend("0", "1", VIRIDIS),
        ),
    ]
    rows, in_colour = [], []
    for what, facts, colors, legend in kinds:
        pictures = []
        for side, window, drawn in zip(sides, windows, seen, strict=True):
            picture = draw_seen(drawn, colors)
            draw_scale_bar(picture, bar_m, window.px_per_m)
            file = write_picture(folder / f"cloud_{side.name}_{what}.jpg", picture)
            caption = f"{side.name}; the bar is {in_words(bar_m)}"
            pictures.append(LegendPicture(file=file, caption=caption, width=picture.shape[1], legend=legend))
            if what == "colour":
                in_colour.append(ReportPicture(file=file, caption=f"The cloud, {side.name}"))
        rows.append(PictureRow(title=what, facts=facts, pictures=pictures))
    return rows, tuple(in_colour)


def _write_view(folder: Path, report: CaptureReport, number: int) -> PictureRow:
    photograph = report.photographs[number]
    if photograph.read_maps is None or photograph.camera is None:
        raise ValueError(f"{photograph.name} has no camera or no maps, and cannot be shown")
    maps = photograph.read_maps()
    stem = f"view_{number:03}"
    size = shrunk_size(maps.srgb.shape[:2], PICTURE_PX)
    depth_m = pick_pixels(np.asarray(maps.depth_m), _fitting(size, maps.depth_m.shape))
    mask = None if maps.mask is None else pick_pixels(maps.mask, depth_m.shape)
    known = depth_m > 0
    limits = depth_limits(depth_m, mask)
    legend = None if limits is None else make_legend(in_words(limits[1]), in_words(limits[0]), TURBO)

    def write(what: str, picture: NDArray[np.uint8], caption: str, legend: Legend | None = None) -> LegendPicture:
        file = write_picture(folder / f"{stem}_{what}.jpg", picture)
        return LegendPicture(file=file, caption=caption, width=picture.shape[1], legend=legend)

    pictures = [
        write("photograph", shrink_to(maps.srgb, PICTURE_PX), "photograph"),
        write("depth", draw_depth(depth_m, limits), "depth along the axis, dark where there is none", legend),
    ]
    if maps.normals is not None:
        normals = _pick_vectors(np.asarray(maps.normals), depth_m.shape)
        camera = shrink_camera(photograph.camera, PICTURE_PX, np.eye(4))
        caption = "normals: red to the right, green up, blue towards the camera"
        pictures.append(write("normals", draw_normals(normals, camera, known), caption))
    if maps.confidence is not None:
        confidence = pick_pixels(np.asarray(maps.confidence), depth_m.shape)
        pictures.append(
            write("confidence", draw_confidence(confidence, known), "confidence", make_legend("0", "1", VIRIDIS))
        )
    facts = []
    if photograph.coverage is not None:
        facts.append(f"depth for {100 * photograph.coverage:.0f} % of the pixels that are not masked")
    if photograph.error_px is not None:
        facts.append(f"reprojection error {photograph.error_px:.2f} px")
    if photograph.sources:
        facts.append(f"matched with {', '.join(str(source) for source in photograph.sources)}")
    return PictureRow(title=f"{number}: {photograph.name}", facts="; ".join(facts), pictures=pictures)


def _fitting(size: tuple[int, int], shape: tuple[int, ...]) -> tuple[int, int]:
    """The size of a picture, or of what is smaller already."""
    return (shape[0], shape[1]) if shape[0] <= size[0] else size


def _pick_vectors(values: NDArray[np.floating], size: tuple[int, ...]) -> NDArray[np.floating]:
    planes = [pick_pixels(values[..., axis], (size[0], size[1])) for axis in range(values.shape[2])]
    return np.stack(planes, axis=-1)
