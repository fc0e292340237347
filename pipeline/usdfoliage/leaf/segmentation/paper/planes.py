"""A plane for every superpixel, all of them at once.

Source: G. Chaurasia, P. Beardsley, Editable Parametric Dense Foliage from 3D Capture, 2017, section 4.1. That a
hypothesis is scored by the median distance instead of by counting inliers (P. Rousseeuw, Least Median of Squares
Regression, 1984), and that points are then trimmed by their own scatter, is ours: δ_plane is often as long as a
superpixel, and then a plane across two leaves, or through a leaf, counts all points.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_BATCH = 1024  # superpixels scored at a time; bounds memory


@dataclass(frozen=True, kw_only=True)
class PlaneSettings:
    """When a superpixel has a plane."""

    hypotheses: int = 24  # This many planes through three points are tried for a superpixel. Range: 1 or more.
    scored_points: int = 48  # A trial plane is scored by this many points of the superpixel. Range: 3 or more.
    min_points: int = 12  # A superpixel with fewer points of known depth has no plane. Range: 3 or more.
    # At least this share of a superpixel's points must lie near its plane. Range: above 0, up to 1.
    min_inliers: float = 0.5
    # A point is dropped where its distance from the mean is more than this many times the median distance. Range:
    # above 1.
    max_spread: float = 3.0
    # A point is no inlier where it lies off the plane by more than this many standard deviations. Unit: standard
    # deviations. Range: above 0.
    trim_sigmas: float = 3.0
    # A point within this share of the threshold is always an inlier, because leaves bend and depth is rounded. Range:
    # above 0, up to 1.
    trim_floor: float = 0.25
    refinements: int = 3  # A plane is fitted this often through its inliers, by least squares. Range: 1 or more.

    def __post_init__(self) -> None:
        if min(self.hypotheses, self.refinements) < 1 or min(self.scored_points, self.min_points) < 3:
            raise ValueError(f"a plane takes three points and one trial, not {self}")
        if not 0 < self.min_inliers <= 1 or not 0 < self.trim_floor <= 1:
            raise ValueError(f"min_inliers and trim_floor must be in (0, 1], not {self}")
        if self.max_spread <= 1 or self.trim_sigmas <= 0:
            raise ValueError(f"max_spread must be above 1 and trim_sigmas above 0, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class SuperpixelPlanes:
    """The planes of S superpixels; NaN where there is none."""

    normals: NDArray[np.float64]  # (S, 3), unit, towards the camera
    centroids: NDArray[np.float64]  # (S, 3), of the inliers
    valid: NDArray[np.bool_]  # (S,), those that have a plane
    rms_m: NDArray[np.float64]  # (S,), distance of the inliers
    inliers: NDArray[np.bool_]  # as the labels: points near the plane of their superpixel and near its mean
    dropped: Mapping[str, int]  # superpixels that have no plane, by reason


def fit_planes(
    points_m: NDArray[np.floating],
    labels: NDArray[np.int32],
    camera_m: NDArray[np.floating],
    plane_threshold_m: float,
    settings: PlaneSettings = PlaneSettings(),
    *,
    rng: np.random.Generator,
) -> SuperpixelPlanes:
    """Fit a plane to the points of every superpixel, by RANSAC and then least squares.

    Args:
        points_m: (..., 3), NaN where there is none, in any frame.
        labels: (...), the superpixel of each point, from 0; -1 for none.
        camera_m: (3,), where the camera stands, in the same frame: normals turn towards it.
        plane_threshold_m: δ_plane, the farthest a point may lie from the plane.
        settings: When a superpixel has a plane.
        rng: Chooses the points that hypotheses go through.

    Raises:
        ValueError: The arrays are not of these shapes, or the threshold is not above 0.
    """
    if points_m.shape != (*labels.shape, 3):
        raise ValueError(f"points_m must be {(*labels.shape, 3)}, not {points_m.shape}")
    if not (np.isfinite(plane_threshold_m) and plane_threshold_m > 0):
        raise ValueError(f"plane_threshold_m must be above 0, not {plane_threshold_m}")
    count = int(labels.max(initial=-1)) + 1
    flat = points_m.reshape(-1, 3)
    order = np.flatnonzero((labels.ravel() >= 0) & np.isfinite(flat[:, 0]))
    order = order[np.argsort(labels.ravel()[order], kind="stable")]
    owner = labels.ravel()[order].astype(np.intp)
    sizes = np.bincount(owner, minlength=count)
    enough = sizes >= settings.min_points
    # Around each superpixel's own mean: far from the origin products lose digits.
    means = _means(flat[order], owner, count)
    local = flat[order] - means[owner]

    starts = np.cumsum(sizes) - sizes
    normals, anchors = np.zeros((count, 3)), np.zeros((count, 3))
    middles, reach, limit = np.zeros((count, 3)), np.zeros(count), np.zeros(count)
    numbers = np.flatnonzero(enough)
    for first in range(0, len(numbers), _BATCH):
        batch = numbers[first : first + _BATCH]
        sample, normal, anchor = _ransac(local, starts[batch], sizes[batch], settings, rng)
        normals[batch], anchors[batch], middles[batch], reach[batch], limit[batch] = _refine(
            sample, normal, anchor, plane_threshold_m, settings
        )
    near = np.abs(np.einsum("ij,ij->i", local - anchors[owner], normals[owner])) <= limit[owner]
    near &= np.linalg.norm(local - middles[owner], axis=1) <= reach[owner]
    normals, centroids, flatness = _fit_by_squares(local, owner, near, count)
    residual = np.abs(np.einsum("ij,ij->i", local - centroids[owner], normals[owner]))
    near &= residual <= limit[owner]

    inlier_count = np.bincount(owner[near], minlength=count)
    agreed = inlier_count >= np.maximum(settings.min_points, settings.min_inliers * sizes)
    valid = enough & agreed & flatness
    with np.errstate(divide="ignore", invalid="ignore"):
        rms_m = np.sqrt(np.bincount(owner[near], residual[near] ** 2, minlength=count) / inlier_count)
    centroids = centroids + means
    away_from_camera = np.einsum("ij,ij->i", normals, np.asarray(camera_m, np.float64) - centroids) < 0
    normals = np.where(away_from_camera[:, None], -normals, normals)
    inliers = np.zeros(labels.size, np.bool_)
    inliers[order[near & valid[owner]]] = True
    for array in (normals, centroids, rms_m):
        array[~valid] = np.nan
    return SuperpixelPlanes(
        normals=normals,
        centroids=centroids,
        valid=valid,
        rms_m=rms_m,
        inliers=inliers.reshape(labels.shape),
        dropped={
            "superpixels with too few points": int(np.count_nonzero(~enough)),
            "superpixels without a plane": int(np.count_nonzero(enough & ~valid)),
        },
    )


def _means(points: NDArray[np.floating], owner: NDArray[np.intp], count: int) -> NDArray[np.float64]:
    """(S, 3); 0 where there are none."""
    sums = np.stack([np.bincount(owner, points[:, axis], minlength=count) for axis in range(3)], axis=1)
    return np.asarray(sums / np.maximum(np.bincount(owner, minlength=count), 1)[:, None])


def _ransac(
    local: NDArray[np.float64],
    starts: NDArray[np.intp],
    sizes: NDArray[np.intp],
    settings: PlaneSettings,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """A sample (B, K, 3) of the points of each superpixel; the best hypothesis, as normals (B, 3) and points (B, 3)."""
    base, size = starts[:, None], sizes[:, None]
    # Evenly over the superpixel, from a place of chance.
    steps = (np.arange(settings.scored_points) + rng.random((len(starts), 1))) / settings.scored_points
    sample = local[base + np.minimum((steps * size).astype(np.intp), size - 1)]
    chance = rng.random((len(starts), settings.hypotheses, 3))
    corner = local[base[:, :, None] + (chance * size[:, :, None]).astype(np.intp)]  # (B, T, 3, 3)
    normal = np.cross(corner[:, :, 1] - corner[:, :, 0], corner[:, :, 2] - corner[:, :, 0])
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    offset = np.einsum("btk,btk->bt", normal, corner[:, :, 0])
    distance = np.matmul(normal, sample.transpose(0, 2, 1)) - offset[:, :, None]
    cost = np.partition(np.abs(distance), settings.scored_points // 2, axis=2)[:, :, settings.scored_points // 2]
    cost[length[..., 0] == 0] = np.inf
    best = np.argmin(cost, axis=1)
    rows = np.arange(len(starts))
    return sample, normal[rows, best], corner[rows, best, 0]


def _refine(
    sample: NDArray[np.float64],
    normal: NDArray[np.float64],
    anchor: NDArray[np.float64],
    threshold_m: float,
    settings: PlaneSettings,
) -> tuple[NDArray[np.float64], ...]:
    """Fit the sample's inliers anew and narrow what an inlier is.

    Returns:
        Normals (B, 3), points on the planes (B, 3), means of the inliers (B, 3), and how far an inlier may lie from its
        mean (B,) and from its plane (B,).
    """

    def narrow(median_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.clip(settings.trim_sigmas * 1.4826 * median_m, settings.trim_floor * threshold_m, threshold_m)

    middle, reach = anchor, np.full(len(sample), np.inf)
    residual = np.abs(np.einsum("bkc,bc->bk", sample - anchor[:, None], normal))
    limit = narrow(_medians(residual, np.ones_like(residual, np.bool_)))
    for _ in range(settings.refinements):
        near = np.abs(np.einsum("bkc,bc->bk", sample - anchor[:, None], normal)) <= limit[:, None]
        middle = _weighted_mean(sample, near)
        away = np.linalg.norm(sample - middle[:, None], axis=2)
        reach = settings.max_spread * _medians(away, near)
        near &= away <= reach[:, None]
        anchor = _weighted_mean(sample, near)
        centered = np.where(near[..., None], sample - anchor[:, None], 0.0)
        _, vectors = np.linalg.eigh(np.matmul(centered.transpose(0, 2, 1), centered))
        normal = vectors[:, :, 0]
        residual = np.abs(np.einsum("bkc,bc->bk", sample - anchor[:, None], normal))
        limit = narrow(_medians(residual, near))
    return normal, anchor, middle, reach, limit


def _weighted_mean(sample: NDArray[np.float64], near: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.asarray(
        np.einsum("bkc,bk->bc", sample, near.astype(np.float64)) / np.maximum(near.sum(axis=1), 1)[:, None]
    )


def _medians(values: NDArray[np.float64], chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(B,), of the values chosen in each row, the lower one of two in the middle; infinite where there are none."""
    in_order = np.sort(np.where(chosen, values, np.inf), axis=1)
    middle = np.maximum(chosen.sum(axis=1) - 1, 0) // 2
    return np.asarray(in_order[np.arange(len(values)), middle])


def _fit_by_squares(
    local: NDArray[np.float64], owner: NDArray[np.intp], chosen: NDArray[np.bool_], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Normals, centroids, and whether the points span a plane at all."""
    points, owner = local[chosen], owner[chosen]
    sizes = np.bincount(owner, minlength=count)
    centroids = _means(points, owner, count)
    points = points - centroids[owner]
    covariance = np.empty((count, 3, 3))
    for row in range(3):
        for column in range(row, 3):
            sums = np.bincount(owner, points[:, row] * points[:, column], minlength=count)
            covariance[:, row, column] = covariance[:, column, row] = sums / np.maximum(sizes, 1)
    values, vectors = np.linalg.eigh(covariance)
    spans = values[:, 1] > 1e-4 * values[:, 2]  # else they lie on a line, or in one place
    return vectors[:, :, 0], centroids, spans & (values[:, 2] > 0)
