"""Which features of two photographs with known cameras may show the same point: similar, and near the epipolar line."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.poses.pairs import match_nearest


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
    log_size, other_log_size = np.log(first.size_px), np.log(second.size_px)

    def near(rows: slice) -> NDArray[np.bool_]:
        far = np.abs(lines[rows] @ other_rays.T)
        found = far < settings.max_line * np.minimum(slope[rows, None], other_slope)
        found &= np.abs(log_size[rows, None] - other_log_size) <= np.log(settings.max_size_ratio)
        return found

    return match_nearest(first.descriptors, second.descriptors, settings.max_ratio, settings.max_angle_rad, near)


def _cross(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3), what multiplies as the cross product with a vector."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
