"""What all views say of the points of a cloud: which have them, and which see through them.

Section 4 of J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, asks the views that a
photograph is matched with; here every depth map is asked about every point, one map at a time.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud import Cloud
from usdfoliage.geometry.pinhole import Pinhole

_CHUNK = 500_000  # points looked at at once


@dataclass(frozen=True, kw_only=True)
class VisibilitySettings:
    """Which points the views see through too often."""

    through: float = 2.0  # views that see something behind a point for each that has it; with more it is dropped
    agree_share: float = 0.01  # of the depth, by which a view's own may differ from a point that it has

    def __post_init__(self) -> None:
        if not self.through >= 0 or not (np.isfinite(self.agree_share) and self.agree_share > 0):
            raise ValueError("through must not be below 0, inf keeps all; agree_share must be above 0")


def count_views(
    points_m: NDArray[np.float64],
    depths: Iterable[tuple[Pinhole, NDArray[np.float32]]],
    settings: VisibilitySettings = VisibilitySettings(),
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Views that have each point (N,), and views that see something behind it (N,).

    Args:
        points_m: (N, 3), of the world.
        depths: Camera and depth (H, W) of each view, 0 where there is none; taken one by one.
        settings: How near.
    """
    having, through = np.zeros(len(points_m), np.int32), np.zeros(len(points_m), np.int32)
    for camera, depth_m in depths:
        for start in range(0, len(points_m), _CHUNK):
            part = slice(start, start + _CHUNK)
            places, away_m = camera.project(points_m[part])
            inside = (away_m > 0) & np.all((places >= 0) & (places < (camera.width_px, camera.height_px)), axis=1)
            columns, rows = places[inside].astype(np.int64).T
            found_m, expected_m = depth_m[rows, columns], away_m[inside]
            having[part][inside] += np.abs(found_m - expected_m) <= settings.agree_share * expected_m
            through[part][inside] += found_m > (1 + 2 * settings.agree_share) * expected_m
    return having, through


def drop_seen_through(
    cloud: Cloud,
    depths: Iterable[tuple[Pinhole, NDArray[np.float32]]],
    settings: VisibilitySettings = VisibilitySettings(),
) -> Cloud:
    """Without points that views see through too often; of the others it is known how many views have them."""
    if np.isinf(settings.through):
        return cloud
    having, through = count_views(cloud.points_m, depths, settings)
    counted = replace(cloud, views=np.maximum(cloud.views, having))
    return counted.take(through <= settings.through * np.maximum(having, 1))
