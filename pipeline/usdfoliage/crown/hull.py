"""The radius cubemap of a crown from its points and from photographs all around it.

In every direction the outermost points that are not alone give the radius; where photographs see past it, it is carved;
where there is no point, the surface between those around is stretched over the gap and carved as well. The result is
the thesis' representation of a crown (section 4.6); how it is come by is our own, after the visual hull of
A. Laurentini, The Visual Hull Concept for Silhouette-Based Image Understanding, 1994.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.crown.views import ReducedView
from usdfoliage.errors import FitError
from usdfoliage.geometry.cube_field import (
    blur_cubemap,
    close_pits,
    cubemap_from_distinct,
    distinct_texels,
    limit_falloff,
    solve_dirichlet,
)
from usdfoliage.geometry.cubemap import face_coordinates, face_directions, sample_cubemap, share_borders

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class HullSettings:
    """How points become a surface, and how photographs carve it."""

    neighbors: int = 24  # points about a direction that are looked at
    widest_rad: float = 0.1  # cone in which they must lie; of few points a wider one, in which there are points enough
    sparse_rad: float = 0.4  # the widest for few points
    min_points: int = 5  # points in that cone, below which nothing is known of a direction
    outermost: float = 0.85  # share of them that lies within the radius
    shell: float = 0.65  # of the radius around, within which points are not of the surface
    closing: float = 0.04  # of the crown's radius, width of gaps in silhouettes and depth that are no way through
    drawn_masks: bool = (
        False  # by a program, leaf by leaf: not surely right, and light between leaves is no way through
    )
    drawn_closing: float = 0.15  # takes the place of closing in silhouettes of such masks
    margin: float = 0.03  # of the crown's radius, by which depth must be behind a place to see past it
    step: float = 0.02  # share of the radius that is carved at a time
    floor: float = 0.12  # of the median radius, which is never carved away
    pit_rad: float = 0.2  # width of pits that are closed: what is between two twigs is the crown as well
    peak_rad: float = 0.08  # width of peaks that are taken away: a single leaf is no bough
    falloff: float = 2.5  # of the radius's logarithm in a radian: steeper, the surface would be smeared along the rays
    blur_rad: float = 0.02

    def __post_init__(self) -> None:
        if not 1 <= self.min_points <= self.neighbors:
            raise ValueError(f"1 <= least <= neighbors is needed, not {self.min_points} and {self.neighbors}")
        if not self.falloff > 0:
            raise ValueError(f"falloff must be above 0, not {self.falloff}")
        for name in ("outermost", "shell", "step", "floor"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name} must be in (0, 1), not {getattr(self, name)}")
        for name in ("widest_rad", "closing", "drawn_closing", "margin", "pit_rad", "peak_rad", "blur_rad"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must be 0 or more, not {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownHull:
    """The surface of a crown about its centre."""

    radius_m: Array  # (6, N, N), positive, borders shared
    known: float  # share of directions in which there are points
    carved: float  # share of directions that photographs made shorter


def fit_crown_hull(
    points_m: Array,
    center_m: Array,
    base_m: float,
    views: Sequence[ReducedView],
    size: int,
    settings: HullSettings = HullSettings(),
) -> CrownHull:
    """The radius in every direction from the crown's centre.

    Args:
        points_m: (N, 3), of the crown.
        center_m: (3,), in the same frame, Y up.
        base_m: Height below which nothing without points is crown.
        views: Cameras in the same frame.
        size: Texels a side of the result.
        settings: How.

    Raises:
        FitError: No direction has points enough.
    """
    work = max(min(size, 64), (size + 1) // 2)  # points are never as close as texels
    directions = face_directions(work)
    from_points_m, known = outermost_points(points_m - center_m, work, settings)
    if not known.any():
        raise FitError(f"{len(points_m)} points are too few in every direction from the crown's centre")
    radius_m = from_points_m
    if not known.all():
        radius_m = solve_dirichlet(np.zeros_like(radius_m), known, radius_m)
        down = -directions[..., 1]
        under_m = np.where(down > 1e-3, max(center_m[1] - base_m, 0) / np.maximum(down, 1e-3), np.inf)
        radius_m = np.where(known, radius_m, np.minimum(radius_m, under_m))
    floor_m = settings.floor * float(np.median(radius_m[known]))
    radius_m = close_pits(np.maximum(radius_m, floor_m), settings.pit_rad)
    limit_m = carve_radius(radius_m, center_m, floor_m, views, settings)
    carved = float((limit_m < 0.99 * radius_m).mean())
    radius_m = _fair(limit_m, settings)
    masked = [view for view in views if view.mask is not None]
    if masked and not settings.drawn_masks:  # a given mask is kept to, whatever that makes of the surface
        radius_m = carve_radius(radius_m, center_m, floor_m, masked, settings)
    if work != size:
        radius_m = sample_cubemap(radius_m, face_directions(size))
    return CrownHull(radius_m=np.asarray(share_borders(radius_m)), known=float(known.mean()), carved=carved)


def _fair(radius_m: Array, settings: HullSettings) -> Array:
    """The radius without what is too narrow or too steep to be a crown's surface."""
    fair_m = close_pits(radius_m, settings.pit_rad)
    fair_m = -close_pits(-fair_m, settings.peak_rad)
    fair_m = limit_falloff(fair_m, settings.falloff)
    texel_rad = np.pi / 2 / radius_m.shape[1]
    return blur_cubemap(fair_m, settings.blur_rad / texel_rad)


