"""Which features of two photographs with known cameras may show the same point: similar, and near the epipolar line."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.poses.pairs import DESCRIPTOR_NORM

_BLOCK = 1024  # features of the first photograph that are compared at once


@dataclass(frozen=True, kw_only=True)
class GuidedMatchSettings:
    """When two features match, where the cameras are known."""

    max_line: float = 0.005  # distance from the epipolar line, as a share of the focal length
    max_ratio: float = 0.85  # of the angle to the nearest and to the second nearest descriptor near the line
    max_angle_rad: float = 0.7
    max_size_ratio: float = 2.0  # of the sizes of the two features

    def __post_init__(self) -> None:
        if not (self.max_line > 0 and 0 < self.max_ratio <= 1 and self.max_angle_rad > 0 and self.max_size_ratio >= 1):
            raise ValueError(f"limits must be above 0, max_ratio up to 1, max_size_ratio 1 or more, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenFeatures:
    """Features of one photograph."""

    rays: NDArray[np.float64]  # (N, 2), x and y of the direction in the camera's frame where z is 1
    size_px: NDArray[np.float64]  # (N,)
    descriptors: NDArray[np.uint8]  # (N, 128), of unit length times 512


def match_near_lines(
    first: SeenFeatures,
    second: SeenFeatures,
    second_from_first: NDArray[np.float64],
    settings: GuidedMatchSettings = GuidedMatchSettings(),
) -> NDArray[np.uint32]:
    """Pairs of features that are each other's nearest among those near each other's epipolar line.

    A surface that repeats has its next equal place elsewhere than on the line, so that more features pass than
    where all of the photograph is searched, and fewer of them are wrong.

    Args:
        first: Features of the first photograph.
        second: Of the second one.
        second_from_first: (3, 4), the second camera's frame from the first one's.
        settings: When they match.

    Returns:
        (K, 2), numbers of the first and of the second, in the order of the first.

    Source:
        R. Hartley and A. Zisserman, Multiple View Geometry, 2004, algorithm 11.4, guided matching.
    """
    if not len(first.rays) or not len(second.rays):
        return np.zeros((0, 2), np.uint32)
    essential = _cross(second_from_first[:, 3]) @ second_from_first[:, :3]
    rays = np.column_stack([first.rays, np.ones(len(first.rays))])
    other_rays = np.column_stack([second.rays, np.ones(len(second.rays))])
    lines, other_lines = rays @ essential.T, other_rays @ essential  # in the second and in the first photograph
    slope = np.maximum(np.hypot(*lines[:, :2].T), 1e-300)
    other_slope = np.maximum(np.hypot(*other_lines[:, :2].T), 1e-300)
    columns = np.ascontiguousarray(second.descriptors.astype(np.float32).T)
    log_size, other_log_size = np.log(first.size_px), np.log(second.size_px)
    count, other_count = len(rays), len(other_rays)
    nearest, dots = np.zeros(count, np.int64), np.full((2, count), -1, np.float32)
    back, back_dot = np.zeros(other_count, np.int64), np.full(other_count, -1, np.float32)
    for start in range(0, count, _BLOCK):
        rows = slice(start, min(start + _BLOCK, count))
        far = np.abs(lines[rows] @ other_rays.T)
        allowed = far < settings.max_line * np.minimum(slope[rows, None], other_slope)
        allowed &= np.abs(log_size[rows, None] - other_log_size) <= np.log(settings.max_size_ratio)
        table = first.descriptors[rows].astype(np.float32) @ columns
        table[~allowed] = -1
        best = table.argmax(axis=0)
        best_dot = table[best, np.arange(other_count)]
        better = best_dot > back_dot
        back[better], back_dot[better] = best[better] + start, best_dot[better]
        own, along = table.argmax(axis=1), np.arange(rows.stop - start)
        nearest[rows], dots[0, rows] = own, table[along, own]
        table[along, own] = -1
        dots[1, rows] = table.max(axis=1)
    angles = np.arccos(np.clip(dots / np.float32(DESCRIPTOR_NORM**2), -1, 1))
    good = (
        (dots[0] >= 0)
        & (back[nearest] == np.arange(count))
        & (angles[0] <= settings.max_angle_rad)
        & (angles[0] < settings.max_ratio * angles[1])
    )
    chosen = np.flatnonzero(good)
    return np.column_stack([chosen, nearest[chosen]]).astype(np.uint32)


def _cross(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3), what multiplies as the cross product with a vector."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
