"""Where depth maps show what is thin and no leaf: stalks and twigs. Our own."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.reprojection import draw_leaf_ids
from usdfoliage.leaf.photographs.visibility import find_open_holes
from usdfoliage.leaf.shape.surface import evaluate_points

BOTH_ENDS = np.array([[0.0, 0.0], [0.0, 1.0]])
DECODED = decode_srgb(np.arange(256) / 255.0)  # (256,), linear
DARKEST = 1 / 255  # linear; darker, noise decides what the ratio of two channels is
NOISE_BINS = 16  # of depth, in which noise is measured
SAMPLE_STEP = 7  # one pixel of so many is enough for noise, and for the colour of leaves
NOISE_QUANTILE = 0.8  # of what a median filter changes: of pure noise a standard deviation, or a little more
NOISE_WIDTHS = 5.0
FOREIGN = 3.0  # standard deviations of the leaves' colour; beyond, a colour is not theirs
MIN_COLORS = 50  # pixels of leaves, below which nobody knows their colour
ENOUGH_PX = 150  # length of a leaf, above which every other pixel, or every third, will do
FINE_PX = 3  # median filter against single wrong pixels; stalks narrower than 2 pixels go with them


@dataclass(frozen=True, kw_only=True)
class StalkSettings:
    """What counts as thin, in lengths of the median leaf."""

    width: float = 0.15  # A stalk is at most this wide. Unit: median leaf lengths. Range: above 0.
    # The surface beside a stalk lies behind it by at least this much. Unit: median leaf lengths. Range: above 0.
    jump: float = 0.15
    # Stalks are searched up to this distance from base or apex. Unit: median leaf lengths. Range: above 0.
    reach: float = 0.5
    cell: float = 0.04  # Points in one cell of this side count as one. Unit: median leaf lengths. Range: above 0.
    # Depth belongs to a leaf up to this many standard deviations from it. Unit: standard deviations. Range: above 0.
    widths: float = 4.0

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")


class StalkPoints(NamedTuple):
    """Points near bases and apices that may be of stalks, one a cell."""

    points_m: NDArray[np.float64]  # (Q, 3), in the world
    foreign: NDArray[np.float64]  # (Q,), share of pixels whose colour is not that of leaves


class _Seen(NamedTuple):
    """What one view shows."""

    points_m: NDArray[np.float64]  # (K, 3), that may be of stalks
    colors: NDArray[np.float64]  # (K, 2)
    leaf_colors: NDArray[np.float64]  # (L, 2)


_NOTHING = _Seen(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 2)))


def find_stalk_points(
    leaves: Leaves,
    views: Sequence[View],
    spread: float,
    settings: StalkSettings = StalkSettings(),
    *,
    threads: int = 0,
) -> StalkPoints:
    """Collect what stands before its surroundings, is narrow, and is none of the leaves.

    Args:
        leaves: In the world of the views.
        spread: As leaf.visibility.estimate_spread gives it.
        threads: That look at views; 0: one per core. The result is the same.
    """
    if not len(leaves):
        return StalkPoints(np.zeros((0, 3)), np.zeros(0))
    ends_m = evaluate_points(leaves.parameters, BOTH_ENDS, placements=leaves.asset_from_leaf()).reshape(-1, 3)

    def scan(view: View) -> _Seen:
        return _scan_view(leaves, ends_m, view, spread, settings)

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        seen = [_NOTHING, *pool.map(scan, [view for view in views if view.has_depth])]
    points_m, colors, leaf_colors = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    return _one_a_cell(points_m, _is_foreign(colors, leaf_colors), settings.cell * float(np.median(leaves.length_m)))


def _scan_view(
    leaves: Leaves, ends_m: NDArray[np.float64], view: View, spread: float, settings: StalkSettings
) -> _Seen:
    length_m = float(np.median(leaves.length_m))
    drawn = draw_leaf_ids(leaves, view.camera, threads=1)
    if not (drawn.ids >= 0).any():
        return _NOTHING
    distance_m = float(np.median(drawn.depth_m[drawn.ids >= 0]))
    length_px = length_m * max(view.camera.focal_px) / distance_m
    step = max(1, int(length_px / ENOUGH_PX))
    depth_m, drawn_m = view.depth_m[::step, ::step], drawn.depth_m[::step, ::step]
    allowed_m = np.maximum(settings.widths * spread * length_m, 3 * step * depth_m / max(view.camera.focal_px))
    of_leaf = (drawn_m > 0) & (depth_m > 0) & (np.abs(depth_m - drawn_m) <= allowed_m)
    beside_leaf = cv2.dilate(of_leaf.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    wanted = _near_ends(ends_m, leaves.length_m, view, settings.reach)[::step, ::step] & ~beside_leaf
    if view.mask is not None:
        wanted &= view.mask[::step, ::step]
    rows, columns = _find_thin(depth_m, settings.width * length_px / step, settings.jump * length_m, wanted)
    places = np.column_stack([columns, rows]) * step + 0.5
    srgb = view.srgb[::step, ::step]
    return _Seen(
        points_m=view.camera.unproject(places, depth_m[rows, columns].astype(np.float64)),
        colors=_chroma(srgb[rows, columns]),
        leaf_colors=_chroma(srgb[of_leaf][::SAMPLE_STEP]),
    )


def _find_thin(
    depth_m: NDArray[np.float32], width_px: float, jump_m: float, wanted: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of what stands before its surroundings on both sides, is not noise, and is wanted (H, W)."""
    filled = _fill_from_behind(depth_m, width_px, jump_m)
    smooth = cv2.medianBlur(filled, FINE_PX)
    radius = max(1, round(width_px / 2))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    before_m = cv2.morphologyEx(smooth, cv2.MORPH_CLOSE, disc) - depth_m
    change_m = np.abs(filled - smooth)
    rows, columns = np.nonzero(wanted & (depth_m > 0) & (before_m > jump_m))
    noise_m = NOISE_WIDTHS * _noise_by_depth(depth_m, change_m, depth_m[rows, columns])
    real = (change_m[rows, columns] <= np.maximum(jump_m / 3, noise_m)) & (before_m[rows, columns] > noise_m)
    return rows[real], columns[real]


