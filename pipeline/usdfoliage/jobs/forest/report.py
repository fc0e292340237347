"""The report of a forest: where what stands, over the orthophoto, and pictures from four sides."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.forest_package import LEVEL
from usdfoliage.asset.parts.planted import PlantedLevel
from usdfoliage.asset.parts.terrain import TerrainPrim
from usdfoliage.errors import PreviewError
from usdfoliage.forest.planting import ForestInput, Planting
from usdfoliage.forest.raster import to_pixels
from usdfoliage.forest.shots import CameraPath
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.pinhole import Pinhole, look_at
from usdfoliage.jobs.forest.levels import LEAVES, RELIEF
from usdfoliage.jobs.forest.shots import PlannedShot
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, remark_missing_pictures, render_views
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.pictures import leaf_palette, write_picture
from usdfoliage.jobs.report.table import Histogram, ReportView, Row
from usdfoliage.jobs.report.timings import write_step_times
from usdfoliage.progress import StepProgress, progress_in_step
from usdfoliage.remarks import Remark, RenderSetting, list_sentences

COMPLEXITY = "low"
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
MAX_LEAFY = 500  # plants, up to which a picture has leaves on all
EDGE_M = 2.0  # from the south edge of the ground to the camera at eye height
BARS = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class ForestPicture:
    """A picture of the forest that is to be drawn."""

    title: str
    file: str  # in the report's folder
    pinhole: Pinhole | None  # None: from above
    level: str = ""  # variant that is drawn; empty for the default
    frame: float | None = None  # time code of a shot; None for the forest without one


@dataclass(frozen=True, kw_only=True)
class ForestReport:
    """What the page of a forest has."""

    name: str
    dem: str
    generator: str
    rows: Sequence[Row]
    legend: Sequence[Row]  # colours of species in the map
    histograms: Sequence[Histogram]
    settings: Mapping[str, str]
    remarks: Sequence[Remark]
    render_setting: RenderSetting
    seconds: Mapping[str, float]


def list_pictures(terrain: TerrainPrim, levels: Sequence[PlantedLevel]) -> tuple[ForestPicture, ...]:
    """Of the forest from four sides, from above, and from eye height.

    Storm draws reliefs as it draws meshes, and in a part of the memory; near by, leaves where there are not too many.
    """
    plants = {level.name: len(level.ids) for level in levels}
    far = RELIEF if RELIEF in plants else ""
    near = LEAVES if 0 < plants.get(LEAVES, 0) <= MAX_LEAFY else far
    return (
        *(
            ForestPicture(title=title, file=file, pinhole=_camera_beside(terrain, np.radians(azimuth)), level=far)
            for (title, _, file), azimuth in zip(SIDES, (0, 90, 180, 270), strict=True)
        ),
        ForestPicture(title="From above", file="preview_top.png", pinhole=None, level=far),
        ForestPicture(title="At eye height", file="preview_eye.png", pinhole=_camera_at_eye(terrain), level=near),
    )


def list_shot_pictures(shots: Sequence[PlannedShot]) -> tuple[ForestPicture, ...]:
    """Of shots, from their cameras, at their first, middle and last frame."""
    listed = []
    for shot in shots:
        frames = shot.camera.path.frame
        for number in sorted({0, len(frames) // 2, len(frames) - 1}):
            listed.append(
                ForestPicture(
                    title=f"{shot.planted.name}, frame {frames[number]:g}",
                    file=f"{shot.planted.name}_{frames[number]:g}.png",
                    pinhole=pinhole_of(shot.camera.path, number, SHOT_PX),
                    level=shot.planted.name,
                    frame=float(frames[number]),
                )
            )
    return tuple(listed)


def draw_forest(
    interface: Path | None,
    folder: Path,
    pictures: Sequence[ForestPicture],
    remarks: list[Remark],
    progress: StepProgress | None = None,
) -> tuple[ReportView, ...]:
    """Draw the pictures of a forest; none where Storm cannot draw.

    Args:
        interface: The asset; None for no pictures.
        folder: Of the report.
        pictures: Which.
        remarks: Gets one where there are no pictures.
        progress: Called at each picture.
    """
    if interface is None:
        return ()
    of_forest, of_shots = (
        [_as_view(each, folder) for each in pictures if (each.frame is None) == still] for still in (True, False)
    )
    # Plants are so small that a refined face would be no pixel.
    settings = PreviewSettings(
        width_px=960, height_px=640, purposes=("default", "render", "proxy"), complexity=COMPLEXITY
    )
    try:
        render_views(interface, of_forest, settings, progress_in_step("preview", progress))
    except PreviewError as error:
        remarks.append(remark_missing_pictures(error))
        return ()
    if of_shots:
        settings = PreviewSettings(purposes=("default", "render", "proxy"), complexity=COMPLEXITY)
        render_views(interface, of_shots, settings, progress_in_step("preview", progress))
    return tuple(ReportView(name=each.title, file=each.file) for each in pictures)


def _as_view(picture: ForestPicture, folder: Path) -> PreviewView:
    """How it is drawn, to a file in folder."""
    return PreviewView(
        output=folder / picture.file,
        pinhole=picture.pinhole,
        direction="top",
        variants=((LEVEL, picture.level),) if picture.level else None,
        frame=picture.frame,
    )


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


def write_forest_map(folder: Path, given: ForestInput, planting: Planting) -> tuple[Row, ...]:
    """Write map.jpg into the report's folder; returns the colours of the species in it.

    Raises:
        WriteError: It cannot be written.
    """
    colors = leaf_palette(len(given.plants.rows))
    write_picture(folder / "map.jpg", draw_map(given, planting, colors))
    return tuple(
        Row(name=row.species, value="#{:02x}{:02x}{:02x}".format(*color.tolist()))
        for row, color in zip(given.plants.rows, colors, strict=True)
    )


def count_heights(planting: Planting) -> tuple[Histogram, ...]:
    """How many plants have which height; nothing of no plants."""
    if not len(planting):
        return ()
    heights = [int(count) for count in np.histogram(planting.height_m, BARS)[0]]
    low, high = float(planting.height_m.min()), float(planting.height_m.max())
    return (Histogram(title="Heights", low=f"{low:.1f} m", high=f"{high:.1f} m", heights=heights),)


def write_forest_report(folder: Path, report: ForestReport, drawn: Sequence[ReportView]) -> Path:
    """Write index.html into folder, which holds map.jpg and the pictures of drawn; returns the page."""
    page = render_template(
        "forest_report.html",
        name=report.name,
        dem=report.dem,
        generator=report.generator,
        notes=list_sentences(report.remarks, report.render_setting),
        views=drawn,
        measures=report.rows,
        legend=report.legend,
        histograms=report.histograms,
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
    colors_of_rows = [tuple(color) for color in colors.tolist()]
    for (x, y), radius, row in zip(pixels.tolist(), radius_px.tolist(), planting.row.tolist(), strict=True):
        center = (round(8 * x), round(8 * y))
        cv2.circle(picture, center, max(8, round(8 * radius)), colors_of_rows[row], 1, cv2.LINE_AA, 3)
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
