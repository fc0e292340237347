"""A cloud as leaves are looked for in it: no denser than its noise lets it show anything, with the plane at each point.

A scan that is denser than its noise shows no normals between neighbours: there the mean of the points in each cell of a
grid, which the noise moves less, stands for them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.errors import FitError
from usdfoliage.geometry.point_cells import cell_means, number_cells
from usdfoliage.leaf.segmentation.cloud.settings import CloudSegmentationSettings

_NEAR = 12  # neighbours by which it is seen whether the cloud shows surfaces
_NEXT = 4  # the neighbour whose distance is the spacing
_AROUND = 6  # the neighbour whose distance is the local spacing
_FLATTEST = 0.3  # share of the neighbourhoods that lie in surfaces, if any do: others are edges, stems and noise
_FLAT = 0.45  # thickness to width of a neighbourhood that shows a surface; of noise it is 0.65
_SAMPLED = 5000  # neighbourhoods, evenly chosen, that show it
_TYPICAL = 0.4  # quantile of the thickness about the planes that were fitted
_FIRST_CELL, _GROWTH = 1.5, 1.3  # side of the first cells, in spacings, and by how much they grow
_MIN_LEFT = 1 / 200  # of the points, below which cells that still show no surface are given up
_FAR = 3.0  # spacings beyond which the local spacing does not count
_REWEIGHTED = 3  # times that planes are fitted again without what lies off them
_OFF = 2.0  # typical distances from a plane beyond which points count little
MIN_POINTS = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkingCloud:
    """W points, each the mean of some of the cloud's."""

    points_m: NDArray[np.float64]  # (W, 3)
    of_point: NDArray[np.int64]  # (N,), which of them each point of the cloud belongs to; repeated points to the same
    neighbours: NDArray[np.int64]  # (W, K), the nearest first, without the point itself
    distance_m: NDArray[np.float64]  # (W, K), of them
    normals: NDArray[np.float64]  # (W, 3), unit, either way round
    straightness: NDArray[np.float64]  # (W,), 0 where a point's surroundings are as wide as long to 1 on a line
    thickness_m: float  # typical distance of points from the plane of their neighbours
    spacing_m: float  # typical distance between points
    cell_m: float  # side of the cells; 0 where all points are as they were

    def __len__(self) -> int:
        return len(self.points_m)

    @property
    def local_spacing_m(self) -> NDArray[np.float64]:
        """(W,), how far apart points are around each."""
        return np.asarray(np.minimum(self.distance_m[:, _AROUND - 1], _FAR * self.spacing_m))

    @property
    def area_m2(self) -> NDArray[np.float64]:
        """(W,), of the surface that each point stands for."""
        return np.asarray(np.pi / _AROUND * np.square(self.distance_m[:, _AROUND - 1]))


def prepare_cloud(
    points_m: NDArray[np.float64],
    settings: CloudSegmentationSettings = CloudSegmentationSettings(),
    *,
    threads: int = 0,
) -> WorkingCloud:
    """Thin a cloud to what its noise lets it show, and fit the plane at each point.

    Args:
        points_m: (N, 3), metres, finite.
        settings: How many points, and how many of them a plane is fitted to.
        threads: At most so many, 0 for one per core; the result is the same.

    Raises:
        ValueError: There are fewer than MIN_POINTS points.
        FitError: They lie in fewer places.
    """
    if len(points_m) < MIN_POINTS:
        raise ValueError(f"{len(points_m)} points, at least {MIN_POINTS} are needed")
    workers = threads or -1
    places_m, of_place = _different_places(points_m)  # repeated points have no distance to each other, and no plane
    if len(places_m) < MIN_POINTS:
        raise FitError(
            f"{len(points_m):,} points lie in {len(places_m)} different places, {MIN_POINTS} are needed",
            "export the cloud again with all digits of its coordinates",
        )
    thinned, of_point, cell_m = _thin_until_flat(places_m, workers)
    while len(thinned) > settings.max_points:
        cell_m = max(_GROWTH * cell_m, _spacing(places_m, workers))
        thinned, of_point = _cells(places_m, cell_m)

    count = min(max(settings.plane_neighbours, settings.linked_neighbours, _AROUND), len(thinned) - 1)
    distance_m, nearest = _find_neighbours(thinned, count, workers)
    around = nearest[:, : min(settings.plane_neighbours, count) + 1]
    normals, straightness, thickness_m = _fit_planes(thinned, around)
    return WorkingCloud(
        points_m=thinned,
        of_point=of_point[of_place],
        neighbours=nearest[:, 1:],
        distance_m=distance_m[:, 1:],
        normals=normals,
        straightness=straightness,
        thickness_m=max(float(np.quantile(thickness_m, _TYPICAL)), 1e-12),
        spacing_m=max(float(np.median(distance_m[:, min(_NEXT, count)])), 1e-12),
        cell_m=cell_m,
    )


