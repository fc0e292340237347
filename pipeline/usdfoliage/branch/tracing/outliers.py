"""What of a cloud lies far beside its plant: bits of the ground and of what is behind, that captures come with.

An outlier is linked with the plant in the end, as branches with gaps are, and then its path is a branch.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.point_cells import touching_parts

_TOP, _EDGE = 0.999, 0.995  # shares of the points that are lower than the top, and nearer than the edge
_LEAN = 0.5  # of the gap above a piece of trunk, that it stands beside the crown at most
_FEW = 100  # points, which show no crown


@dataclass(frozen=True, kw_only=True)
class OutlierSettings:
    """What is far from a plant."""

    gap_of_height: float = 0.1  # without any points, around what is a piece of its own
    max_points: float = 0.05  # of those of the largest piece, that a piece of outliers has
    low: float = 0.25  # of the height, below which points may be remains of the ground
    wide: float = (
        1.5  # of the reach of what is higher, beyond which they are: the lowest branches reach farther than it
    )

    def __post_init__(self) -> None:
        if not (self.gap_of_height > 0 and 0 <= self.max_points < 1):
            raise ValueError(f"gap_of_height must be above 0, max_points in [0, 1), not {self}")
        if not (0 < self.low < 1 and self.wide >= 1):
            raise ValueError(f"low must be in (0, 1), wide at least 1, not {self}")


def find_outliers(points_m: NDArray[np.float64], settings: OutlierSettings = OutlierSettings()) -> NDArray[np.bool_]:
    """(N,) points of small pieces apart from the plant, and beside it: a trunk below a crown is none, seen or not.

    Args:
        points_m: (N, 3), Y up, without ground.
        settings: What is far, and what is small.
    """
    gap_m = settings.gap_of_height * float(np.ptp(points_m[:, 1])) if len(points_m) else 0.0
    if not gap_m > 0:
        return np.zeros(len(points_m), bool)
    piece = touching_parts(points_m, gap_m)
    counts = np.bincount(piece)
    largest = int(counts.argmax())
    crown_m = points_m[piece == largest]
    plant = crown_m[:, [0, 2]]
    middle_m = np.column_stack([np.bincount(piece, points_m[:, axis]) / counts for axis in (0, 2)])
    # A trunk that leans may have its foot beside the crown, farther the higher the gap above it is.
    high_m, low_m = np.full((len(counts), 3), -np.inf), np.full((len(counts), 3), np.inf)
    np.maximum.at(high_m, piece, points_m)
    np.minimum.at(low_m, piece, points_m)
    size_m = high_m - low_m
    upright = size_m[:, 1] >= np.maximum(size_m[:, 0], size_m[:, 2])
    lean_m = np.where(upright, _LEAN * np.maximum(crown_m[:, 1].min() - high_m[:, 1], 0), 0.0)[:, None]
    outside = ((middle_m < plant.min(axis=0) - lean_m) | (middle_m > plant.max(axis=0) + lean_m)).any(axis=1)
    return np.asarray((outside & (counts < settings.max_points * counts[largest]))[piece])


def find_ground_remains(
    points_m: NDArray[np.float64], plane: NDArray[np.float64], settings: OutlierSettings = OutlierSettings()
) -> NDArray[np.bool_]:
    """(N,) points low above the ground and farther from the plant than it reaches.

    Far from the cameras' aim the ground is measured too roughly to lie in its plane, and what stands out of it would be
    taken for roots.

    Args:
        points_m: (N, 3), Y up, without the ground that was found.
        plane: (3,), y = plane . (x, z, 1), of that ground.
        settings: What is low, and what is far.
    """
    if not len(points_m):
        return np.zeros(0, bool)
    above_m = points_m[:, 1] - points_m[:, [0, 2]] @ plane[:2] - plane[2]
    low_m = settings.low * float(np.quantile(above_m, _TOP))
    high = above_m > low_m
    if high.sum() < _FEW:
        return np.zeros(len(points_m), bool)
    beside_m = points_m[:, [0, 2]] - np.median(points_m[high][:, [0, 2]], axis=0)
    away_m = np.hypot(beside_m[:, 0], beside_m[:, 1])
    reach_m = float(np.quantile(away_m[high], _EDGE))
    return np.asarray(~high & (away_m > settings.wide * reach_m))