def outermost_points(offsets_m: Array, size: int, settings: HullSettings) -> tuple[Array, NDArray[np.bool_]]:
    """Radius (6, size, size) of the outermost of the points (N, 3) about each direction, and where there are any."""
    away_m = np.linalg.norm(offsets_m, axis=1)
    offsets_m, away_m = offsets_m[away_m > 0], away_m[away_m > 0]
    toward = offsets_m / away_m[:, None]
    outer = _in_shell(toward, away_m, settings)
    toward, away_m = toward[outer], away_m[outer]
    texels = np.column_stack([distinct_texels(face_directions(size)[..., axis]) for axis in range(3)])
    k = min(settings.neighbors, len(toward))
    # Wide enough for twice the least in each cone, were the points even about the centre.
    even_rad = float(np.sqrt(8 * settings.min_points / len(toward)))
    chord = 2 * np.sin(np.clip(even_rad, settings.widest_rad, max(settings.widest_rad, settings.sparse_rad)) / 2)
    _, near = cKDTree(toward).query(texels, k=k, distance_upper_bound=chord, workers=-1)
    near = np.reshape(near, (len(texels), k))
    found = near < len(toward)
    count = found.sum(axis=1)
    around_m = np.sort(np.where(found, np.append(away_m, 0.0)[near], np.inf), axis=1)
    rank = np.minimum((settings.outermost * count).astype(np.intp), np.maximum(count - 1, 0))
    known = count >= min(settings.min_points, k)
    radius_m = np.where(known, around_m[np.arange(len(texels)), rank], 0.0)
    return (
        cubemap_from_distinct(radius_m, size),
        cubemap_from_distinct(known.astype(np.float64), size) > 0.5,
    )


def _in_shell(toward: Array, away_m: Array, settings: HullSettings) -> NDArray[np.bool_]:
    """(N,) points that are not far below the outermost ones around them."""
    cells = 12
    face, row, column = face_coordinates(toward, cells + 1)
    cell = (face * cells + np.minimum(row, cells - 1).astype(np.intp)) * cells
    cell += np.minimum(column, cells - 1).astype(np.intp)
    order = np.lexsort((away_m, cell))
    ends = np.flatnonzero(np.append(np.diff(cell[order]) > 0, True))
    starts = np.append(0, ends[:-1] + 1)
    outer_m = np.zeros(6 * cells * cells)
    outer_m[cell[order][starts]] = away_m[order][starts + ((ends - starts) * settings.outermost).astype(np.intp)]
    return np.asarray(away_m >= settings.shell * outer_m[cell])


