"""The report of a capture: what one looks at before depth and cloud are trusted."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import jinja2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud import Cloud
from usdfoliage.capture.listing import counted, named
from usdfoliage.capture.point_spacing import point_widths
from usdfoliage.capture.whole_file import whole_file
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.capture_pictures import (
    TURBO,
    VIRIDIS,
    Direction,
    color_table,
    color_values,
    depth_limits,
    draw_confidence,
    draw_depth,
    draw_normals,
    draw_scale_bar,
    draw_seen,
    draw_shared,
    find_common,
    find_sides,
    frame_points,
    in_words,
    splat_points,
    thin_cloud,
)
from usdfoliage.jobs.crown_report import TEMPLATES, Row
from usdfoliage.jobs.leaves_pictures import pick_pixels, shrink_camera, shrink_to, shrunk_size
from usdfoliage.jobs.leaves_report import Histogram

PICTURE_PX = 720  # longer side of a photograph and its maps
CLOUD_PX = 1000  # longest side of the pictures of the cloud
PLAN_PX = 900
MATRIX_PX = 640
BINS = 40
MOST_LABELS = 60  # cameras in a plan that have their number beside them
PALE = 0.55  # of the colours' strength that is left below a plan
LEGEND_STOPS = 12
FEW_SHARED = 0.05  # of the most, below which no line is drawn between two cameras
HIGH_ERROR = 2.0  # times the median, from where a photograph's reprojection error is told


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownMaps:
    """A photograph and what was found of its pixels; all of one size, or of the camera's times one factor."""

    srgb: NDArray[np.uint8]  # (H, W, 3)
    depth_m: NDArray[np.floating]  # (H, W), 0 for none
    normals: NDArray[np.floating] | None = None  # (H, W, 3), in the world
    confidence: NDArray[np.floating] | None = None  # (H, W), 0 to 1
    mask: NDArray[np.bool_] | None = None  # (H, W), True on the plant


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturePhotograph:
    """What a run knows of one photograph."""

    name: str
    failure: str = ""  # why it has no camera, in a sentence; empty where it has one
    camera: Pinhole | None = None  # in the capture's world
    error_px: float | None = None  # mean reprojection error of its points; None where its pose was given
    points: int | None = None  # points of the cameras' model that it sees
    sources: Sequence[int] = ()  # photographs, by number, that it was matched with for its depth
    coverage: float | None = None  # share of its plant's pixels, of all without a mask, that have depth
    remark: str = ""  # what is odd about it
    read_maps: Callable[[], ShownMaps] | None = None  # called once, for those shown; nothing is kept


@dataclass(frozen=True, kw_only=True, eq=False)
class CaptureReport:
    """All that the report says."""

    name: str
    capture: str  # name of the input, without its folder
    generator: str
    notes: Sequence[str]  # what the reader should know first
    photographs: Sequence[CapturePhotograph]
    cloud: Cloud
    up: tuple[float, float, float]  # of the capture's world
    poses_given: bool
    shared: NDArray[np.floating] | None = None  # (N, N), matches between photographs; None where poses were given
    errors_px: NDArray[np.floating] | None = None  # (M,), of all observations of the cameras' model
    measures: Sequence[Row] = ()  # more of them
    shown: Sequence[int] = ()  # which photographs are shown with their maps
    seconds: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Legend:
    """What the colours of a picture mean, from left to right."""

    low: str
    high: str
    stops: str  # of a CSS gradient


@dataclass(frozen=True, kw_only=True)
class LegendPicture:
    """A picture with what it shows, and what its colours mean."""

    file: str
    caption: str
    width: int
    legend: Legend | None = None


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


@dataclass(frozen=True, kw_only=True)
class PlanCamera:
    """A camera from above: a triangle from its place to where its picture ends."""

    points: str
    x: float
    y: float
    label_x: float
    label_y: float
    label: str
    title: str
    without_depth: bool


