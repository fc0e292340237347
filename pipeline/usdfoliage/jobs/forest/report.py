"""The report of a forest: where what stands, over the orthophoto, and pictures from four sides."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.forest_package import LEVEL
from usdfoliage.asset.parts.terrain import TerrainPrim
from usdfoliage.errors import PreviewError
from usdfoliage.forest.planting import ForestInput, Planting
from usdfoliage.forest.raster import to_pixels
from usdfoliage.forest.shots import CameraPath
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.pinhole import Pinhole, look_at
from usdfoliage.jobs.forest.shots import PlannedShot
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, remark_missing_pictures, render_views
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.pictures import leaf_palette, write_picture
from usdfoliage.jobs.report.table import Histogram, ReportView, Row
from usdfoliage.jobs.report.timings import write_step_times
from usdfoliage.progress import StepProgress, progress_in_step
from usdfoliage.remarks import Remark, RenderSetting, list_sentences

SHOT_PX = 960  # width of the pictures of shots
MAP_PX = 1400  # longer side of the map
SIDES = (
    ("From the south", "front", "preview.png"),
    ("From the east", "right", "preview_east.png"),
    ("From the north", "back", "preview_north.png"),
    ("From the west", "left", "preview_west.png"),
)
ABOVE_DEG = 28.0  # from which the sides are seen
EYE_M = 1.7
EDGE_M = 2.0  # from the south edge of the ground to the camera at eye height
BARS = 24


@dataclass(frozen=True, kw_only=True)
class ForestReport:
    """What the page of a forest has."""

    name: str
    dem: str
    generator: str
    rows: Sequence[Row]
    settings: Mapping[str, str]
    remarks: Sequence[Remark]
    render_setting: RenderSetting
    seconds: Mapping[str, float]


def draw_forest(
    interface: Path | None,
    folder: Path,
    terrain: TerrainPrim,
    remarks: list[Remark],
    progress: StepProgress | None = None,
) -> tuple[ReportView, ...]:
    """Pictures of the forest from four sides, from above, and from eye height; none where Storm cannot draw.

    Args:
        interface: The asset; None for no pictures.
        folder: Of the report.
        terrain: The ground, which the cameras stand on.
        remarks: Gets one where there are no pictures.
        progress: Called at each picture.
    """
    if interface is None:
        return ()
    views = [
        *(
            PreviewView(output=folder / file, pinhole=_camera_beside(terrain, np.radians(azimuth)))
            for (_, _, file), azimuth in zip(SIDES, (0, 90, 180, 270), strict=True)
        ),
        PreviewView(output=folder / "preview_top.png", direction="top"),
        PreviewView(output=folder / "preview_eye.png", pinhole=_camera_at_eye(terrain)),
    ]
    titles = [
        *((title, file) for title, _, file in SIDES),
        ("From above", "preview_top.png"),
        ("At eye height", "preview_eye.png"),
    ]
    settings = PreviewSettings(width_px=960, height_px=640, purposes=("default", "render", "proxy"))
    try:
        render_views(interface, views, settings, progress_in_step("preview", progress))
    except PreviewError as error:
        remarks.append(remark_missing_pictures(error))
        return ()
    return tuple(ReportView(name=title, file=file) for title, file in titles)


def draw_shots(
    interface: Path, folder: Path, shots: Sequence[PlannedShot], progress: StepProgress | None = None
) -> tuple[ReportView, ...]:
    """Pictures of shots, from their cameras, at their first, middle and last frame.

    Raises:
        PreviewError: Storm cannot draw.
    """
    views, drawn = [], []
    for shot in shots:
        frames = shot.camera.path.frame
        for number in sorted({0, len(frames) // 2, len(frames) - 1}):
            file = f"{shot.planted.name}_{frames[number]:g}.png"
            pinhole = pinhole_of(shot.camera.path, number, SHOT_PX)
            variants = ((LEVEL, shot.planted.name),)
            views.append(
                PreviewView(output=folder / file, pinhole=pinhole, variants=variants, frame=float(frames[number]))
            )
            drawn.append(ReportView(name=f"{shot.planted.name}, frame {frames[number]:g}", file=file))
    if views:
        settings = PreviewSettings(purposes=("default", "render", "proxy"))
        render_views(interface, views, settings, progress_in_step("preview", progress))
    return tuple(drawn)


def pinhole_of(path: CameraPath, number: int, width_px: int) -> Pinhole:
    """The camera of a path at one of its frames, in a picture of that width."""
    left, right, bottom, top = path.window[number]
    focal_px = width_px / (right - left)
    axes = path.axes[number] * np.array([[1.0], [-1.0], [-1.0]])  # OpenCV's: right, down, forward
    return Pinhole(
        width_px=width_px,
        height_px=max(1, round(focal_px * (top - bottom))),
        focal_px=(focal_px, focal_px),
        center_px=(-left * focal_px, top * focal_px),
        cam_from_world=np.column_stack([axes, -axes @ path.eye_m[number]]),
    )


def write_forest_report(
    folder: Path, report: ForestReport, given: ForestInput, planting: Planting, drawn: Sequence[ReportView]
) -> Path:
    """Write index.html and its map into folder, which holds the pictures of drawn; returns the page."""
    colors = leaf_palette(len(given.plants.rows))
    write_picture(folder / "map.jpg", draw_map(given, planting, colors))
    heights = [int(count) for count in np.histogram(planting.height_m, BARS)[0]] if len(planting) else []
    histograms = []
    if heights:
        low, high = float(planting.height_m.min()), float(planting.height_m.max())
        histograms = [Histogram(title="Heights", low=f"{low:.1f} m", high=f"{high:.1f} m", heights=heights)]
    legend = [
        Row(name=row.species, value="#{:02x}{:02x}{:02x}".format(*color.tolist()))
        for row, color in zip(given.plants.rows, colors, strict=True)
    ]
    page = render_template(
        "forest_report.html",
        name=report.name,
        dem=report.dem,
        generator=report.generator,
        notes=list_sentences(report.remarks, report.render_setting),
        views=drawn,
        measures=report.rows,
        legend=legend,
        histograms=histograms,
        settings=[Row(name=name, value=value) for name, value in report.settings.items()],
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8")
    write_step_times(folder, report.seconds)
    return index


def draw_map(given: ForestInput, planting: Planting, colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3) the terrain from above, with a circle for each crown in the colour of its row (R, 3)."""
    base = given.orthophoto if given.orthophoto is not None else given.terrain.heights
    values = np.nan_to_num(np.asarray(base.values, np.float64))
    if values.ndim == 2:
        low, high = values.min(), values.max()
        values = np.repeat(((values - low) / max(high - low, 1e-9))[..., None], 3, axis=2) ** 2.2
    factor = MAP_PX / max(values.shape[:2])
    size = max(1, round(values.shape[1] * factor)), max(1, round(values.shape[0] * factor))
    interpolation = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    shrunk = cv2.resize(values, size, interpolation=interpolation)
    picture = np.rint(np.clip(np.asarray(encode_srgb(shrunk)), 0, 1) * 255).astype(np.uint8)
    pixels = to_pixels(base, planting.ground_m) * factor
    radius_px = planting.radius_m / base.cell_m * factor
    for (x, y), radius, row in zip(pixels.tolist(), radius_px.tolist(), planting.row.tolist(), strict=True):
        color = tuple(int(each) for each in colors[row])
        cv2.circle(picture, (round(8 * x), round(8 * y)), max(8, round(8 * radius)), color, 1, cv2.LINE_AA, 3)
    return picture[::-1] if np.linalg.det(base.ground_from_pixel[:, :2]) > 0 else picture  # rows that go north


