"""Rigid motion that lays one set of points on another.

Source: P. Besl, N. McKay, A Method for Registration of 3-D Shapes, 1992.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree


@dataclass(frozen=True, kw_only=True)
class IcpSettings:
    """When the iteration ends."""

    iterations: int = 300  # The iteration ends after this many steps. Range: 1 or more.
    # The iteration ends where the template moves by less than this share of the correspondence distance. Range: above
    # 0.
    still: float = 5e-3

    def __post_init__(self) -> None:
        if self.iterations < 1 or self.still <= 0:
            raise ValueError(f"iterations must be at least 1 and still above 0, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """Where the source lies on the target."""

    target_from_source: NDArray[np.float64]  # (3, 4), rigid
    matched: float  # share of the source's points that have a correspondence
    rms_m: float  # of the correspondences; NaN if there are none
    iterations: int


def register_points(
    source: NDArray[np.float64],
    target: KDTree,
    start: NDArray[np.float64],
    max_distance_m: float,
    settings: IcpSettings = IcpSettings(),
) -> Alignment:
    """Iterate closest points from a start.

    Args:
        source: (N, 3).
        target: Of points (M, 3).
        start: (3, 4), target from source, rigid.
        max_distance_m: Pairs farther apart do not count.
        settings: When it ends.
    """
    motion = start.copy()
    cloud = np.asarray(target.data)
    size = float(np.abs(source - source.mean(axis=0)).max(initial=0.0))
    used, matched, rms_m = 0, 0.0, float("nan")
    while used < settings.iterations:
        used += 1
        moved = source @ motion[:, :3].T + motion[:, 3]
        distance, nearest = target.query(moved, distance_upper_bound=max_distance_m)
        distance, nearest = np.atleast_1d(distance), np.atleast_1d(nearest)
        near = np.isfinite(distance)
        matched = float(near.mean())
        if np.count_nonzero(near) < 3:
            break
        rms_m = float(np.sqrt(np.mean(distance[near] ** 2)))
        step = rigid_motion(moved[near], cloud[nearest[near]])
        motion = np.column_stack([step[:, :3] @ motion[:, :3], step[:, :3] @ motion[:, 3] + step[:, 3]])
        middle = moved.mean(axis=0)
        shift = np.linalg.norm(step[:, :3] @ middle + step[:, 3] - middle)
        turn = np.linalg.norm(step[:, :3] - np.eye(3)) * size
        if shift + turn < settings.still * max_distance_m:
            break
    return Alignment(target_from_source=motion, matched=matched, rms_m=rms_m, iterations=used)


def rigid_motion(source: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 4): the rigid motion of points (N, 3) closest to their partners (N, 3), by least squares.

    Source: W. Kabsch, A solution for the best rotation to relate two sets of vectors, 1976.
    """
    from_mean, to_mean = source.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((target - to_mean).T @ (source - from_mean))
    if np.linalg.det(left @ right) < 0:
        left[:, 2] = -left[:, 2]
    rotation = left @ right
    return np.column_stack([rotation, to_mean - rotation @ from_mean])