def _fill_from_behind(depth_m: NDArray[np.float32], width_px: float, jump_m: float) -> NDArray[np.float32]:
    """Depth with the greatest one around in place of holes: those beside a stalk show what is behind it.

    Wide holes are the open sky, or what is too far to be measured.
    """
    holes = depth_m <= 0
    if not holes.any():
        return depth_m
    size = 2 * max(1, round(width_px / 2)) + 1
    around = cv2.dilate(depth_m, np.ones((size, size), np.uint8))
    around = np.where((around > 0) & ~find_open_holes(depth_m, 2 * width_px), around, depth_m.max() + 2 * jump_m)
    return np.where(holes, around.astype(np.float32), depth_m)


def _noise_by_depth(
    depth_m: NDArray[np.float32], change_m: NDArray[np.float32], asked_m: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(K,), how much single pixels differ from those around, at depths (K,): noise grows with the distance."""
    some_m, changes_m = depth_m.ravel()[::SAMPLE_STEP], change_m.ravel()[::SAMPLE_STEP]
    known = some_m > 0
    if not known.any():
        return np.zeros(len(asked_m), np.float32)
    some_m, changes_m = some_m[known], changes_m[known]
    borders = np.quantile(some_m, np.linspace(0, 1, NOISE_BINS + 1))
    noise_m = np.zeros(NOISE_BINS, np.float32)
    bins = np.searchsorted(borders[1:-1], some_m)
    for number in range(NOISE_BINS):
        inside = changes_m[bins == number]
        if len(inside):
            noise_m[number] = np.quantile(inside, NOISE_QUANTILE)
    centers = (borders[:-1] + borders[1:]) / 2
    return np.interp(asked_m, centers, noise_m).astype(np.float32)


def _near_ends(
    ends_m: NDArray[np.float64], length_m: NDArray[np.float64], view: View, reach: float
) -> NDArray[np.bool_]:
    """(H, W), pixels within reach of a base or apex, as far as the picture shows."""
    places, depth_m = view.camera.project(ends_m)
    radius_px = reach * np.repeat(length_m, 2) * max(view.camera.focal_px) / np.maximum(depth_m, 1e-12)
    size = np.array([view.camera.width_px, view.camera.height_px])
    radius_px = np.minimum(radius_px, size.max())
    with np.errstate(invalid="ignore"):
        in_picture = ((places > -radius_px[:, None]) & (places < size + radius_px[:, None])).all(axis=1)
    near = np.zeros(view.depth_m.shape, np.uint8)
    centers, radii = np.rint(places[in_picture]).astype(int).tolist(), (radius_px[in_picture].astype(int) + 1).tolist()
    for center, radius in zip(centers, radii, strict=True):
        cv2.circle(near, center, radius, 1, cv2.FILLED)
    return near > 0


def _chroma(encoded: NDArray[np.uint8]) -> NDArray[np.float64]:
    """(K, 2), red and blue against green, in octaves: what light and shade do not change."""
    linear = np.maximum(DECODED[encoded], DARKEST)
    return np.asarray(np.log2(linear[:, [0, 2]] / linear[:, [1]]))


def _is_foreign(colors: NDArray[np.float64], of_leaves: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K,), 1 where a colour is none that leaves have, 0 elsewhere."""
    if len(of_leaves) < MIN_COLORS:
        return np.zeros(len(colors))
    away = of_leaves - np.median(of_leaves, axis=0)
    scatter = np.cov(away.T) + 1e-6 * np.eye(2)
    offset = colors - np.median(of_leaves, axis=0)
    distance = np.einsum("ki,ij,kj->k", offset, np.linalg.inv(scatter), offset)
    return np.asarray(distance > FOREIGN**2, np.float64)


def _one_a_cell(points_m: NDArray[np.float64], foreign: NDArray[np.float64], cell_m: float) -> StalkPoints:
    """Means over cubic cells; cells of one pixel only are left out as noise."""
    if not len(points_m):
        return StalkPoints(points_m, foreign)
    cells = np.floor((points_m - points_m.min(axis=0)) / cell_m).astype(np.int64)
    count = cells.max(axis=0) + 1
    flat = (cells[:, 0] * count[1] + cells[:, 1]) * count[2] + cells[:, 2]
    _, place, pixels = np.unique(flat, return_inverse=True, return_counts=True)
    mean = np.stack([np.bincount(place, column) / pixels for column in (*points_m.T, foreign)], axis=1)
    mean = mean[pixels > 1]
    return StalkPoints(mean[:, :3], mean[:, 3])