@dataclass(frozen=True, kw_only=True)
class PlanLine:
    """Two cameras that share something."""

    x1: float
    y1: float
    x2: float
    y2: float
    opacity: float


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Cloud and cameras from above."""

    file: str
    width: int
    height: int
    bar: str
    cameras: Sequence[PlanCamera]
    lines: Sequence[PlanLine]
    caption: str


def write_capture_report(folder: Path, report: CaptureReport) -> Path:
    """Write index.html and its pictures into folder, which is made; returns the page.

    The page is written last. Maps are read for one photograph at a time.

    Raises:
        CaptureError: A file cannot be written.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, undefined=jinja2.StrictUndefined
    )
    cloud = thin_cloud(report.cloud)
    cameras = [held.camera for held in report.photographs if held.camera is not None]
    sides = find_sides(cameras, cloud, np.array(report.up, np.float64))
    common = find_common(cloud.points_m, cameras)
    widths_m = point_widths(cloud.points_m, cameras, len(report.cloud) / max(len(cloud), 1))
    page = environment.get_template("capture_report.html").render(
        name=report.name,
        capture=report.capture,
        generator=report.generator,
        notes=[*report.notes, *doubts(report)],
        heading=_heading(report),
        measures=[*capture_rows(report), *report.measures],
        photographs=[_table_row(number, held) for number, held in enumerate(report.photographs)],
        poses_given=report.poses_given,
        sides=_write_sides(folder, cloud, common, sides, widths_m),
        plan=_write_plan(folder, report, cloud, common, sides[2], widths_m) if cameras else None,
        matrix=_write_matrix(folder, report) if len(report.photographs) > 1 else None,
        histograms=error_histograms(report),
        left_out=_left_out(report),
        views=[_write_view(folder, report, number) for number in report.shown],
        seconds=[Row(name=name, value=f"{value:.2f}") for name, value in report.seconds.items()]
        + [Row(name="all", value=f"{sum(report.seconds.values()):.2f}")],
        settings=[Row(name=name, value=value) for name, value in report.settings.items()],
    )
    index = folder / "index.html"
    with whole_file(index) as new:
        new.write_text(page, encoding="utf-8")
    return index


def doubts(report: CaptureReport) -> list[str]:
    """What the numbers give reason to doubt, in sentences."""
    said = []
    without = [held.name for held in report.photographs if held.camera is None]
    if without:
        said.append(
            f"{counted(len(without), 'photograph')} of {len(report.photographs)} not registered: {named(without)}"
        )
    errors = [(held.error_px, held.name) for held in report.photographs if held.error_px is not None]
    if len(errors) > 2:
        middle = float(np.median([error for error, _ in errors]))
        high = [name for error, name in errors if error > HIGH_ERROR * middle]
        if high:
            said.append(
                f"{counted(len(high), 'photograph')} with a reprojection error above {HIGH_ERROR * middle:.2f} px, "
                f"twice the median: {named(high)}; did they move, or something in them?"
            )
    bare = [held.name for held in report.photographs if held.camera is not None and held.coverage == 0]
    if bare:
        said.append(f"{counted(len(bare), 'photograph')} without any depth: {named(bare)}")
    groups = _groups(report)
    if len(groups) > 1:
        said.append(
            f"the photographs fall into {len(groups)} groups that were not matched with each other, of "
            f"{', '.join(str(len(group)) for group in groups[:6])} photographs: the cloud may not be connected"
        )
    return said


