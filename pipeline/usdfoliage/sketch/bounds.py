"""The space of a tree in one photograph: its silhouette, and how deep it is behind and before it.

Frame of the picture: x to the right and y up, in pixels (y is minus the photograph's), z towards the viewer, 0 in the
plane of the root.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.crown.silhouette import SilhouetteSettings, fit_star_silhouette
from usdfoliage.crown.surface import SurfaceSettings, inflate_silhouette
from usdfoliage.errors import FitError
from usdfoliage.sketch.drawing import close_gaps, rows_and_columns

Floats = NDArray[np.float64]

_CELLS = 96  # along the silhouette, that depth is known in
_NEAREST = 4  # points of the inflated surface, whose mean height is taken
_CLOSED = 0.05  # of the crown's width, gaps of the leaves that are inside
_DRAWN_OUTSIDE = 0.04  # of the crown's width, that a stroke is drawn outside of twigs
_NARROW = 0.01  # of the crown's width, half of gaps that are as leaves
_DEEPER = (1.0, 1.5)  # times the inflated surface
_SHALLOW = 0.15  # of the crown's width: half of the depth at least, where a shoot leaves the inflated surface


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownBounds:
    """Where leaves and branches of a tree may be."""

    leaves: NDArray[np.bool_]  # (H, W) that the photograph shows
    inside: NDArray[np.bool_]  # (H, W) these with the gaps between them
    half_depth: NDArray[np.float32]  # (H, W) pixels, 0 outside

    def rows_and_columns(self, points: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Pixel of each point (..., 2 or 3), and whether it is in the picture."""
        return rows_and_columns(points, self.inside.shape)

    def contains(self, points: Floats) -> NDArray[np.bool_]:
        """(...,) whether points (..., 3) are inside."""
        row, column, within = self.rows_and_columns(points)
        deep = np.abs(points[..., 2]) <= self.half_depth[row, column]
        return np.asarray(within & self.inside[row, column] & deep)

    def shows_leaves(self, points: Floats) -> NDArray[np.bool_]:
        """(...,) whether the photograph shows leaves where points (..., 2 or 3) are in it."""
        row, column, within = self.rows_and_columns(points)
        return np.asarray(within & self.leaves[row, column])


def bound_crown(leaves: NDArray[np.bool_], depth: float = 1.0, drawn: NDArray[np.bool_] | None = None) -> CrownBounds:
    """The space of a crown: as deep as it is wide, by its inflated silhouette.

    Args:
        leaves: (H, W), as the photograph shows them.
        depth: Times as deep.
        drawn: (H, W), inside of the stroke, for a bare tree: its finest twigs are not seen, and the stroke is.

    Raises:
        FitError: There are too few leaves.
    """
    columns = np.flatnonzero(leaves.any(axis=0))
    if len(columns) < 8:
        raise FitError("the crown's stroke holds no leaves", "draw the stroke around the leaves of the tree")
    width_px = float(np.ptp(columns) + 1)
    reach = max(1, round(_CLOSED * width_px / 2))
    closed = close_gaps(leaves, reach).astype(np.uint8)
    filled = np.zeros_like(closed)
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    large = [each for each in contours if cv2.contourArea(each) > 0.0005 * width_px**2]
    cv2.drawContours(filled, large or contours, -1, 1, cv2.FILLED)
    inside = filled > 0
    if drawn is not None:
        away = cv2.distanceTransform(drawn.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        inside |= away > _DRAWN_OUTSIDE * width_px
    inflated = _inflate(inside)
    inflated *= _as_deep_as_wide(inside, inflated)
    return CrownBounds(
        # A leaf in space may cover a narrow gap.
        leaves=close_gaps(leaves, max(1, round(_NARROW * width_px))) & inside,
        inside=inside,
        half_depth=np.where(inside, np.maximum(depth * inflated, _thinnest_depth(inside, width_px)), 0).astype(
            np.float32
        ),
    )


def _as_deep_as_wide(inside: NDArray[np.bool_], half_depth: Floats) -> float:
    """A factor of the depth, by which the crown is on average as deep as it is wide, row by row.

    A limb that stands out makes the silhouette wide, and is itself hardly inflated; on the other sides there are such
    limbs too.
    """
    rows = inside.any(axis=1)
    width = inside.shape[1] - inside[rows].argmax(axis=1) - inside[rows, ::-1].argmax(axis=1)
    deep = 2 * float(half_depth.max(axis=1).sum())
    return float(np.clip(width.sum() / deep, *_DEEPER)) if deep > 0 else 1.0


def _thinnest_depth(inside: NDArray[np.bool_], width_px: float) -> NDArray[np.float32]:
    """(H, W) half of the depth of shoots beyond the surface: as of a rod that is as wide."""
    away = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.minimum(away, np.float32(_SHALLOW * width_px))


def _inflate(inside: NDArray[np.bool_]) -> Floats:
    """(H, W) height of the inflated silhouette over the picture, in pixels."""
    scale = min(1.0, 256 / max(inside.shape))
    small = cv2.resize(inside.astype(np.float32), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) > 0.5
    count, labels, stats, _ = cv2.connectedComponentsWithStats(small.astype(np.uint8))
    if count < 2:
        return np.zeros(inside.shape)
    largest = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    silhouette = fit_star_silhouette(largest, SilhouetteSettings(angles=256, search_px=64, search_angles=64))
    surface = inflate_silhouette(silhouette, SurfaceSettings(grid=_CELLS))
    cell = surface.cell_px
    x = silhouette.center_px[0] + cell * surface.points[:, 0]
    y = silhouette.center_px[1] - cell * surface.points[:, 1]
    row, column = np.nonzero(largest)
    # Points are denser than a cell everywhere: means of the nearest ones do, and cost less than a triangulation.
    places = np.column_stack([column, row]) + 0.5
    away, near = (np.asarray(each) for each in cKDTree(np.column_stack([x, y])).query(places, k=_NEAREST))
    weight = 1 / (away**2 + (0.1 * cell) ** 2)
    height = (weight * surface.points[near, 2]).sum(axis=1) / weight.sum(axis=1)
    depth = np.zeros(small.shape)
    depth[row, column] = cell * np.where(away[:, 0] < 2 * cell, height, 0.0)
    whole = cv2.resize(np.maximum(depth, 0) / scale, inside.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole, np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class SideView:
    """A crown from the right side of its picture. Rows are those of the picture."""

    from_picture: Floats  # (4, 4), from the frame of the picture to that of the view
    inside: NDArray[np.bool_]  # (H, D)


def view_from_the_side(bounds: CrownBounds) -> SideView:
    """What the space of a crown covers, seen along x, by its depth in each row."""
    deep = np.where(bounds.inside, bounds.half_depth, 0).max(axis=1)
    half = int(np.ceil(deep.max())) + 1
    column = np.arange(2 * half) + 0.5 - half
    x = np.flatnonzero(bounds.inside.any(axis=0))
    from_picture = np.array([[0, 0, -1, half], [0, 1, 0, 0], [1, 0, 0, -x.mean() - 0.5], [0, 0, 0, 1.0]])
    return SideView(from_picture=from_picture, inside=np.abs(column) < deep[:, None])
