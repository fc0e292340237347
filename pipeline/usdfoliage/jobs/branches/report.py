"""The report of branches: what one looks at before a skeleton is trusted."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.distances import distances_to_cloud, distances_to_surface
from usdfoliage.branch.growth.importance import weigh_points
from usdfoliage.branch.internodes import measure_internode_m
from usdfoliage.branch.tracing.reconstruct import TracedBranches
from usdfoliage.branch.whole_wood import measure_wholeness
from usdfoliage.errors import PreviewError
from usdfoliage.geometry.smooth_mesh import refine_smooth
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, remark_missing_pictures, render_views
from usdfoliage.jobs.report.cloud_pictures import (
    Direction,
    bar_length,
    draw_scale_bar,
    draw_seen,
    frame_points,
    splat_points,
)
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.pictures import TURBO, VIRIDIS, color_values, write_picture
from usdfoliage.jobs.report.table import ReportPicture, ReportView, Row, WrittenReport
from usdfoliage.jobs.report.timings import write_step_times
from usdfoliage.progress import StepProgress, progress_in_step
from usdfoliage.remarks import Remark, RenderSetting, list_sentences

PICTURE_PX = 900  # longest side of a picture of the cloud
DRAWN_POINTS = 300_000
VIEWS = (("Front", "front", "preview.png"), ("Right side", "right", "preview_right.png"))
_FRONT = Direction(name="front", right=np.eye(3)[0], up=np.eye(3)[1], towards=np.eye(3)[2])
_RIGHT = Direction(name="right", right=-np.eye(3)[2], up=np.eye(3)[1], towards=np.eye(3)[0])
_PREVIEW = PreviewSettings(width_px=720, height_px=900, complexity="medium", samples=2)
_FAR_QUANTILE = 0.99  # of the distances, that the scale of their picture ends with


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchesReport:
    """What the report has besides the branches themselves."""

    name: str
    capture: str
    generator: str
    remarks: Sequence[Remark]  # what the reader should know first
    render_setting: RenderSetting
    settings: Mapping[str, str]
    variations: Sequence[Path] = ()  # interfaces of variations of the plant


def branch_rows(
    traced: TracedBranches,
    cage: BranchCage,
    points_m: NDArray[np.float64],
    *,
    grown: bool = False,
    has_circles: bool = True,
) -> list[Row]:
    """The figures of branches, as the paper's tables 2 and 3 have them, for report and terminal.

    Args:
        traced: Of which they are; figures of its circles concern the branches that were traced.
        cage: Its surface.
        points_m: (N, 3), of wood.
        grown: Whether the skeleton was grown, and is not the one that was traced.
        has_circles: Whether radii are those of circles in the cloud; those of lines in photographs are not.
    """
    skeleton = traced.skeleton
    to_surface_m = distances_to_surface(points_m, skeleton, traced.thickness_m)
    to_cloud_m = distances_to_cloud(skeleton, points_m, traced.thickness_m)
    by_order = np.bincount(skeleton.order)
    internode_m = measure_internode_m(skeleton) if traced.found_otherwise else traced.internode_m
    return [
        Row(
            name="points", value=f"{len(points_m):,}", remark=f"{1000 * traced.spacing_m:.1f} mm to the sixth neighbour"
        ),
        Row(name="height", value=f"{np.ptp(points_m[:, 1]):.2f} m"),
        *([] if internode_m is None else [Row(name="internode", value=f"{1000 * internode_m:.1f} mm")]),
        Row(
            name="branches",
            value=f"{len(skeleton):,}",
            remark=", ".join(f"{count} of order {order}" for order, count in enumerate(by_order)),
        ),
        Row(
            name="mean length",
            value=f"{skeleton.lengths_m.mean():.3f} m",
            remark=f"{skeleton.lengths_m.sum():.1f} m in all",
        ),
        Row(name="diameter at the root", value=f"{200 * skeleton.radius_m[0]:.1f} cm"),
        Row(
            name="scan to surface",
            value=f"{100 * to_surface_m.mean():.2f} cm, standard deviation {100 * to_surface_m.std():.2f} cm",
        ),
        Row(
            name="surface to scan",
            value=f"{100 * to_cloud_m.mean():.2f} cm, standard deviation {100 * to_cloud_m.std():.2f} cm",
        ),
        *([_exponent_row(traced, grown)] if has_circles else []),
        Row(name="cage", value=f"{len(cage.faces):,} faces", remark="Catmull–Clark, closed, all quads"),
        _whole_row(traced, cage),
    ]


def _whole_row(traced: TracedBranches, cage: BranchCage) -> Row:
    """Whether the surface is in one piece."""
    points_m, faces = refine_smooth(cage.points_m, cage.faces, 1) if len(cage.faces) else (cage.points_m, cage.faces)
    found = measure_wholeness(traced.skeleton, points_m, faces)
    value = f"{found.pieces} pieces, {found.afloat} afloat"
    return Row(name="wood", value=value, remark=f"{100 * found.bare:.2g} % of the axes' length without surface")


def _exponent_row(traced: TracedBranches, grown: bool) -> Row:
    """How radii change along branches, and from how many circles that was found."""
    return Row(
        name="exponent of the allometry" + (", as traced" if grown else ""),
        value=f"{traced.radii.exponent:.2f}",
        remark=f"{int(traced.radii.believed.sum())} circles believed"
        + (" along the branches that were traced; growth has their exponent" if grown else ""),
    )


def write_branches_report(
    folder: Path,
    interface: Path | None,
    report: BranchesReport,
    traced: TracedBranches,
    points_m: NDArray[np.float64],
    rows: Sequence[Row],
    seconds: Mapping[str, float],
    progress: StepProgress | None = None,
) -> WrittenReport:
    """Write index.html and its pictures into folder.

    Args:
        folder: An existing folder.
        interface: The asset, which Storm draws; None for no such pictures.
        report: The rest of its content.
        traced: The branches.
        points_m: (N, 3), the cloud in the asset's frame.
        rows: The figures.
        seconds: By step; none where the report does not show them.
        progress: Called at each picture of the asset.
    """
    chosen = np.linspace(0, len(points_m) - 1, min(len(points_m), DRAWN_POINTS)).astype(np.int64)
    cloud_m, wood_m = points_m[chosen], points_m[chosen][traced.wood[chosen]]
    weight = weigh_points(cloud_m, traced.internode_m)
    away_m = distances_to_surface(wood_m, traced.skeleton, traced.thickness_m)
    far_m = float(np.quantile(away_m, _FAR_QUANTILE)) or 1e-6
    heavy = float(np.quantile(weight, _FAR_QUANTILE)) or 1.0
    pictures, of_plant = [], []
    for what, title, drawn_m, colors, caption in (
        (
            "weights",
            "Importance of the points",
            cloud_m,
            color_values(weight, 0, heavy, VIRIDIS),
            f"Importance of the points (equation 8), 0 to {heavy:.0f}",
        ),
        (
            "distance",
            "Distance from cloud to surface",
            wood_m,
            color_values(away_m, 0, far_m, TURBO),
            f"Scan of wood to surface, 0 to {100 * far_m:.1f} cm",
        ),
    ):
        for direction, file in _draw_cloud(folder, what, drawn_m, colors, traced.spacing_m):
            pictures.append(ReportView(name=f"{caption}, from the {direction}", file=file))
            of_plant.append(ReportPicture(file=file, caption=title))
    missing: list[Remark] = []
    views = []
    if interface is not None:
        try:
            render_views(
                interface,
                [PreviewView(output=folder / file, direction=direction) for _, direction, file in VIEWS],
                _PREVIEW,
                progress_in_step("preview", progress),
            )
            views = [ReportView(name=title, file=file) for title, _, file in VIEWS]
            for variation in report.variations:
                file = f"preview_{variation.stem}.png"
                render_views(variation, [PreviewView(output=folder / file, direction="front")], _PREVIEW, None)
                views.append(ReportView(name=variation.stem, file=file))
        except PreviewError as error:
            missing.append(remark_missing_pictures(error))
    page = render_template(
        "branches_report.html",
        name=report.name,
        capture=report.capture,
        generator=report.generator,
        notes=list_sentences([*report.remarks, *missing], report.render_setting),
        views=views,
        pictures=pictures,
        measures=rows,
        settings=[Row(name=name, value=value) for name, value in report.settings.items()],
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8")
    write_step_times(folder, seconds)
    return WrittenReport(page=index, pictures=tuple(of_plant), remarks=tuple(missing))


def _draw_cloud(
    folder: Path, what: str, points_m: NDArray[np.float64], colors: NDArray[np.uint8], spacing_m: float
) -> list[tuple[str, str]]:
    """Two pictures of a cloud in colours; their directions and files."""
    directions = (_FRONT, _RIGHT)
    windows = frame_points(points_m, directions, PICTURE_PX, points_m)
    bar_m = bar_length(windows)
    files = []
    for direction, window in zip(directions, windows, strict=True):
        seen = splat_points(points_m, direction, window, np.full(len(points_m), 0.4 * spacing_m, np.float32))
        picture = draw_seen(seen, colors)
        draw_scale_bar(picture, bar_m, window.px_per_m)
        file = f"{what}_{direction.name}.png"
        write_picture(folder / file, picture)
        files.append((direction.name, file))
    return files
