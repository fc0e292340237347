"""Which photographs to match with one: those that see the same places from an angle that determines depth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.pinhole import Pinhole

_GRID = np.stack(np.meshgrid(np.linspace(0.1, 0.9, 5), np.linspace(0.1, 0.9, 5)), -1).reshape(-1, 2)
_DEPTHS = np.linspace(0.1, 0.9, 4)  # of the range, in inverse depth


@dataclass(frozen=True, kw_only=True)
class ViewSelectionSettings:
    """Which angles between two lines of sight are worth matching."""

    # Photographs that see a place under a smaller angle are not matched, because depth is hardly determined. Unit:
    # degrees. Range: 0 to below good_angle_deg.
    min_angle_deg: float = 1.0
    # Angles between these two count in full. Unit: degrees. Range: above min_angle_deg, below max_angle_deg.
    good_angle_deg: tuple[float, float] = (6.0, 20.0)
    # Photographs that see a place under a larger angle are not matched, because leaves look too different. Unit:
    # degrees. Range: above good_angle_deg, below 180.
    max_angle_deg: float = 50.0
    # Another photograph must see at least this share of the places in a photograph's range. Range: 0 to 1.
    min_overlap: float = 0.1

    def __post_init__(self) -> None:
        low, high = self.good_angle_deg
        if not 0 <= self.min_angle_deg < low <= high < self.max_angle_deg < 180:
            raise ValueError(
                f"0 <= min_angle_deg < good_angle_deg < max_angle_deg < 180, not "
                f"{self.min_angle_deg:g}, {self.good_angle_deg}, {self.max_angle_deg:g}"
            )
        if not 0 <= self.min_overlap <= 1:
            raise ValueError(f"min_overlap must be in [0, 1], not {self.min_overlap:g}")


def select_views(
    cameras: Sequence[Pinhole],
    index: int,
    range_m: tuple[float, float],
    count: int,
    settings: ViewSelectionSettings = ViewSelectionSettings(),
) -> list[int]:
    """The views to match one view with, the most useful first; fewer than count, or none, where no others are usable.

    Places on a grid of the picture and of the range are looked at from every other camera. Each place that it sees
    scores by the angle between the two lines of sight: rising to the first good angle, falling from the second. Our own
    scoring; the piecewise shape is that of Y. Yao et al., MVSNet, 2018, section 4.1.

    Args:
        cameras: Of all views.
        index: Which of them is to be matched.
        range_m: Its nearest and farthest depth.
        count: Views wanted, at most.
        settings: Which angles are worth matching.
    """
    near_m, far_m = range_m
    if not 0 < near_m < far_m:
        raise ValueError(f"the range must be 0 < near < far, not {near_m:g}, {far_m:g}")
    if not 0 <= index < len(cameras) or count < 1:
        raise ValueError(f"view {index} of {len(cameras)}, and {count} others, cannot be chosen")
    camera = cameras[index]
    inverse = 1 / far_m + _DEPTHS * (1 / near_m - 1 / far_m)
    places = np.tile(_GRID * (camera.width_px, camera.height_px), (len(inverse), 1))
    targets_m = camera.unproject(places, np.repeat(1 / inverse, len(_GRID)))

    scores: list[tuple[float, int]] = []
    for k, other in enumerate(cameras):
        if k == index:
            continue
        seen_at, _ = other.project(targets_m)
        seen = np.all((seen_at >= 0) & (seen_at < (other.width_px, other.height_px)), axis=1)  # NaN is not
        if np.mean(seen) < settings.min_overlap:
            continue
        angle_deg = _angles_deg(targets_m, camera.position_m, other.position_m)
        score = float(np.sum(np.where(seen, _worth(angle_deg, settings), 0)))
        if score > 0:
            scores.append((-score, k))
    return [k for _, k in sorted(scores)[:count]]


def _worth(angle_deg: NDArray[np.float64], settings: ViewSelectionSettings) -> NDArray[np.float64]:
    low, high = settings.good_angle_deg
    corners = [settings.min_angle_deg, low, high, settings.max_angle_deg]
    return np.interp(angle_deg, corners, [0.0, 1.0, 1.0, 0.0], left=0.0, right=0.0)


def _angles_deg(
    targets_m: NDArray[np.float64], one_m: NDArray[np.float64], other_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N,), between the lines from targets (N, 3) to two places (3,)."""
    first, second = one_m - targets_m, other_m - targets_m
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, np.sum(first * second, axis=1))))
