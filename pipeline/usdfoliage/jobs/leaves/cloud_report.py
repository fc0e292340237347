"""The report of leaves found in a cloud alone."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.jobs.leaves.page import PageContent, ReportFrame, write_leaves_page
from usdfoliage.jobs.report.cloud_pictures import (
    Direction,
    bar_length,
    draw_scale_bar,
    draw_seen,
    frame_points,
    splat_points,
)
from usdfoliage.jobs.report.pictures import leaf_palette, write_picture
from usdfoliage.jobs.report.table import ReportPicture, Row, WrittenReport
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.reconstruct_cloud import CloudReconstruction

PICTURE_PX = 1000  # longest side of a picture of the cloud
DRAWN_POINTS = 400_000
SPLAT = 1.2  # side of a point's square, in distances between points
NO_LEAF = (196, 192, 184)  # colour of points that are of no leaf
_DIRECTIONS = (
    Direction(name="front", right=np.eye(3)[0], up=np.eye(3)[1], towards=np.eye(3)[2]),
    Direction(name="right", right=-np.eye(3)[2], up=np.eye(3)[1], towards=np.eye(3)[0]),
)


def write_cloud_leaves_report(
    folder: Path,
    frame: ReportFrame,
    found: CloudReconstruction,
    leaves: Leaves,
    points_m: NDArray[np.float64],
    leaf: NDArray[np.int32],
    previews: Sequence[str] = (),
) -> WrittenReport:
    """Write index.html and its pictures into folder, which exists.

    Args:
        folder: Of the report.
        frame: What it states of the run.
        found: The leaves.
        leaves: The same in the asset's frame.
        points_m: (N, 3), the cloud in the asset's frame.
        leaf: (N,), which leaf each point is of, -1 for none.
        previews: Pictures of the asset, in the folder.
    """
    pictures = [
        ReportPicture(file=file, caption=f"The cloud from the {name}, every leaf in a colour of its own; grey: no leaf")
        for name, file in _draw_cloud(folder, points_m, leaf, found)
    ]
    drawn = [ReportPicture(file=file, caption="The asset, drawn by Storm") for file in previews]
    share = float((leaf >= 0).mean()) if len(leaf) else 0.0
    rows = [
        Row(
            name="points",
            value=f"{len(points_m):,}",
            remark=f"{100 * share:.0f} % of them of leaves; {1000 * found.segmentation.spacing_m:.2g} mm apart",
        ),
    ]
    content = PageContent(rows=rows, cloud=[*pictures, *drawn])
    index = write_leaves_page(folder, frame, leaves, found.certainty, found.steps, content)
    return WrittenReport(page=index, pictures=tuple(pictures))


def _draw_cloud(
    folder: Path, points_m: NDArray[np.float64], leaf_of: NDArray[np.int32], found: CloudReconstruction
) -> list[tuple[str, str]]:
    """Pictures of the cloud in the colours of its leaves; their directions and files."""
    chosen = np.linspace(0, len(points_m) - 1, min(len(points_m), DRAWN_POINTS)).astype(np.int64)
    drawn_m, leaf = points_m[chosen], leaf_of[chosen]
    colors = np.concatenate([leaf_palette(len(found.leaves)), np.array([NO_LEAF], np.uint8)])[leaf]
    windows = frame_points(drawn_m, _DIRECTIONS, PICTURE_PX, drawn_m[leaf >= 0])
    bar_m = bar_length(windows)
    width_m = SPLAT * found.segmentation.spacing_m * np.sqrt(len(points_m) / max(len(drawn_m), 1))
    files = []
    for direction, window in zip(_DIRECTIONS, windows, strict=True):
        seen = splat_points(drawn_m, direction, window, np.full(len(drawn_m), width_m, np.float32))
        picture = draw_seen(seen, colors)
        draw_scale_bar(picture, bar_m, window.px_per_m)
        file = f"cloud_{direction.name}.png"
        write_picture(folder / file, picture)
        files.append((direction.name, file))
    return files
