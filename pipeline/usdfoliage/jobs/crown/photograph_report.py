"""The quality report of a crown: what one looks at before a crown is accepted."""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.crown.model import CrownModel
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.cubemap import FACES
from usdfoliage.jobs.crown.photograph import CrownMeasures
from usdfoliage.jobs.report.content import ReportContent
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.pictures import write_picture
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.report.timings import write_step_times
from usdfoliage.remarks import list_sentences

PICTURE_PX = 900  # longer side of the photograph in the report
COLOR_FACES, RADIUS_FACES = "color_faces.jpg", "radius_faces.png"  # the cubemaps, unfolded
JPEG_QUALITY = 95

# Row, column and turn (quarter turns anticlockwise) of each face, unfolded as seen from outside, after mirroring.
UNFOLDED: Mapping[str, tuple[int, int]] = {
    "+Y": (0, 1),
    "-X": (1, 0),
    "+Z": (1, 1),
    "+X": (1, 2),
    "-Z": (1, 3),
    "-Y": (2, 1),
}


def write_crown_report(
    folder: Path,
    report: ReportContent,
    model: CrownModel,
    measures: CrownMeasures,
    color: NDArray[np.floating],
    mask: NDArray[np.bool_],
) -> Path:
    """Write index.html and its pictures into folder; returns the page.

    Args:
        folder: An existing folder, which may hold the pictures that report.views name.
        report: The rest of its content.
        model: The crown.
        measures: Of the crown.
        color: (H, W, 3), the photograph, linear Rec.709.
        mask: (H, W), as used.
    """
    write_picture(folder / "input.jpg", draw_overlay(color, mask, measures), jpeg_quality=JPEG_QUALITY)
    write_picture(folder / "mask.png", mask.astype(np.uint8) * 255)
    low, high = write_map_pictures(folder, model)
    page = render_template(
        "crown_report.html",
        name=report.name,
        capture=report.capture,
        generator=report.generator,
        notes=list_sentences(report.remarks, report.render_setting),
        views=report.views,
        measures=measure_rows(model, measures),
        radius_low=f"{low:.2f}",
        radius_high=f"{high:.2f}",
        settings=[Row(name=name, value=value) for name, value in report.settings.items()],
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8")
    write_step_times(folder, report.seconds)
    return index


def write_map_pictures(folder: Path, model: CrownModel) -> tuple[float, float]:
    """Write the unfolded cubemaps, COLOR_FACES and RADIUS_FACES; returns the radii that are black and white."""
    write_picture(folder / COLOR_FACES, _unfold(_display(model.color)), jpeg_quality=JPEG_QUALITY)
    low, high = float(model.radius_m.min()), float(model.radius_m.max())
    grey = np.rint((model.radius_m - low) / max(high - low, 1e-9) * 255).astype(np.uint8)
    write_picture(folder / RADIUS_FACES, _unfold(np.repeat(grey[..., None], 3, axis=-1)))
    return low, high


def measure_rows(model: CrownModel, measures: CrownMeasures) -> list[Row]:
    """The figures of a crown, for report and terminal."""
    x_px, y_px = measures.silhouette.center_px
    return [
        Row(name="centre", value=f"{x_px:.1f}, {y_px:.1f} px", remark="column and row in the photograph"),
        Row(
            name="silhouette IoU",
            value=f"{measures.iou:.4f}",
            remark="front silhouette and mask, where they lie in the photograph",
        ),
        Row(
            name="silhouette IoU, aligned",
            value=f"{measures.iou_aligned:.4f}",
            remark="both cut to their bounds and brought to one height",
        ),
        Row(
            name="star-shaped bound",
            value=f"{measures.star_bound:.4f}",
            remark="the best IoU that a star-shaped crown about this centre can have",
        ),
        Row(name="radius", value=f"{model.radius_m.min():.2f} to {model.radius_m.max():.2f} m"),
    ]


def draw_overlay(color: NDArray[np.floating], mask: NDArray[np.bool_], measures: CrownMeasures) -> NDArray[np.uint8]:
    """The photograph (h, w, 3), display-encoded, darkened outside the mask, with silhouette and centre."""
    scale = min(1.0, PICTURE_PX / max(mask.shape))
    size = (max(1, round(mask.shape[1] * scale)), max(1, round(mask.shape[0] * scale)))
    small = cv2.resize(np.asarray(color, dtype=np.float32), size, interpolation=cv2.INTER_AREA)
    inside = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)[..., None]
    picture = np.ascontiguousarray(_display(small * (0.12 + 0.88 * inside)))
    bits = 4
    outline = np.rint((measures.outline_px * scale - 0.5) * (1 << bits)).astype(np.int32)
    cv2.polylines(picture, [outline], True, (255, 140, 0), 2, cv2.LINE_AA, bits)
    center = np.rint(measures.silhouette.center_px * scale - 0.5).astype(int).tolist()
    cv2.drawMarker(picture, center, (255, 255, 255), cv2.MARKER_CROSS, 18, 4)
    cv2.drawMarker(picture, center, (255, 140, 0), cv2.MARKER_CROSS, 16, 2)
    return picture


def _display(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(np.clip(encode_srgb(linear), 0, 1) * 255).astype(np.uint8)


def _unfold(faces: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A cross of the six faces (6, N, N, 3) as one sees them from outside."""
    size = faces.shape[1]
    cross = np.full((3 * size, 4 * size, 3), 250, np.uint8)
    for face, (row, column) in UNFOLDED.items():
        # Mirrored, since the faces are drawn as seen from inside; top and bottom then turned towards the front.
        picture = faces[FACES.index(face)][:, ::-1]
        if face in ("+Y", "-Y"):
            picture = picture[::-1, ::-1]
        cross[row * size : (row + 1) * size, column * size : (column + 1) * size] = picture
    return cross
