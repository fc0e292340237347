"""The report of a tree out of a photograph: its strokes, leaves and branches in the picture, and how it grew."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.pictures import (
    MIN_SIDE_PX,
    PreviewSettings,
    PreviewView,
    remark_missing_pictures,
    render_views,
)
from usdfoliage.jobs.report.environment import render_template
from usdfoliage.jobs.report.pictures import write_picture
from usdfoliage.jobs.report.table import ReportView, Row
from usdfoliage.jobs.report.timings import write_step_times
from usdfoliage.jobs.sketch.model import SketchModel
from usdfoliage.progress import StepProgress, progress_in_step
from usdfoliage.remarks import Remark, RenderSetting, list_sentences
from usdfoliage.sketch.drawing import SHIFT, fixed_points
from usdfoliage.sketch.reconstruct import SketchedTree
from usdfoliage.sketch.strokes import TreeStrokes

PICTURE_PX = 900  # longer side of the pictures
SIDES = (
    ("Front", "front", "preview.png"),
    ("Right side", "right", "preview_right.png"),
    ("Back", "back", "preview_back.png"),
    ("Left side", "left", "preview_left.png"),
)
PHOTOGRAPH, OVER_PHOTOGRAPH = "photograph.jpg", "over_photograph.png"  # of one size, for the compare bar
PICTURES: Mapping[str, str] = MappingProxyType(  # captions by files
    {
        "strokes.jpg": "The strokes: the crown in red, branches in blue",
        "foliage.jpg": "The pixels that are leaves of the tree",
        "traced.jpg": "Branches that were traced: drawn ones in blue, found ones in red",
        "growth.jpg": "How the tree grew in six steps, from the front and from the side: branches of the photograph in "
        "brown, grown ones in green",
    }
)
GROWTH_STEPS = 6
_RED, _BLUE, _GREEN, _BROWN = (220, 40, 30), (30, 70, 220), (60, 170, 60), (110, 70, 30)

Picture = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True)
class SketchReport:
    """What the page of a tree has."""

    name: str
    photo: str
    generator: str
    rows: Sequence[Row]
    settings: Mapping[str, str]
    remarks: Sequence[Remark]
    render_setting: RenderSetting
    seconds: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class DrawnTree:
    """Pictures of the finished tree."""

    sides: tuple[ReportView, ...] = ()
    over_photograph: str = ""  # file of the tree as the photograph has it; empty without Storm


def draw_tree(
    interface: Path | None,
    model: SketchModel,
    folder: Path,
    remarks: list[Remark],
    progress: StepProgress | None = None,
) -> DrawnTree:
    """Pictures of the tree from four sides, and one that lies over the photograph; none where Storm cannot draw.

    Args:
        interface: The asset; None for no pictures.
        model: What it was written from.
        folder: Of the report.
        remarks: Gets one where there are no pictures.
        progress: Called at each picture.
    """
    if interface is None:
        return DrawnTree()
    views = [PreviewView(output=folder / file, direction=direction) for _, direction, file in SIDES]
    views.append(_view_over_photograph(model, folder / OVER_PHOTOGRAPH))
    try:
        settings = PreviewSettings(width_px=720, height_px=900)
        render_views(interface, views, settings, progress_in_step("preview", progress))
    except PreviewError as error:
        remarks.append(remark_missing_pictures(error))
        return DrawnTree()
    sides = tuple(ReportView(name=title, file=file) for title, _, file in SIDES)
    return DrawnTree(sides=sides, over_photograph=OVER_PHOTOGRAPH)


def _view_over_photograph(model: SketchModel, output: Path) -> PreviewView:
    """What shows the tree where the photograph has it, from the front and without perspective, in the same frame."""
    height_px, width_px = model.srgb.shape[:2]
    frame = model.tree.asset_from_photo
    left_m, top_m = frame[:2, 3]
    right_m, bottom_m = frame[:2, 3] + np.diag(frame)[:2] * [width_px, height_px]
    drawn = _shrink(model.srgb)[0].shape
    return PreviewView(
        output=output,
        direction="front",
        orthographic=True,
        window=(float(left_m), float(right_m), float(bottom_m), float(top_m)),
        size_px=(max(drawn[1], MIN_SIDE_PX), max(drawn[0], MIN_SIDE_PX)),
    )


def write_sketch_report(folder: Path, report: SketchReport, model: SketchModel, drawn: DrawnTree) -> Path:
    """Write index.html and its pictures into folder, which holds those of drawn; returns the page."""
    srgb, tree = model.srgb, model.tree
    drawings = (
        draw_strokes(srgb, model.strokes),
        draw_foliage(srgb, tree),
        draw_traced(srgb, tree),
        draw_growth(tree),
    )
    for file, picture in zip(PICTURES, drawings, strict=True):
        write_picture(folder / file, picture)
    if drawn.over_photograph:
        write_picture(folder / PHOTOGRAPH, _shrink(srgb)[0])
    page = render_template(
        "sketch_report.html",
        name=report.name,
        photo=report.photo,
        generator=report.generator,
        notes=list_sentences(report.remarks, report.render_setting),
        views=drawn.sides,
        compared=(PHOTOGRAPH, drawn.over_photograph) if drawn.over_photograph else None,
        pictures=[ReportView(name=title, file=file) for file, title in PICTURES.items()],
        measures=report.rows,
        settings=[Row(name=name, value=value) for name, value in report.settings.items()],
    )
    index = folder / "index.html"
    index.write_text(page, encoding="utf-8")
    write_step_times(folder, report.seconds)
    return index


def draw_strokes(srgb: Picture, strokes: TreeStrokes) -> Picture:
    """The photograph with the strokes over it."""
    picture, scale = _shrink(srgb)
    cv2.polylines(picture, [fixed_points(strokes.crown_px * scale)], True, _RED, 2, cv2.LINE_AA, SHIFT)
    for line in strokes.branches_px:
        cv2.polylines(picture, [fixed_points(line * scale)], False, _BLUE, 2, cv2.LINE_AA, SHIFT)
    return picture


def draw_foliage(srgb: Picture, tree: SketchedTree) -> Picture:
    """The photograph, grey where there are no leaves of the tree."""
    picture, _ = _shrink(srgb)
    mask = cv2.resize(tree.foliage.mask.astype(np.uint8), picture.shape[1::-1], interpolation=cv2.INTER_AREA) > 0
    grey = np.repeat(picture.mean(axis=2, keepdims=True) * 0.4 + 150, 3, axis=2).astype(np.uint8)
    return np.where(mask[..., None], picture, grey)


def draw_traced(srgb: Picture, tree: SketchedTree) -> Picture:
    """The photograph with the branches that were traced, drawn ones in blue."""
    picture, scale = _shrink(srgb)
    for branch in tree.traced.branches:
        color = _BLUE if branch.drawn else _RED
        cv2.polylines(picture, [fixed_points(branch.points_px * scale)], False, color, 2, cv2.LINE_AA, SHIFT)
    return picture


def draw_growth(tree: SketchedTree) -> Picture:
    """The tree at six stages of its growth, from the front above and from the side below."""
    axes = tree.grown.axes
    # Each axis stands behind those that it grew from. Equal factors, since each stage grows from all that there is.
    counts = np.rint(np.geomspace(tree.grown.traced, len(axes), GROWTH_STEPS)).astype(int)
    points = np.concatenate([axis.points for axis in axes])
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(float((high - low)[:2].max()), 1.0)
    side_px = PICTURE_PX // 3
    rows = []
    for across in (0, 2):
        row = []
        for count in counts.tolist():
            cell = np.full((side_px, side_px, 3), 255, np.uint8)
            middle = (low[across] + high[across]) / 2
            for axis in axes[:count]:
                flat = np.stack([axis.points[:, across] - middle, high[1] - axis.points[:, 1]], axis=-1)
                flat = flat * (0.94 * side_px / size) + [side_px / 2, 0.03 * side_px]
                color = _GREEN if axis.inferred else _BROWN
                cv2.polylines(cell, [fixed_points(flat)], False, color, 2 if axis.order == 0 else 1, cv2.LINE_AA, SHIFT)
            row.append(cell)
        rows.append(np.hstack(row))
    return np.vstack(rows)


def _shrink(srgb: Picture) -> tuple[Picture, float]:
    scale = min(1.0, PICTURE_PX / max(srgb.shape[:2]))
    size = max(1, round(srgb.shape[1] * scale)), max(1, round(srgb.shape[0] * scale))
    return np.ascontiguousarray(cv2.resize(srgb, size, interpolation=cv2.INTER_AREA)), scale
