"""Which places of which leaf a photograph shows.

A place is seen where the photograph's depth is that of the leaf; where there is no depth, the leaves themselves decide
which of them stands before the others. What is tolerated follows from the data: how far leaves and depth differ where
they meet, and how much the depth changes within a pixel. Our own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.reprojection import DrawnLeaves, DrawSettings, draw_leaf_ids
from usdfoliage.leaf.shape.surface import evaluate_normals, grid_places

HIDDEN, SEEN, PRESUMED, ABSENT, BESIDE = 0, 1, 2, 3, 4
# HIDDEN: something stands before the place, it lies outside of the picture, or nobody knows.
# SEEN: the depth is that of the leaf.
# PRESUMED: no depth is known, at most beside it, but of all leaves this one is nearest.
# ABSENT: what is seen, there and in the pixels around, lies behind the place: the real leaf does not reach there.
# BESIDE: what is seen there lies behind, but a pixel beside has the leaf's depth.

STEEPEST = 0.1  # cosine below which a surface counts as this steep
HALF_DIAGONAL_PX = 0.75  # how far a place lies from its pixel's centre, or a little more
AROUND_PX = 3.0  # diagonal of a pixel with those around it, from centre to centre
COARSE_PX = 16  # what is wider is found in fewer pixels
WIDE_HOLE = 0.15  # leaf lengths
FIRST_GATE = 0.1  # of the length: farther from the leaf, depth is surely of something else
GATE_TURNS = 6
SAMPLES = grid_places(np.linspace(-0.8, 0.8, 5), np.linspace(0.1, 0.9, 9))  # where leaves and depth are compared


@dataclass(frozen=True, kw_only=True)
class VisibilitySettings:
    """When depth counts as that of a leaf."""

    # Depth belongs to a leaf up to this many standard deviations from it. Unit: standard deviations. Range: above 0.
    widths: float = 3.0
    # The standard deviation of depth about leaves is at least this much; without depth it is this much. Unit: leaf
    # lengths. Range: above 0.
    min_spread: float = 0.005
    draw: DrawSettings = field(default_factory=DrawSettings)

    def __post_init__(self) -> None:
        for name in ("widths", "min_spread"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")


class Sights(NamedTuple):
    """What one photograph shows of N leaves at P places each."""

    places_px: NDArray[np.float64]  # (N, P, 2), x and y; NaN behind the camera
    state: NDArray[np.uint8]  # (N, P), HIDDEN, SEEN, PRESUMED, ABSENT or BESIDE
    facing: NDArray[np.float64]  # (N, P), cosine between normal and ray to the camera; below 0 the underside is seen
    inner: NDArray[np.bool_]  # (N, P), seen or presumed, and so are the pixels around


def estimate_spread(
    leaves: Leaves, views: Sequence[View], settings: VisibilitySettings = VisibilitySettings()
) -> float:
    """Standard deviation of depth about the leaves it belongs to, in leaf lengths; settings.min_spread at least.

    Fit and depth both contribute. Robust: what lies farther from a leaf than a few deviations is of something else.
    """
    differences = [np.zeros(0)]
    for view in views:
        if not view.has_depth:
            continue
        project = _project(leaves, view, SAMPLES)
        known = project.seen_m > 0
        # Along the normal, so that steep leaves count as the others.
        away = (project.seen_m - project.depth_m) * np.abs(project.facing) / leaves.length_m[:, None]
        differences.append(away[known])
    away = np.abs(np.concatenate(differences))
    gate, spread = FIRST_GATE, settings.min_spread
    for _ in range(GATE_TURNS):
        near = away[away < gate]
        if not len(near):
            break
        spread = max(1.4826 * float(np.median(near)), settings.min_spread)
        gate = min(FIRST_GATE, settings.widths * spread)
    return spread


def find_sights(
    leaves: Leaves,
    view: View,
    uv: NDArray[np.floating],
    spread: float,
    settings: VisibilitySettings = VisibilitySettings(),
    drawn: DrawnLeaves | None = None,
    holes: NDArray[np.bool_] | None = None,
) -> Sights:
    """Find which places of leaves a photograph shows.

    Args:
        leaves: In the world of the view.
        uv: (P, 2), the same for all leaves.
        spread: As estimate_spread gives it.
        drawn: All leaves of the scene as this camera sees them, those asked for or more; drawn here where depth is
            missing and it is not given.
        holes: As find_open gives it for all leaves of the scene; found here for those asked for where it is needed and
            not given.
    """
    project = _project(leaves, view, uv)
    steepness = np.sqrt(1 / np.maximum(np.abs(project.facing), STEEPEST) ** 2 - 1)
    footprint_m = project.depth_m / np.sqrt(view.camera.focal_px[0] * view.camera.focal_px[1])
    spread_m = settings.widths * spread * leaves.length_m[:, None]
    allowed_m = spread_m + HALF_DIAGONAL_PX * footprint_m * steepness
    around_m = 2 * spread_m + AROUND_PX * footprint_m * steepness

    state = np.zeros(project.inside.shape, np.uint8)
    known = project.seen_m > 0
    away_m = project.seen_m - project.depth_m
    with np.errstate(invalid="ignore"):
        state[known & (np.abs(away_m) <= allowed_m)] = SEEN
        behind = known & (away_m > allowed_m)
    nearest_m, farthest_m = _extremes(view.depth_m, project)
    state[behind] = np.where(nearest_m - project.depth_m <= allowed_m, BESIDE, ABSENT)[behind]
    inner = (state == SEEN) & (nearest_m > 0) & (farthest_m - nearest_m <= around_m)

    blank = project.inside & ~known
    if blank.any():
        blank &= ~(find_open(leaves, view) if holes is None else holes)[project.rows, project.columns]
    if blank.any():
        nearest = draw_leaf_ids(leaves, view.camera, settings.draw) if drawn is None else drawn
        front_m = nearest.depth_m[project.rows, project.columns]
        # Beside its silhouette a leaf is not drawn though the place is its own, and nothing is in front of it.
        presumed = blank & ((front_m <= 0) | (project.depth_m <= front_m + allowed_m))
        if view.mask is not None:
            off = presumed & ~view.mask[project.rows, project.columns]
            state[off] = ABSENT
            presumed &= ~off
        state[presumed] = PRESUMED
        nearest_m, farthest_m = _extremes(nearest.depth_m, project)
        inner |= presumed & (nearest_m > 0) & (farthest_m - nearest_m <= around_m)
    return Sights(project.places_px, state, project.facing, inner)


def find_open_holes(depth_m: NDArray[np.float32], width_px: float) -> NDArray[np.bool_]:
    """(H, W), True in holes of depth as wide as this or wider: nothing is there, or nothing that could be measured."""
    step = max(1, int(width_px / COARSE_PX))  # the widest holes need not be drawn to the pixel
    size = 2 * max(1, round(width_px / step / 2)) + 1
    # Beyond the picture holes go on.
    holes = cv2.copyMakeBorder((depth_m[::step, ::step] <= 0).astype(np.uint8), *4 * (size,), cv2.BORDER_REPLICATE)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    opened = cv2.morphologyEx(holes, cv2.MORPH_OPEN, disc)[size:-size, size:-size] > 0
    return np.asarray(opened.repeat(step, axis=0).repeat(step, axis=1)[: depth_m.shape[0], : depth_m.shape[1]])


def find_open(leaves: Leaves, view: View) -> NDArray[np.bool_]:
    """(H, W), holes too wide to be filled by guessing; none where all depth is missing or the mask shows the plant."""
    if not view.has_depth:
        return np.zeros(view.depth_m.shape, bool)
    away = np.linalg.norm(leaves.base_m - view.camera.position_m, axis=1)
    length_px = float(np.median(leaves.length_m / np.maximum(away, 1e-300))) * max(view.camera.focal_px)
    holes = find_open_holes(view.depth_m, min(WIDE_HOLE * length_px, max(view.depth_m.shape)))
    return holes if view.mask is None else np.zeros_like(holes)


class _Projection(NamedTuple):
    places_px: NDArray[np.float64]  # (N, P, 2)
    depth_m: NDArray[np.float64]  # (N, P), of the leaf
    seen_m: NDArray[np.float32]  # (N, P), of the photograph, 0 where unknown or outside
    facing: NDArray[np.float64]  # (N, P)
    inside: NDArray[np.bool_]  # (N, P), of the picture
    rows: NDArray[np.intp]  # (N, P), 0 outside
    columns: NDArray[np.intp]  # (N, P), 0 outside


def _project(leaves: Leaves, view: View, uv: NDArray[np.floating]) -> _Projection:
    camera = view.camera
    points, normals = evaluate_normals(leaves.parameters, uv, placements=leaves.asset_from_leaf())
    shape = points.shape[:2]
    places, depth_m = camera.project(points.reshape(-1, 3))
    rays = camera.position_m - points
    facing = np.einsum("npc,npc->np", rays, normals) / np.maximum(np.linalg.norm(rays, axis=-1), 1e-300)
    with np.errstate(invalid="ignore"):
        inside = np.all((places >= 0) & (places < (camera.width_px, camera.height_px)), axis=1)
    columns, rows = np.where(inside[:, None], places, 0.0).astype(np.intp).T
    seen_m = np.where(inside, view.depth_m[rows, columns], np.float32(0))
    return _Projection(
        places.reshape(*shape, 2),
        depth_m.reshape(shape),
        seen_m.reshape(shape),
        facing,
        inside.reshape(shape),
        rows.reshape(shape),
        columns.reshape(shape),
    )


def _extremes(depth_m: NDArray[np.float32], project: _Projection) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Least and greatest depth among a pixel and those around, (N, P) each; the least is 0 beside a hole."""
    around = np.ones((3, 3), np.uint8)
    lowest, highest = cv2.erode(depth_m, around), cv2.dilate(depth_m, around)
    return lowest[project.rows, project.columns], highest[project.rows, project.columns]
