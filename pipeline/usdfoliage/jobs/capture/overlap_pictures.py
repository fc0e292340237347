"""Which photographs share what: cameras from above with lines between them, and a matrix."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.capture.map_pictures import LegendPicture, draw_shared, in_words, make_legend
from usdfoliage.jobs.capture.photograph import CapturePhotograph
from usdfoliage.jobs.report.cloud_pictures import (
    Direction,
    bar_length,
    draw_scale_bar,
    draw_seen,
    frame_points,
    splat_points,
)
from usdfoliage.jobs.report.pictures import VIRIDIS, write_picture

PLAN_PX = 900
MATRIX_PX = 640
MAX_LABELS = 60  # cameras in a plan that have their number beside them
PALE = 0.55  # of the colours' strength that is left below a plan
FEW_SHARED = 0.05  # of the most, below which no line is drawn between two cameras
CAMERA_PX = (0.012 * PLAN_PX, 0.035 * PLAN_PX)  # length of a camera, at least and at most
CAMERA_SHARE = 0.35  # of the distance to the next one
MIN_OPACITY, MAX_OPACITY = 0.08, 0.68  # of lines
LABEL_PX = 11  # from a camera's place


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
    cameras: Sequence[PlanCamera]
    lines: Sequence[PlanLine]
    caption: str


def find_links(
    photographs: Sequence[CapturePhotograph], shared: NDArray[np.floating] | None
) -> dict[tuple[int, int], float]:
    """How much pairs of photographs with cameras share: matches; or how often one was chosen as a source of the other.

    Args:
        photographs: All of them.
        shared: (N, N), matches; None where there are none, as of poses that were given.
    """
    links: dict[tuple[int, int], float] = {}
    for number, photograph in enumerate(photographs):
        if photograph.camera is None:
            continue
        others = photograph.sources if shared is None else np.flatnonzero(shared[number] > 0).tolist()
        for other in others:
            if other != number and photographs[other].camera is not None:
                pair = min(number, other), max(number, other)
                links[pair] = links.get(pair, 0.0) + 1.0 if shared is None else float(shared[number, other])
    return links


def find_groups(photographs: Sequence[CapturePhotograph], links: Mapping[tuple[int, int], float]) -> list[list[int]]:
    """Photographs with cameras that are linked, one by one or through others, the largest group first."""
    near: dict[int, set[int]] = {
        number: set() for number, photograph in enumerate(photographs) if photograph.camera is not None
    }
    for one, other in links:
        near[one].add(other)
        near[other].add(one)
    groups, left = [], set(near)
    while left:
        reached: set[int] = set()
        new = {min(left)}
        while new:
            reached |= new
            new = {other for number in new for other in near[number]} - reached
        groups.append(sorted(reached))
        left -= reached
    return sorted(groups, key=len, reverse=True)


def write_plan(
    folder: Path,
    photographs: Sequence[CapturePhotograph],
    links: Mapping[tuple[int, int], float],
    cloud: Cloud,
    widths_m: NDArray[np.floating],
    framed_m: NDArray[np.float64],
    top: Direction,
) -> Plan:
    """Write the cloud from above, and lay out the cameras over it.

    Args:
        folder: Of the report.
        photographs: All; at least one has a camera.
        links: Of find_links.
        cloud: What is shown below.
        widths_m: (N,), of its points.
        framed_m: (M, 3), points that must be in the picture, with the cameras.
        top: How it is looked at.

    Raises:
        WriteError: The picture cannot be written.
    """
    cameras = {
        number: photograph.camera for number, photograph in enumerate(photographs) if photograph.camera is not None
    }
    places_m = np.array([camera.position_m for camera in cameras.values()])
    (window,) = frame_points(framed_m, [top], PLAN_PX, places_m)
    picture = draw_seen(splat_points(cloud.points_m, top, window, widths_m), _paler(cloud.srgb))
    bar_m = bar_length([window])
    draw_scale_bar(picture, bar_m, window.px_per_m)
    places = dict(zip(cameras, window.places(places_m, top), strict=True))
    gap_px = _typical_gap(np.array(list(places.values())))
    reach_m = float(np.clip(CAMERA_SHARE * gap_px, *CAMERA_PX)) / window.px_per_m
    drawn = [
        _draw_camera(
            places[number],
            window.places(_picture_corners(camera, reach_m), top),
            number,
            photographs[number],
            labelled=len(cameras) <= MAX_LABELS,
        )
        for number, camera in cameras.items()
    ]
    highest = max(links.values(), default=1.0)
    lines = [
        PlanLine(
            x1=round(float(places[one][0]), 1),
            y1=round(float(places[one][1]), 1),
            x2=round(float(places[other][0]), 1),
            y2=round(float(places[other][1]), 1),
            opacity=round(MIN_OPACITY + (MAX_OPACITY - MIN_OPACITY) * float(np.sqrt(strength / highest)), 3),
        )
        for (one, other), strength in sorted(links.items(), key=lambda link: link[1])
        if strength >= FEW_SHARED * highest
    ]
    return Plan(
        file=write_picture(folder / "plan.jpg", picture),
        width=picture.shape[1],
        height=picture.shape[0],
        cameras=[camera for camera in drawn if camera.without_depth] + [c for c in drawn if not c.without_depth],
        lines=lines,
        caption=f"From above, the front below; the bar is {in_words(bar_m)}. Each triangle is a camera, its tip where "
        "it stands; grey where it has no depth. Lines join photographs that share matches, or were matched with each "
        "other for their depth; stronger for more.",
    )


def write_matrix(
    folder: Path, photographs: Sequence[CapturePhotograph], shared: NDArray[np.floating] | None
) -> LegendPicture:
    """Write who shares what with whom as squares.

    Raises:
        WriteError: The picture cannot be written.
    """
    count = len(photographs)
    if shared is not None:
        values = np.asarray(shared, np.float64)
        caption = f"Matches between photographs 0 to {count - 1}, left to right and top to bottom; white for none."
        legend = make_legend("few", f"{values.max(initial=0):,.0f} matches", VIRIDIS)
    else:
        values = np.zeros((count, count))
        for number, photograph in enumerate(photographs):
            for rank, source in enumerate(photograph.sources):
                values[number, source] = len(photograph.sources) - rank
        caption = "Which photographs (from left to right) each one (from top to bottom) was matched with for its depth."
        legend = make_legend("last", "first choice", VIRIDIS)
    picture = draw_shared(values, MATRIX_PX)
    file = write_picture(folder / "shared.png", picture)
    return LegendPicture(file=file, caption=caption, width=picture.shape[1], legend=legend)


def _picture_corners(camera: Pinhole, reach_m: float) -> NDArray[np.float64]:
    """(4, 3), in the world, the corners of a picture so near that the farthest is that far from the camera."""
    width, height = camera.width_px, camera.height_px
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64)
    rays = np.column_stack([(corners - camera.center_px) / camera.focal_px, np.ones(4)])
    rays *= reach_m / np.linalg.norm(rays, axis=1).max()
    return np.asarray(camera.position_m + rays @ camera.cam_from_world[:, :3])


def _draw_camera(
    place: NDArray[np.float64],
    corners: NDArray[np.float64],
    number: int,
    photograph: CapturePhotograph,
    *,
    labelled: bool,
) -> PlanCamera:
    outline = cv2.convexHull(np.concatenate([place[None], corners]).astype(np.float32))[:, 0]
    away = place - corners.mean(axis=0)
    label = place + LABEL_PX * away / max(float(np.linalg.norm(away)), 1e-9)
    return PlanCamera(
        points=" ".join(f"{x:.1f},{y:.1f}" for x, y in outline),
        x=round(float(place[0]), 1),
        y=round(float(place[1]), 1),
        label_x=round(float(label[0]), 1),
        label_y=round(float(label[1]), 1),
        label=str(number) if labelled else "",
        title=f"{number}: {photograph.name}",
        without_depth=not photograph.coverage,
    )


def _paler(srgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colours (N, 3) below what is drawn over them."""
    return np.asarray(255 - (255 - srgb.astype(np.float32)) * PALE, np.uint8)


def _typical_gap(places: NDArray[np.float64]) -> float:
    """Median distance of places (N, 2) to the nearest other one; 0 for a single one."""
    if len(places) < 2:
        return 0.0
    away, _ = cKDTree(places).query(places, k=2)
    return float(np.median(np.asarray(away)[:, 1]))