def carve_radius(
    radius_m: Array, center_m: Array, floor_m: float, views: Sequence[ReducedView], settings: HullSettings
) -> Array:
    """The radius (6, N, N) made shorter until no photograph sees past it, but never below floor_m.

    A given mask decides alone. Sky, depth and drawn masks are guesses, and two views must agree.
    """
    size = radius_m.shape[1]
    directions = np.column_stack([distinct_texels(face_directions(size)[..., axis]) for axis in range(3)])
    reach_m = distinct_texels(radius_m).copy()
    median_m = float(np.median(reach_m))
    made = [_open_view(view, center_m, median_m, settings) for view in views]
    open_views = [view for view in made if view is not None]
    active = np.arange(len(reach_m))
    while len(active) and open_views:
        places_m = center_m + reach_m[active, None] * directions[active]
        votes = np.zeros(len(active), np.int64)
        for view in open_views:
            votes += view.passes(places_m)
        active = active[votes >= 2]
        reach_m[active] *= 1 - settings.step
        active = active[reach_m[active] > floor_m]
    return cubemap_from_distinct(np.maximum(reach_m, floor_m), size)


@dataclass(frozen=True, eq=False)
class _OpenView:
    """How far one photograph sees past the plant."""

    view: ReducedView
    open_m: NDArray[np.float32]  # (h, w), depth up to which nothing stands; infinite past the silhouette
    weight: int  # of its evidence; of 2 one is enough

    def passes(self, places_m: Array) -> NDArray[np.int64]:
        """(N,) the weight where places (N, 3) are seen through, else 0."""
        camera = self.view.camera
        place, depth_m = camera.project(places_m)
        seen = (depth_m > 0) & (place >= 0).all(axis=1)
        seen &= (place[:, 0] < camera.width_px) & (place[:, 1] < camera.height_px)
        column, row = np.where(seen[:, None], place, 0).astype(np.intp).T
        return np.where(seen & (depth_m < self.open_m[row, column]), self.weight, 0)


def _open_view(view: ReducedView, center_m: Array, median_m: float, settings: HullSettings) -> _OpenView | None:
    """Gaps narrower than the closing are none, and what is in front of the crown hides nothing of it."""
    depth_m = float(view.camera.project(center_m[None])[1][0])
    closing_px = settings.closing * median_m * view.camera.focal_px[0] / depth_m
    side = 2 * round(closing_px) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    open_m = np.zeros(view.srgb.shape[:2], np.float32)
    if view.depth_m is not None:
        found = view.depth_m > 0
        nearest = cv2.erode(np.where(found, view.depth_m, np.inf).astype(np.float32), kernel, borderValue=np.inf)
        share = cv2.blur(found.astype(np.float32), (side, side))
        behind = np.isfinite(nearest) & (share > 0.5)
        open_m[behind] = nearest[behind] - np.float32(settings.margin * median_m)
    drawn = settings.drawn_masks and view.mask is not None
    if drawn:
        side = 2 * round(closing_px * settings.drawn_closing / settings.closing) + 1
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    past = _past_silhouette(view, kernel)
    if past is not None:
        open_m[past] = np.inf
    if not (open_m > 0).any():
        return None
    return _OpenView(view, open_m, 1 if drawn or view.mask is None else 2)


def _past_silhouette(view: ReducedView, kernel: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
    if view.mask is None and view.sky is None:
        return None
    side = kernel.shape[0]
    # Beyond the border nothing is known, so a gap at the border stays as it is.
    padded = np.pad(view.plant.astype(np.uint8), side, mode="edge")
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, kernel)[side:-side, side:-side]
    # A pixel that is half outside is on the silhouette.
    return cv2.dilate(closed, np.ones((3, 3), np.uint8)) == 0
