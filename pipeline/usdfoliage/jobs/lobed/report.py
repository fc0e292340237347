"""The quality report of a lobed leaf: how it was made, step by step, and how it looks flat and bent."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.jobs.lobed.model import ModelledLeaf
from usdfoliage.jobs.lobed.pictures import draw_making
from usdfoliage.jobs.report.content import ReportContent
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.pictures import write_picture
from usdfoliage.jobs.report.table import ReportPicture, Row
from usdfoliage.jobs.report.timings import write_step_times
from usdfoliage.remarks import list_sentences

_CAPTIONS = {
    "scan": "The leaf in its scan.",
    "silhouette": "Orange: the silhouette, a closed cubic B-spline. Dots: its control points.",
    "skeleton": "The skeleton. Black: the axis; each other branch has a colour of its own.",
    "ties": "The railroad ties, from the skeleton to the silhouette.",
    "faces": "The faces of the mesh.",
}


def write_lobed_report(folder: Path, report: ReportContent, leaf: ModelledLeaf, linear: NDArray[np.float32]) -> Path:
    """Write index.html and its pictures into folder; returns the page.

    Args:
        folder: An existing folder, which may hold the pictures that report.views name.
        report: The rest of its content.
        leaf: Which it is about.
        linear: (H, W, 3), the scan, linear Rec.709.
    """
    pictures = []
    for name, picture in draw_making(linear, leaf).items():
        file = write_picture(folder / f"{name}.{'jpg' if name == 'scan' else 'png'}", picture)
        pictures.append(ReportPicture(file=file, caption=_CAPTIONS[name]))
    page = render_template(
        "lobed_report.html",
        name=report.name,
        capture=report.capture,
        generator=report.generator,
        notes=list_sentences(report.remarks, report.render_setting),
        made=pictures,
        views=report.views,
        measures=measure_rows(leaf),
        settings=[Row(name=name, value=value) for name, value in report.settings.items()],
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8")
    write_step_times(folder, report.seconds)
    return index


def measure_rows(leaf: ModelledLeaf) -> list[Row]:
    """The figures of a leaf, for report and terminal."""
    width_m, height_m = np.ptp(leaf.leaf.shape.places, axis=0).tolist()
    silhouette = leaf.flat.silhouette
    return [
        Row(name="lobes", value=str(leaf.flat.lobes), remark="tips of the skeleton beside the base"),
        Row(name="size", value=f"{1000 * width_m:.1f} x {1000 * height_m:.1f} mm", remark="width and height, flat"),
        Row(name="silhouette IoU", value=f"{leaf.iou:.4f}", remark="faces and mask, where the leaf was modelled"),
        Row(
            name="silhouette",
            value=f"{len(silhouette.control_px)} control points",
            remark=f"{silhouette.error_px * leaf.crop.pixel:.2f} px from the edge of the mask, in 99.5 % of its length",
        ),
        Row(name="skeleton", value=f"{leaf.leaf.shape.branch_count} branches, {len(leaf.leaf.shape.nodes)} nodes"),
        Row(name="mesh", value=f"{len(leaf.leaf.shape.faces)} faces", remark="one between two neighbouring ties"),
    ]
