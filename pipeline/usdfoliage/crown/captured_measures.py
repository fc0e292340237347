"""How well a crown agrees with the capture that it was made from."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.crown.crown_points import CrownCenter
from usdfoliage.crown.model import CrownModel
from usdfoliage.crown.silhouette_view import draw_silhouette
from usdfoliage.crown.views import ReducedView
from usdfoliage.geometry.cubemap import face_coordinates, face_directions, sample_cubemap
from usdfoliage.geometry.picture_agreement import silhouette_iou
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.remarks import Remark

# Gaps between points that a silhouette of them does not show: of the median radius, as between leaves, and distances to
# the sixth neighbour, as between the points of a sparse cloud.
_GAP, _SPACINGS = 0.06, 1.6
_NEIGHBOR, _ASKED = 6, 5000  # points that the spacing is measured from


@dataclass(frozen=True, kw_only=True)
class ViewMeasure:
    """How well a crown agrees with one view."""

    name: str
    texels: int  # that it sees; 0 of a cloud alone, whose views are no photographs
    cloud_iou: float  # of the crown's silhouette and that of the crown's points
    mask_iou: float | None  # of the crown's silhouette and the mask without the trunk; None without a mask


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturedCrownMeasures:
    """How well the crown repeats its capture, and what it took."""

    center: CrownCenter
    base_m: float
    points: int  # of the crown
    outliers: int
    known: float  # share of directions in which there are points
    carved: float | None  # share of directions that photographs made shorter; None of a cloud alone
    seen: float  # share of texels that a photograph shows; of a cloud alone, that have the colour of a point
    volume_m3: float
    distance_m: float  # median, of the outermost points from the surface along their direction
    views: tuple[ViewMeasure, ...]
    remarks: tuple[Remark, ...]
    seconds: dict[str, float] = field(default_factory=dict)  # by step


def measure_view(
    model: CrownModel,
    view: ReducedView,
    crown_m: NDArray[np.float64],
    below_m: NDArray[np.float64],
    texels: int,
    spacing_m: float = 0.0,
) -> ViewMeasure:
    """Compare the crown's silhouette with those of its points and of the mask.

    Args:
        model: The crown.
        view: A photograph.
        crown_m: (N, 3), the crown's points.
        below_m: (M, 3), points of the plant below the crown: what of a mask is near them alone is trunk.
        texels: That the view sees.
        spacing_m: Of the crown's points: what lies between those closer than that is the crown as well.
    """
    camera = view.camera
    median_m = float(np.median(model.radius_m))
    gap_m = max(_GAP * median_m, _SPACINGS * spacing_m)
    gap_px = gap_m * camera.focal_px[0] / float(camera.project(model.center_m[None])[1][0])
    crown = draw_silhouette(model.radius_m, model.center_m, camera)
    mask_iou = None
    if view.mask is not None and view.mask.any():
        trunk = draw_points(below_m, camera, gap_px) & ~draw_points(crown_m, camera, gap_px)
        mask_iou = silhouette_iou(crown & ~trunk, view.mask & ~trunk)
    cloud_iou = silhouette_iou(crown, draw_points(crown_m, camera, gap_px))
    return ViewMeasure(name=view.name, texels=texels, cloud_iou=cloud_iou, mask_iou=mask_iou)


def point_spacing(points_m: NDArray[np.float64]) -> float:
    """Median distance of points (N, 3) to their sixth neighbour; 0 where there are fewer."""
    if len(points_m) <= _NEIGHBOR:
        return 0.0
    some = points_m[:: max(1, len(points_m) // _ASKED)]
    return float(np.median(cKDTree(points_m).query(some, k=[_NEIGHBOR + 1], workers=-1)[0]))


def draw_points(points_m: NDArray[np.float64], camera: Pinhole, gap_px: float) -> NDArray[np.bool_]:
    """(H, W), where points (N, 3) are seen, and what lies between points closer than gap_px."""
    place, depth_m = camera.project(points_m)
    seen = (depth_m > 0) & (place >= 0).all(axis=1)
    seen &= (place[:, 0] < camera.width_px) & (place[:, 1] < camera.height_px)
    drawn = np.zeros((camera.height_px, camera.width_px), np.uint8)
    column, row = place[seen].astype(np.intp).T
    drawn[row, column] = 1
    side = 2 * max(1, round(gap_px / 2)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    padded = np.pad(drawn, side)
    return np.asarray(cv2.morphologyEx(padded, cv2.MORPH_CLOSE, kernel)[side:-side, side:-side] > 0)


def crown_volume(radius_m: NDArray[np.floating]) -> float:
    """Volume in cubic metres within a radius cubemap (6, N, N)."""
    size = radius_m.shape[1]
    across = np.linspace(-1, 1, size)
    solid = (1 + across[:, None] ** 2 + across**2) ** -1.5 * (2 / (size - 1)) ** 2
    edge = np.ones(size)
    edge[[0, -1]] = 0.5  # of a border texel half lies on the face
    return float((np.asarray(radius_m, np.float64) ** 3 / 3 * solid * np.outer(edge, edge)).sum())


def distance_from_points(model: CrownModel, crown_m: NDArray[np.float64], size: int = 48) -> float:
    """Median distance, along the direction, between the surface and the outermost point of each cell of directions."""
    offset_m = crown_m - model.center_m
    away_m = np.linalg.norm(offset_m, axis=1)
    face, row, column = face_coordinates(offset_m[away_m > 0], size)
    away_m = away_m[away_m > 0]
    cell = (face * size + np.rint(row).astype(np.intp)) * size + np.rint(column).astype(np.intp)
    outermost_m = np.zeros(6 * size * size)
    np.maximum.at(outermost_m, cell, away_m)
    there = outermost_m > 0
    surface_m = sample_cubemap(model.radius_m, face_directions(size)).ravel()
    return float(np.median(np.abs(surface_m[there] - outermost_m[there])))
