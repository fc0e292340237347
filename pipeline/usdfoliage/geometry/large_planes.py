"""Large planes of a cloud: walls, roofs and floors, which are flat over a good part of what the cloud reaches.

A point is on one where its surroundings are flat, face as the plane does and lie in it. Few points beside a wall do not
change how it faces: surroundings are fitted again without those that are farthest from their plane.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.geometry.point_cells import cell_means, number_cells, one_in_each_cell

_FITS = 3  # of the surroundings of a point
_TRIMMED = 0.6  # share of the surroundings, by weight, that a later fit is of
_NEIGHBORS = 32
_FEWEST_NEIGHBORS = 8
_BESIDE = 1.4  # radii of a point's surroundings, in which others of its plane are
_REFINED = 2  # times that a plane is fitted to its points
_TAILS = 0.01  # share of the points on each side that do not count for the size
_TRIED = 150  # points whose surroundings are tried as a plane


@dataclass(frozen=True, kw_only=True)
class LargePlaneSettings:
    """What is a large plane; lengths in sizes of the cloud, which is the root of its length times its width."""

    max_cells: int = 8000  # that the cloud is looked at in
    around: float = 0.06  # radius of a point's surroundings
    flat: float = 0.25  # thickness of flat surroundings, of their width: standard deviations
    round: float = 0.2  # width of flat surroundings of their length, squared: a twig has none
    turn_deg: float = 12.0  # between a plane and the surroundings of its points: of a trunk only a strip faces one side
    thickness: float = 0.018  # from a plane to its points
    side: float = 0.25  # shorter side of a plane: wider than such a strip, narrower than a wall
    max_planes: int = 8
    points: float = 0.01  # share of all, that a plane has

    def __post_init__(self) -> None:
        if not (self.max_cells > _NEIGHBORS and 0 < self.around < 1 and 0 < self.flat < 1 and 0 <= self.round < 1):
            raise ValueError(f"max_cells must be above {_NEIGHBORS}, around, flat and round shares, not {self}")
        if not (0 < self.turn_deg < 90 and self.thickness > 0 and self.side > 0 and 0 < self.points < 1):
            raise ValueError(f"turn_deg, thickness and side must be above 0, points a share, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LargePlanes:
    """The large planes of a cloud, the one with most points first."""

    normals: NDArray[np.float64]  # (P, 3), unit, of any sign
    of_point: NDArray[np.int64]  # (N,), the plane that a point is on, -1 for none
    clutter: NDArray[np.float64]  # (N,), thickness of a point's surroundings of their length: 0 where they are flat


def find_large_planes(
    points_m: NDArray[np.float64], settings: LargePlaneSettings = LargePlaneSettings()
) -> LargePlanes:
    """Find the large planes of a cloud.

    Args:
        points_m: (N, 3), N at least 3.
        settings: What is one.
    """
    cell = number_cells(points_m, _cell_side(points_m, settings.max_cells))
    middle_m = cell_means(points_m, cell)
    weight = np.bincount(cell).astype(np.float64)
    size_m = _size(middle_m)
    none = LargePlanes(normals=np.zeros((0, 3)), of_point=np.full(len(points_m), -1), clutter=np.zeros(len(points_m)))
    if len(middle_m) <= _FEWEST_NEIGHBORS or not size_m > 0:
        return none
    normal, is_flat, clutter = _fit_surroundings(middle_m, weight, settings.around * size_m, settings)
    left = np.flatnonzero(is_flat)
    normals: list[NDArray[np.float64]] = []
    of_cell = np.full(len(middle_m), -1)
    for _ in range(settings.max_planes):
        if weight[left].sum() < settings.points * weight.sum():
            break
        plane, on = _largest_plane(middle_m[left], normal[left], weight[left], size_m, settings)
        members = left[on]
        left = left[~on]
        if weight[members].sum() < settings.points * weight.sum() or plane is None:
            break
        if _shorter_side(middle_m[members], weight[members]) < settings.side * size_m:
            continue
        # What lies in it beside another plane, such as a corner, is of it as well, however its surroundings face.
        reach_m = _BESIDE * settings.around * size_m
        beside = np.flatnonzero(of_cell < 0)
        beside = beside[np.abs((middle_m[beside] - plane[1]) @ plane[0]) < settings.thickness * size_m]
        near = np.asarray(cKDTree(middle_m[members]).query(middle_m[beside])[0]) <= reach_m
        of_cell[beside[near]] = len(normals)
        of_cell[members] = len(normals)
        left = left[of_cell[left] < 0]
        normals.append(plane[0])
    return LargePlanes(normals=np.array(normals).reshape(-1, 3), of_point=of_cell[cell], clutter=clutter[cell])


def _cell_side(points_m: NDArray[np.float64], max_cells: int) -> float:
    """Side of the cells in which a cloud is looked at: of few points each is in its own."""
    side_m = one_in_each_cell(points_m, max_cells)[1]
    return side_m if side_m > 0 else max(1e-6 * float(np.ptp(points_m, axis=0).max()), 1e-12)


def _size(points_m: NDArray[np.float64]) -> float:
    """Root of length times width of points (N, 3), without outliers; 0 of a single one."""
    if len(points_m) < 2:
        return 0.0
    along = np.linalg.eigh(np.cov(points_m.T))[1]
    low_m, high_m = np.quantile(points_m @ along, [_TAILS, 1 - _TAILS], axis=0)
    _, width_m, length_m = np.sort(high_m - low_m)
    return float(np.sqrt(length_m * width_m))


def _fit_surroundings(
    points_m: NDArray[np.float64], weight: NDArray[np.float64], radius_m: float, settings: LargePlaneSettings
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """(N, 3) normals of what surrounds each point, (N,) whether that is flat, and its clutter."""
    count = min(_NEIGHBORS, len(points_m))
    away_m, beside = (np.asarray(each) for each in cKDTree(points_m).query(points_m, count, workers=-1))
    reach_m = np.maximum(radius_m, away_m[:, _FEWEST_NEIGHBORS])
    counted = np.where(away_m <= reach_m[:, None], weight[beside], 0.0)
    kept = counted
    local_m = points_m[beside] - points_m[:, None]
    clutter = np.zeros(len(points_m))
    for fit in range(_FITS):
        total = kept.sum(axis=1)
        mean_m = np.einsum("nk,nki->ni", kept, local_m) / total[:, None]
        offset_m = local_m - mean_m[:, None]
        spread, axes = np.linalg.eigh(
            np.einsum("nk,nki,nkj->nij", kept / total[:, None], offset_m, offset_m, optimize=True)
        )
        spread = np.maximum(spread, 0)
        if not fit:
            clutter = np.sqrt(spread[:, 0] / np.maximum(spread[:, 2], 1e-30))
        normal = axes[:, :, 0]
        if fit < _FITS - 1:
            off_m = np.abs(np.einsum("nki,ni->nk", offset_m, normal))
            order = np.argsort(off_m, axis=1)
            within = np.cumsum(np.take_along_axis(counted, order, 1), axis=1)
            taken = within - np.take_along_axis(counted, order, 1) < _TRIMMED * within[:, -1:]
            trimmed = np.zeros_like(taken)
            np.put_along_axis(trimmed, order, taken, 1)
            kept = np.where(trimmed, counted, 0.0)
    is_flat = np.sqrt(spread[:, 0]) < settings.flat * np.sqrt(spread[:, 1])
    return normal, is_flat & (spread[:, 1] > settings.round * spread[:, 2]), clutter


def _largest_plane(
    points_m: NDArray[np.float64],
    normal: NDArray[np.float64],
    weight: NDArray[np.float64],
    size_m: float,
    settings: LargePlaneSettings,
) -> tuple[tuple[NDArray[np.float64], NDArray[np.float64]] | None, NDArray[np.bool_]]:
    """Normal and place of the plane that has most of points (N, 3), None where it is none, and (N,) which are on it."""
    facing, within_m = np.cos(np.radians(settings.turn_deg)), settings.thickness * size_m
    best, on = 0.0, np.zeros(len(points_m), bool)
    for tried in np.linspace(0, len(points_m) - 1, min(_TRIED, len(points_m))).astype(int).tolist():
        is_on = np.abs(normal @ normal[tried]) > facing
        is_on &= np.abs((points_m - points_m[tried]) @ normal[tried]) < within_m
        if weight[is_on].sum() > best:
            best, on = float(weight[is_on].sum()), is_on
    plane = None
    for _ in range(_REFINED):
        if on.sum() < 3:
            return None, on
        place_m = np.average(points_m[on], axis=0, weights=weight[on])
        axis = np.linalg.eigh(np.cov(points_m[on].T, aweights=weight[on]))[1][:, 0]
        plane = axis, place_m
        refined = (np.abs(normal @ axis) > facing) & (np.abs((points_m - place_m) @ axis) < within_m)
        if refined.sum() < 3:
            return None, on
        on = refined
    return plane, on


def _shorter_side(points_m: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """Of a rectangle that points (N, 3) of a plane would fill evenly."""
    if len(points_m) < 3:
        return 0.0
    spread = np.linalg.eigvalsh(np.cov(points_m.T, aweights=weight))
    return float(np.sqrt(12 * max(spread[1], 0)))