def capture_rows(report: CaptureReport) -> list[Row]:
    """The figures of a capture, for report and terminal."""
    cloud, photographs = report.cloud, report.photographs
    registered = sum(held.camera is not None for held in photographs)
    rows = [Row(name="photographs", value=f"{registered} of {len(photographs)}", remark="with a camera")]
    errors = [held.error_px for held in photographs if held.error_px is not None]
    if report.poses_given:
        rows.append(Row(name="poses", value="given", remark="kept as they are, frame and unit included"))
    elif errors:
        rows.append(_spread(np.array(errors), "reprojection error", " px", "of the photographs' means"))
    covered = np.array([held.coverage for held in photographs if held.coverage is not None])
    if len(covered):
        rows.append(_spread(100 * covered, "depth", " %", "of the pixels of each photograph's plant, or of all"))
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
    held = [("of observations in px", report.errors_px)]
    means = [photo.error_px for photo in report.photographs if photo.error_px is not None]
    held.append(("of photographs, mean in px", np.array(means) if means else None))
    return [
        _histogram(np.asarray(values, np.float64), f"reprojection errors {what}")
        for what, values in held
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


def _table_row(number: int, held: CapturePhotograph) -> TableRow:
    return TableRow(
        number=number,
        name=held.name,
        status="registered" if held.camera is not None else held.failure or "not registered",
        failed=held.camera is None,
        error="" if held.error_px is None else f"{held.error_px:.2f}",
        points="" if held.points is None else f"{held.points:,}",
        sources=" ".join(str(source) for source in held.sources),
        coverage=None if held.coverage is None else 100 * held.coverage,
        remark=held.remark,
    )


def _groups(report: CaptureReport) -> list[list[int]]:
    """Registered photographs that are connected by matches or by sources, the largest group first."""
    chosen = [number for number, held in enumerate(report.photographs) if held.camera is not None]
    near: dict[int, set[int]] = {number: set() for number in chosen}
    for number in chosen:
        for other in _linked(report, number):
            if other in near:
                near[number].add(other)
                near[other].add(number)
    groups, left = [], set(chosen)
    while left:
        reached, new = set(), {min(left)}
        while new:
            reached |= new
            new = {other for number in new for other in near[number]} - reached
        groups.append(sorted(reached))
        left -= reached
    return sorted(groups, key=len, reverse=True) if any(near.values()) else []


def _linked(report: CaptureReport, number: int) -> list[int]:
    if report.shared is not None:
        return [int(other) for other in np.flatnonzero(report.shared[number] > 0) if other != number]
    return list(report.photographs[number].sources)


def _left_out(report: CaptureReport) -> str:
    with_maps = sum(held.read_maps is not None for held in report.photographs)
    if len(report.shown) >= with_maps:
        return ""
    return f"{len(report.shown)} of {with_maps} photographs with depth are shown, evenly chosen."


# Pictures


def _write_sides(
    folder: Path, cloud: Cloud, common: NDArray[np.bool_], sides: Sequence[Direction], widths_m: NDArray[np.float32]
) -> list[PictureRow]:
    """The cloud from three sides: in its colours, by views, by confidence."""
    if not len(cloud):
        return []
    windows = frame_points(cloud.points_m[common], sides, CLOUD_PX, np.zeros((0, 3)))
    seen = [splat_points(cloud.points_m, side, window, widths_m) for side, window in zip(sides, windows, strict=True)]
    most = max(2.0, float(np.quantile(cloud.views, 0.98)))
    kinds = [
        ("colour", "As photographed; shaded where something stands before.", cloud.srgb, None),
        (
            "views",
            "How many photographs saw each point.",
            color_values(cloud.views.astype(np.float64), 1, most, VIRIDIS),
            _legend("1", f"{most:.0f} views", VIRIDIS),
        ),
        (
            "confidence",
            "How sure the surest of them was.",
            color_values(cloud.confidence, 0, 1, VIRIDIS),
            _legend("0", "1", VIRIDIS),
        ),
    ]
    rows = []
    for what, facts, colors, legend in kinds:
        pictures = []
        for side, window, shown in zip(sides, windows, seen, strict=True):
            picture = draw_seen(shown, colors)
            bar = draw_scale_bar(picture, window.px_per_m)
            file = _write_picture(folder / f"cloud_{side.name}_{what}.jpg", picture)
            pictures.append(
                LegendPicture(
                    file=file, caption=f"{side.name}; the bar is {bar}", width=picture.shape[1], legend=legend
                )
            )
        rows.append(PictureRow(title=what, facts=facts, pictures=pictures))
    return rows


def _write_plan(
    folder: Path,
    report: CaptureReport,
    cloud: Cloud,
    common: NDArray[np.bool_],
    top: Direction,
    widths_m: NDArray[np.float32],
) -> Plan:
    """Cameras from above, with what they share."""
    numbers = [number for number, held in enumerate(report.photographs) if held.camera is not None]
    cameras = [held.camera for held in report.photographs if held.camera is not None]
    places_m = np.array([camera.position_m for camera in cameras])
    (window,) = frame_points(cloud.points_m[common], [top], PLAN_PX, places_m)
    seen = splat_points(cloud.points_m, top, window, widths_m)
    picture = draw_seen(seen, _paler(cloud.srgb))
    bar = draw_scale_bar(picture, window.px_per_m)
    height_px, width_px = picture.shape[:2]

    def place(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        x = (points_m @ top.right - window.left_m) * window.px_per_m
        return np.column_stack([x, height_px - (points_m @ top.up - window.bottom_m) * window.px_per_m])

    at = place(places_m)
    size_px = float(np.clip(0.35 * _typical_gap(at), 0.012 * PLAN_PX, 0.035 * PLAN_PX))
    drawn = []
    for index, (number, camera) in enumerate(zip(numbers, cameras, strict=True)):
        held = report.photographs[number]
        corners = np.array([[0, 0], [camera.width_px, 0], [camera.width_px, camera.height_px], [0, camera.height_px]])
        rays = (corners - camera.center_px) / camera.focal_px
        ends = np.column_stack([rays, np.ones(4)])
        ends *= size_px / window.px_per_m / np.linalg.norm(ends, axis=1).max()
        flat = place(camera.position_m + ends @ camera.cam_from_world[:, :3])
        outline = cv2.convexHull(np.concatenate([at[index : index + 1], flat]).astype(np.float32))[:, 0]
        away = at[index] - flat.mean(axis=0)
        away = away / max(float(np.linalg.norm(away)), 1e-9) * 11
        drawn.append(
            PlanCamera(
                points=" ".join(f"{x:.1f},{y:.1f}" for x, y in outline),
                x=round(float(at[index, 0]), 1),
                y=round(float(at[index, 1]), 1),
                label_x=round(float(at[index, 0] + away[0]), 1),
                label_y=round(float(at[index, 1] + away[1]), 1),
                label=str(number) if len(cameras) <= MOST_LABELS else "",
                title=f"{number}: {held.name}",
                without_depth=not held.coverage,
            )
        )
    position = {number: at[index] for index, number in enumerate(numbers)}
    strength = _link_strengths(report, position.keys())
    most = max(strength.values(), default=1.0)
    lines = [
        PlanLine(
            x1=round(float(position[one][0]), 1),
            y1=round(float(position[one][1]), 1),
            x2=round(float(position[other][0]), 1),
            y2=round(float(position[other][1]), 1),
            opacity=round(0.08 + 0.6 * float(np.sqrt(value / most)), 3),
        )
        for (one, other), value in sorted(strength.items(), key=lambda item: item[1])
        if value >= FEW_SHARED * most
    ]
    what = "share matches, stronger for more" if report.shared is not None else "were matched with each other for depth"
    caption = (
        f"From above, front below; the bar is {bar}. Each triangle is a camera, its tip where it stands; grey where it "
        f"has no depth. Lines join photographs that {what}."
    )
    file = _write_picture(folder / "plan.jpg", picture)
    return Plan(file=file, width=width_px, height=height_px, bar=bar, cameras=drawn, lines=lines, caption=caption)


def _paler(srgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colours (N, 3) below what is drawn over them."""
    return np.asarray(255 - (255 - srgb.astype(np.float32)) * PALE, np.uint8)


def _typical_gap(places: NDArray[np.float64]) -> float:
    """Median distance to the nearest other place; 0 for a single one."""
    if len(places) < 2:
        return 0.0
    away = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(away, np.inf)
    return float(np.median(away.min(axis=1)))


def _link_strengths(report: CaptureReport, chosen: Sequence[int] | object) -> dict[tuple[int, int], float]:
    """How much pairs of registered photographs share."""
    numbers = [number for number, held in enumerate(report.photographs) if held.camera is not None]
    strengths: dict[tuple[int, int], float] = {}
    for number in numbers:
        for other in _linked(report, number):
            if other == number or not 0 <= other < len(report.photographs) or report.photographs[other].camera is None:
                continue
            pair = min(number, other), max(number, other)
            if report.shared is not None:
                strengths[pair] = float(report.shared[number, other])
            else:
                strengths[pair] = strengths.get(pair, 0.0) + 1.0
    return strengths


def _write_matrix(folder: Path, report: CaptureReport) -> LegendPicture:
    count = len(report.photographs)
    if report.shared is not None:
        shared = np.asarray(report.shared, np.float64)
        caption = f"Matches between photographs 0 to {count - 1}, left to right and top to bottom; white for none."
        legend = _legend("1", f"{shared.max(initial=0):,.0f} matches", VIRIDIS)
    else:
        shared = np.zeros((count, count))
        for number, held in enumerate(report.photographs):
            for rank, source in enumerate(held.sources):
                shared[number, source] = len(held.sources) - rank
        caption = "Which photographs (from left to right) each one (from top to bottom) was matched with for its depth."
        legend = _legend("last", "first chosen", VIRIDIS)
    picture = draw_shared(shared, MATRIX_PX)
    file = _write_picture(folder / "shared.png", picture)
    return LegendPicture(file=file, caption=caption, width=picture.shape[1], legend=legend)


def _write_view(folder: Path, report: CaptureReport, number: int) -> PictureRow:
    held = report.photographs[number]
    if held.read_maps is None or held.camera is None:
        raise ValueError(f"{held.name} has no camera or no maps, and cannot be shown")
    maps = held.read_maps()
    stem = f"view_{number:03}"
    size = shrunk_size(maps.srgb.shape[:2], PICTURE_PX)
    depth_m = pick_pixels(np.asarray(maps.depth_m), _fitting(size, maps.depth_m.shape))
    mask = None if maps.mask is None else pick_pixels(maps.mask, depth_m.shape)
    known = depth_m > 0
    limits = depth_limits(depth_m, mask)
    legend = None if limits is None else _legend(in_words(limits[1]), in_words(limits[0]), TURBO)

    def write(what: str, picture: NDArray[np.uint8], caption: str, legend: Legend | None = None) -> LegendPicture:
        file = _write_picture(folder / f"{stem}_{what}.jpg", picture)
        return LegendPicture(file=file, caption=caption, width=picture.shape[1], legend=legend)

    pictures = [
        write("photograph", shrink_to(maps.srgb, PICTURE_PX), "photograph"),
        write("depth", draw_depth(depth_m, limits), "depth along the axis, dark where there is none", legend),
    ]
    if maps.normals is not None:
        normals = _pick_vectors(np.asarray(maps.normals), depth_m.shape)
        camera = shrink_camera(held.camera, PICTURE_PX, np.eye(4))
        caption = "normals: red to the right, green up, blue towards the camera"
        pictures.append(write("normals", draw_normals(normals, camera, known), caption))
    if maps.confidence is not None:
        confidence = pick_pixels(np.asarray(maps.confidence), depth_m.shape)
        pictures.append(
            write("confidence", draw_confidence(confidence, known), "confidence", _legend("0", "1", VIRIDIS))
        )
    facts = []
    if held.coverage is not None:
        facts.append(f"depth for {100 * held.coverage:.0f} % of the plant's pixels, or of all without a mask")
    if held.error_px is not None:
        facts.append(f"reprojection error {held.error_px:.2f} px")
    if held.sources:
        facts.append(f"matched with {', '.join(str(source) for source in held.sources)}")
    return PictureRow(title=f"{number}: {held.name}", facts="; ".join(facts), pictures=pictures)


def _fitting(size: tuple[int, int], shape: tuple[int, ...]) -> tuple[int, int]:
    """The size of a picture, or of what is smaller already."""
    return (shape[0], shape[1]) if shape[0] <= size[0] else size


def _pick_vectors(values: NDArray[np.floating], size: tuple[int, ...]) -> NDArray[np.floating]:
    planes = [pick_pixels(values[..., axis], (size[0], size[1])) for axis in range(values.shape[2])]
    return np.stack(planes, axis=-1)


def _legend(low: str, high: str, colors: int) -> Legend:
    table = color_table(colors)[np.linspace(0, 255, LEGEND_STOPS).astype(int)]
    return Legend(low=low, high=high, stops=", ".join(f"rgb({r}, {g}, {b})" for r, g, b in table.tolist()))


def _write_picture(path: Path, picture: NDArray[np.uint8]) -> str:
    quality = [cv2.IMWRITE_JPEG_QUALITY, 88] if path.suffix == ".jpg" else []
    good, encoded = cv2.imencode(path.suffix, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), quality)
    if not good:
        raise CaptureError(f"the picture {path.name} of the report could not be encoded")
    with whole_file(path) as new:
        new.write_bytes(encoded.tobytes())
    return path.name