def _camera_beside(terrain: TerrainPrim, azimuth_rad: float, size_px: tuple[int, int] = (960, 640)) -> Pinhole:
    """A camera that sees the whole ground from a side."""
    low, high = terrain.extent_m
    middle_m = (low + high) / 2
    radius_m = float(np.linalg.norm(high - low)) / 2
    down = np.radians(ABOVE_DEG)
    away = np.array([np.sin(azimuth_rad) * np.cos(down), np.sin(down), np.cos(azimuth_rad) * np.cos(down)])
    return look_at(middle_m + 1.9 * radius_m * away, middle_m, 1.05 * size_px[0], size_px)


def _camera_at_eye(terrain: TerrainPrim, size_px: tuple[int, int] = (960, 640)) -> Pinhole:
    """A camera on the ground at the south edge, that looks north."""
    low, high = terrain.extent_m
    middle_m = (low + high) / 2
    beside_m = terrain.points_m[:, [0, 2]] - [middle_m[0], high[2] - EDGE_M]
    at_m = terrain.points_m[np.argmin(np.linalg.norm(beside_m, axis=1))] + np.array([0.0, EYE_M, 0.0])
    towards = np.array([middle_m[0], at_m[1], low[2] - EDGE_M])
    return look_at(at_m, towards, 0.8 * size_px[0], size_px)
