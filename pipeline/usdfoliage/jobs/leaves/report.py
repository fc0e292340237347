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
from usdfoliage.jobs.leaves.page import PageContent, ReportFrame, TexturePicture, write_leaves_page
from usdfoliage.jobs.leaves.pictures import (
    SURE,
    DrawnPoints,
    draw_candidates,
    draw_fitted,
    draw_refined,
    draw_superpixels,
    prepare_points,
)
from usdfoliage.jobs.report.pictures import pick_pixels, shrink_view
from usdfoliage.jobs.report.table import ReportPhotograph, ReportPicture, WrittenReport
from usdfoliage.jobs.withheld.measure import MeasuredAsset
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.reconstruct import Reconstruction

PICTURE_PX = 900  # longer side of a picture


@dataclass(frozen=True, kw_only=True, eq=False)
class LeavesReport:
    """What the report has besides the reconstruction itself."""

    frame: ReportFrame
    drawn: Sequence[int]  # which views are drawn
    numbers: Sequence[int]  # of each view, among the capture's photographs
    texture: str = ""  # file of the average leaf, as seen from the report's folder
    previews: Mapping[int, str] = field(default_factory=dict)  # view: picture of the asset, in the report's folder
    withheld: MeasuredAsset | None = None  # the asset against photographs that were withheld


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
    content = PageContent(
        views=[photograph for photograph, _ in written],
        left_out=left_out,
        texture=texture,
        withheld=report.withheld,
    )
    index = write_leaves_page(folder, report.frame, leaves, reconstruction.certainty, reconstruction.steps, content)
    return WrittenReport(page=index, pictures=tuple(fitted for _, fitted in written))


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


def _write_jpeg(path: Path, picture: NDArray[np.uint8]) -> str:
    good, encoded = cv2.imencode(path.suffix, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])
    if not good:
        raise AssetError(f"the picture {path.name} of the report could not be encoded")
    path.write_bytes(encoded.tobytes())
    return path.name