def _different_places(points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The points (P, 3) without repeated ones, in their order, and the place of each point (N,) among them."""
    order = np.lexsort(points_m.T)  # stable: of equal points the first one comes first
    begins = np.append(True, (np.diff(points_m[order], axis=0) != 0).any(axis=1))
    first = order[begins]
    if len(first) == len(points_m):
        return points_m, np.arange(len(points_m))
    group = np.empty(len(points_m), np.int64)
    group[order] = np.cumsum(begins) - 1
    kept = np.sort(first)
    return points_m[kept], np.searchsorted(kept, first)[group]


def _cells(points_m: NDArray[np.float64], side_m: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    cell = number_cells(points_m, side_m)
    return cell_means(points_m, cell), cell


def _find_neighbours(
    points_m: NDArray[np.float64], count: int, workers: int, of: NDArray[np.int64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Distances (N, count + 1) and numbers of the points nearest to all, or to some, the point itself first."""
    distance_m, nearest = cKDTree(points_m).query(points_m if of is None else points_m[of], count + 1, workers=workers)
    return np.asarray(distance_m), np.asarray(nearest)


def _thin_until_flat(
    points_m: NDArray[np.float64], workers: int
) -> tuple[NDArray[np.float64], NDArray[np.int64], float]:
    """Means of cells (W, 3) so large that they show surfaces, the cell of each point (N,), and the side of the cells.

    All points, and 0, where they show surfaces by themselves, or no cells do.
    """
    everything = points_m, np.arange(len(points_m)), 0.0
    thinned, of_point, cell_m = everything
    while _flatness(thinned, workers) > _FLAT:
        cell_m = _GROWTH * cell_m if cell_m > 0 else _FIRST_CELL * _spacing(points_m, workers)
        if cell_m == 0:
            return everything
        thinned, of_point = _cells(points_m, cell_m)
        if len(thinned) < max(_MIN_LEFT * len(points_m), MIN_POINTS):
            return everything
    return thinned, of_point, cell_m


def _flatness(points_m: NDArray[np.float64], workers: int) -> float:
    """Thickness to width of the flattest neighbourhoods: 0 of surfaces."""
    nearest = _find_neighbours(points_m, min(_NEAR, len(points_m) - 1), workers, _some(points_m))[1]
    local = points_m[nearest]
    local = local - local.mean(axis=1, keepdims=True)
    variance = np.maximum(np.linalg.eigvalsh(np.einsum("nki,nkj->nij", local, local)), 1e-30)
    return float(np.quantile(np.sqrt(variance[:, 0] / variance[:, 1]), _FLATTEST))


def _spacing(points_m: NDArray[np.float64], workers: int) -> float:
    count = min(_NEXT, len(points_m) - 1)
    return float(np.median(_find_neighbours(points_m, count, workers, _some(points_m))[0][:, count]))


def _some(points_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Numbers of some of the points, evenly chosen."""
    return np.linspace(0, len(points_m) - 1, min(len(points_m), _SAMPLED)).astype(np.int64)


def _fit_planes(
    points_m: NDArray[np.float64], around: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Normals (W, 3), straightness (W,) and thickness (W,) of the points around each, those off the plane aside."""
    local = points_m[around] - points_m[:, None]
    weights = np.ones(around.shape)
    for number in range(_REWEIGHTED + 1):
        total = weights.sum(axis=1)
        middle = np.einsum("nk,nki->ni", weights, local) / total[:, None]
        offsets = local - middle[:, None]
        covariance = np.einsum("nk,nki,nkj->nij", weights, offsets, offsets, optimize=True) / total[:, None, None]
        variance, axes = np.linalg.eigh(covariance)
        if number < _REWEIGHTED:
            off = np.abs(np.einsum("nki,ni->nk", local, axes[:, :, 0]))  # from the plane through the point itself
            typical = np.maximum(1.4826 * np.median(off, axis=1), 1e-12)
            weights = 1 / np.square(1 + np.square(off / (_OFF * typical[:, None])))
    straightness = (variance[:, 2] - variance[:, 1]) / np.maximum(variance[:, 2], 1e-30)
    return axes[:, :, 0], straightness, np.sqrt(np.maximum(variance[:, 0], 0.0))
