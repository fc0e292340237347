"""What all views show of the points of a cloud: which have them, and which see through them.

Section 4 of J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, asks the views that a
photograph is matched with; here every depth map is asked about every point, one map at a time.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.files.threads import map_threaded, share_cores
from usdfoliage.geometry.pinhole import Pinhole

_CHUNK = 200_000  # points that a thread looks at at once


@dataclass(frozen=True, kw_only=True)
class VisibilitySettings:
    """Which points the views see through too often."""

    # A point is dropped where more photographs see through it than this many for each that has it; inf keeps all.
    # Range: 0 or more.
    through: float = 2.0
    # A photograph has a point where its depth differs from the point's by up to this share. Range: above 0.
    agree_share: float = 0.01

    def __post_init__(self) -> None:
        if not self.through >= 0 or not (np.isfinite(self.agree_share) and self.agree_share > 0):
            raise ValueError("through must not be below 0, inf keeps all; agree_share must be above 0")


def count_views(
    points_m: NDArray[np.float64],
    depths: Iterable[tuple[Pinhole, NDArray[np.float32]]],
    settings: VisibilitySettings = VisibilitySettings(),
    *,
    threads: int = 0,
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Views that have each point (N,), and views that see something behind it (N,).

    Args:
        points_m: (N, 3), of the world.
        depths: Camera and depth (H, W) of each view, 0 where there is none; taken one by one.
        settings: How near.
        threads: 0: one per core, but a few at most.
    """
    having, through = np.zeros(len(points_m), np.int32), np.zeros(len(points_m), np.int32)
    parts = [slice(start, start + _CHUNK) for start in range(0, len(points_m), _CHUNK)]
    for camera, depth_m in depths:

        def count(part: slice, camera: Pinhole = camera, depth_m: NDArray[np.float32] = depth_m) -> None:
            """Parts share no point, so that threads never write to one place."""
            places, away_m = camera.project(points_m[part])
            x, y = places.T
            inside = np.flatnonzero((away_m > 0) & (x >= 0) & (x < camera.width_px) & (y >= 0) & (y < camera.height_px))
            pixels = y[inside].astype(np.int64) * camera.width_px + x[inside].astype(np.int64)
            found_m, expected_m = depth_m.reshape(-1)[pixels], away_m[inside]
            having[part][inside] += np.abs(found_m - expected_m) <= settings.agree_share * expected_m
            through[part][inside] += found_m > (1 + 2 * settings.agree_share) * expected_m

        for _ in map_threaded(count, parts, threads=share_cores(threads)[0]):
            pass
    return having, through


def drop_seen_through(
    cloud: Cloud,
    depths: Iterable[tuple[Pinhole, NDArray[np.float32]]],
    settings: VisibilitySettings = VisibilitySettings(),
    *,
    threads: int = 0,
) -> Cloud:
    """Without points that views see through too often; of the others it is known how many views have them."""
    if np.isinf(settings.through):
        return cloud
    having, through = count_views(cloud.points_m, depths, settings, threads=threads)
    counted = replace(cloud, views=np.maximum(cloud.views, having))
    return counted.take(through <= settings.through * np.maximum(having, 1))
