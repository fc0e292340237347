"""The quality report of a crown of a capture: the crown beside the photographs, from their own cameras."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from usdfoliage.crown.captured_measures import CapturedCrownMeasures
from usdfoliage.crown.model import CrownModel
from usdfoliage.crown.silhouette_view import draw_silhouette
from usdfoliage.crown.views import CrownView
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.crown.photograph_report import JPEG_QUALITY, RADIUS_FACES, write_map_pictures
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, render_views
from usdfoliage.jobs.report.content import ReportContent
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.pictures import shrink_to, shrunk_size, write_picture
from usdfoliage.jobs.report.table import ReportPicture, ReportView, Row, WrittenReport
from usdfoliage.jobs.report.timings import write_step_times
from usdfoliage.progress import StepProgress, progress_in_step
from usdfoliage.remarks import list_sentences

PICTURE_PX = 520  # longer side of a photograph in the report
# Pictures of the asset by itself: (title, direction, file).
SIDES = (
    ("Front", "front", "preview.png"),
    ("Right side", "right", "preview_right.png"),
    ("Back", "back", "preview_back.png"),
    ("Left side", "left", "preview_left.png"),
    ("Top", "top", "preview_top.png"),
)


@dataclass(frozen=True, kw_only=True)
class ReportPair:
    """A photograph and the crown from the same place."""

    name: str
    photo: str  # file
    drawn: str  # file, empty where Storm could not draw


@dataclass(frozen=True, kw_only=True)
class DrawnCrown:
    """Pictures of a report."""

    views: tuple[ReportView, ...]
    pairs: tuple[ReportPair, ...]
    failure: PreviewError | None = None  # why there are no pictures of the asset


def draw_captured_crown(
    interface: Path | None,
    folder: Path,
    model: CrownModel,
    views: Sequence[CrownView],
    count: int,
    progress: StepProgress | None = None,
) -> DrawnCrown:
    """Draw the crown into folder: by Storm from all sides and from the cameras of some photographs, and these.

    Args:
        interface: The asset, which Storm draws; None for no such pictures.
        folder: Of the report.
        model: The crown of the asset.
        views: All photographs.
        count: How many of them are shown, evenly chosen.
        progress: Called at each of Storm's pictures.
    """
    chosen = [views[len(views) * number // min(count, len(views))] for number in range(min(count, len(views)))]
    pairs, drawn = [], []
    for number, view in enumerate(chosen):
        photo = shrink_to(view.read().srgb, PICTURE_PX).copy()
        height, width = shrunk_size((view.camera.height_px, view.camera.width_px), PICTURE_PX)
        camera = view.camera.resized(width, height)
        edges, _ = cv2.findContours(
            draw_silhouette(model.radius_m, model.center_m, camera).astype(np.uint8),
            cv2.RETR_EXTERNAL,
            cv2.CHAIN_APPROX_NONE,
        )
        cv2.drawContours(photo, edges, -1, (255, 140, 0), 1, cv2.LINE_AA)
        pair = ReportPair(name=view.name, photo=f"view_{number}.jpg", drawn=f"view_{number}_crown.png")
        write_picture(folder / pair.photo, np.asarray(photo, np.uint8), jpeg_quality=JPEG_QUALITY)
        drawn.append(PreviewView(output=folder / pair.drawn, pinhole=camera))
        pairs.append(pair)
    without = tuple(ReportPair(name=pair.name, photo=pair.photo, drawn="") for pair in pairs)
    if interface is None:
        return DrawnCrown(views=(), pairs=without)
    sides = [PreviewView(output=folder / file, direction=direction) for _, direction, file in SIDES]
    try:
        render_views(
            interface,
            [*sides, *drawn],
            PreviewSettings(width_px=640, height_px=640),
            progress_in_step("preview", progress),
        )
    except PreviewError as error:
        return DrawnCrown(views=(), pairs=without, failure=error)
    titled = tuple(ReportView(name=title, file=file) for title, _, file in SIDES)
    return DrawnCrown(views=titled, pairs=tuple(pairs))


def write_captured_report(
    folder: Path, report: ReportContent, model: CrownModel, measures: CapturedCrownMeasures, drawn: DrawnCrown
) -> WrittenReport:
    """Write index.html and the pictures of the cubemaps into folder, which holds those of drawn."""
    low, high = write_map_pictures(folder, model)
    page = render_template(
        "captured_crown_report.html",
        name=report.name,
        capture=report.capture,
        generator=report.generator,
        notes=list_sentences(report.remarks, report.render_setting),
        views=report.views,
        pairs=drawn.pairs,
        measures=captured_rows(model, measures),
        by_view=measures.views,
        of_photographs=measures.carved is not None,
        radius_low=f"{low:.2f}",
        radius_high=f"{high:.2f}",
        settings=[Row(name=name, value=value) for name, value in report.settings.items()],
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8")
    write_step_times(folder, report.seconds)
    return WrittenReport(page=index, pictures=(ReportPicture(file=RADIUS_FACES, caption="radius faces"),))


def captured_rows(model: CrownModel, measures: CapturedCrownMeasures) -> list[Row]:
    """The figures of a crown, for report and terminal."""
    center = ", ".join(f"{place:.2f}" for place in model.center_m)
    rows = [
        Row(
            name="points", value=f"{measures.points:,}", remark=f"of the crown; {measures.outliers:,} outliers left out"
        ),
        Row(name="crown base", value=f"{measures.base_m:.2f} m", remark="above the root"),
        Row(
            name="centre",
            value=f"{center} m",
            remark=f"of {measures.center.tried} tried; what is star-shaped about it and holds the points has "
            f"{100 * measures.center.filled:.0f} % of the volume about the worst",
        ),
        Row(name="radius", value=f"{model.radius_m.min():.2f} to {model.radius_m.max():.2f} m"),
        Row(name="volume", value=f"{measures.volume_m3:.3g} m³"),
        Row(name="directions with points", value=f"{100 * measures.known:.0f} %", remark="stretched over elsewhere"),
        *_carved(measures.carved),
        Row(
            name="distance from outermost points",
            value=f"{1000 * measures.distance_m:.0f} mm",
            remark="median, along the direction",
        ),
        _colored(measures),
        Row(
            name="silhouette IoU with the points",
            value=_spread([view.cloud_iou for view in measures.views]),
            remark="median and lowest of the views; points leave gaps that a crown closes",
        ),
    ]
    masked = [view.mask_iou for view in measures.views if view.mask_iou is not None]
    if masked:
        rows.append(
            Row(
                name="silhouette IoU with the masks",
                value=_spread(masked),
                remark="median and lowest of the views, without the trunk",
            )
        )
    return rows


def _carved(carved: float | None) -> list[Row]:
    """Nothing of a cloud alone."""
    if carved is None:
        return []
    return [Row(name="directions carved", value=f"{100 * carved:.0f} %", remark="photographs see past the points")]


def _colored(measures: CapturedCrownMeasures) -> Row:
    share = f"{100 * measures.seen:.0f} %"
    if measures.carved is None:
        return Row(
            name="coloured", value=share, remark="of the texels have a point's colour or shade, others what is around"
        )
    return Row(name="seen", value=share, remark="of the texels, in some photograph")


def _spread(values: Sequence[float]) -> str:
    return f"{np.median(values):.4f}, {min(values):.4f}"
