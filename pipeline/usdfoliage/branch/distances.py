"""How far a cloud and the branches that were traced through it are from each other."""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton
from usdfoliage.geometry.directions import two_across

_AROUND = 8  # points around a branch, of its surface
_NEAREST = 16  # places on axes that are looked at for each point: the nearest axis need not have the nearest surface


class AxisPlaces(NamedTuple):
    """K places on axes, evenly along each segment."""

    points_m: NDArray[np.float64]  # (K, 3)
    radius_m: NDArray[np.float64]  # (K,)
    direction: NDArray[np.float64]  # (K, 3), unit; 0 on a segment without length
    vertex: NDArray[np.int64]  # (K,), index into the skeleton's points, of the segment's first


def sample_axes(
    skeleton: Skeleton, step_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places along all axes: (K, 3), radii there (K,), unit directions (K, 3); as place_on_axes."""
    return place_on_axes(skeleton, step_m)[:3]


def place_on_axes(skeleton: Skeleton, step_m: float) -> AxisPlaces:
    """Places along all axes, at least one on each segment.

    Args:
        skeleton: Whose.
        step_m: Between them, at most.
    """
    inner = np.ones(len(skeleton.points_m), bool)
    inner[skeleton.first] = False
    end = np.flatnonzero(inner)
    start_m, along_m = skeleton.points_m[end - 1], skeleton.points_m[end] - skeleton.points_m[end - 1]
    length_m = np.linalg.norm(along_m, axis=1)
    pieces = np.maximum(1, np.ceil(length_m / step_m)).astype(np.int64)
    of = np.repeat(np.arange(len(end)), pieces)
    within = np.arange(len(of)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = ((within + 0.5) / pieces[of])[:, None]
    places_m = start_m[of] + share * along_m[of]
    radii_m = (1 - share[:, 0]) * skeleton.radius_m[end - 1][of] + share[:, 0] * skeleton.radius_m[end][of]
    direction = np.divide(along_m, length_m[:, None], out=np.zeros_like(along_m), where=length_m[:, None] > 0)
    return AxisPlaces(points_m=places_m, radius_m=radii_m, direction=direction[of], vertex=end[of] - 1)


def distances_to_surface(points_m: NDArray[np.float64], skeleton: Skeleton, step_m: float) -> NDArray[np.float64]:
    """(N,) from points (N, 3) to the nearest branch's surface, radii being taken across places step_m apart."""
    places_m, radii_m, direction = sample_axes(skeleton, step_m)
    near = min(_NEAREST, len(places_m))
    found = np.asarray(scipy.spatial.cKDTree(places_m).query(points_m, k=list(range(1, near + 1)), workers=-1)[1])
    nearest_m = np.full(len(points_m), np.inf)
    for place in found.T:  # across and along apart: inside a branch some place is always a radius away
        from_place = points_m - places_m[place]
        along_m = np.einsum("nc,nc->n", from_place, direction[place])
        across_m = np.linalg.norm(from_place - along_m[:, None] * direction[place], axis=1)
        beyond_m = np.maximum(np.abs(along_m) - 0.5 * step_m, 0)
        nearest_m = np.minimum(nearest_m, np.hypot(across_m - radii_m[place], beyond_m))
    return nearest_m


def near_surface(points_m: NDArray[np.float64], skeleton: Skeleton, near_m: float) -> NDArray[np.bool_]:
    """(N,) points (N, 3) within near_m of the surface of a branch, or inside one."""
    places_m, radii_m, _ = sample_axes(skeleton, near_m)
    come, left = np.zeros(len(points_m), bool), np.arange(len(points_m))
    size = np.ceil(np.log2(radii_m))
    for each in np.unique(size)[::-1]:  # twigs are nearer to the bark of a thick branch than its axis is
        some = size == each
        farthest_m = near_m + 2.0**each
        found = scipy.spatial.cKDTree(places_m[some]).query(points_m[left], distance_upper_bound=farthest_m, workers=-1)
        away_m, near = (np.asarray(each) for each in found)
        within = np.isfinite(away_m)
        within[within] = away_m[within] - radii_m[some][near[within]] <= near_m
        come[left[within]] = True
        left = left[~within]
    return come


def distances_to_cloud(skeleton: Skeleton, points_m: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """(K,) from places spread over the surface of all branches, weighed evenly along them, to the nearest point."""
    places_m, radii_m, direction = sample_axes(skeleton, step_m)
    side, other = two_across(direction)
    turn = 2 * np.pi * (np.arange(len(places_m)) % _AROUND) / _AROUND
    surface_m = places_m + radii_m[:, None] * (np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other)
    return np.asarray(scipy.spatial.cKDTree(points_m).query(surface_m, workers=-1)[0])
