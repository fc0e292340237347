"""How several views' depth maps confirm each other: depth that others confirm is kept and made more exact."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.pinhole import Pinhole

_ONE_SURFACE_STEPS = 4  # pixels beside each other whose depths differ by more belong to two surfaces


@dataclass(frozen=True, kw_only=True)
class ConsistencySettings:
    """When depth is confirmed."""

    # Two depths agree where they differ by up to this many of their own steps. Unit: steps. Range: above 0.
    max_steps: float = 1.5
    min_confirmed: int = 1  # At least this many other photographs must agree. Range: 0 or more.
    max_views: int = 6  # The depth of this many nearest photographs is compared. Range: 1 or more.
    min_region_px: int = 30  # Smaller connected regions of depth are dropped. Unit: pixels. Range: 0 or more.

    def __post_init__(self) -> None:
        if not self.max_steps > 0 or self.min_confirmed < 0 or self.max_views < 1 or self.min_region_px < 0:
            raise ValueError("max_steps must be above 0, max_views at least 1, the others not below 0")


def keep_consistent(
    cameras: Sequence[Pinhole],
    depths_m: Sequence[NDArray[np.floating]],
    steps_m: Sequence[NDArray[np.floating]],
    settings: ConsistencySettings = ConsistencySettings(),
) -> list[NDArray[np.float32]]:
    """Depth maps without what other views contradict or do not confirm; kept depth is the median of all that agree.

    A pixel's point is looked up in another view's depth map. Similar depth there confirms it; larger depth contradicts
    it, because that view looks through it; smaller depth decides nothing, it is hidden there. A pixel stays if at least
    min_confirmed views agree and not more contradict.

    Args:
        cameras: One a map.
        depths_m: (H, W) each, along the optical axis, 0 where there is none.
        steps_m: (H, W) each, how exact each depth is.
        settings: When depth is confirmed.

    Source:
        P. Merrell et al., Real-time visibility-based fusion of depth maps, 2007, section 3 (stability by votes).
    """
    return [
        _drop_small_regions(_confirmed(cameras, depths_m, steps_m, index, settings), steps_m[index], settings)
        for index in range(len(cameras))
    ]


def _confirmed(
    cameras: Sequence[Pinhole],
    depths_m: Sequence[NDArray[np.floating]],
    steps_m: Sequence[NDArray[np.floating]],
    index: int,
    settings: ConsistencySettings,
) -> NDArray[np.float32]:
    camera, depth_m = cameras[index], depths_m[index]
    kept = np.zeros(depth_m.shape, np.float32)
    rows, columns = np.nonzero(depth_m > 0)
    if not len(rows):
        return kept
    own_m, step_m = depth_m[rows, columns].astype(np.float64), steps_m[index][rows, columns]
    points_m = camera.unproject(np.stack([columns + 0.5, rows + 0.5], axis=1), own_m)

    agreeing_m = [own_m]
    confirming, contradicting = np.zeros(len(rows), int), np.zeros(len(rows), int)
    for k in _nearest(cameras, index, settings.max_views):
        places, expected_m = cameras[k].project(points_m)
        theirs_m, their_step_m = _sample(cameras[k], depths_m[k], steps_m[k], places)
        tolerance_m = settings.max_steps * np.maximum(their_step_m, step_m)
        known = theirs_m > 0
        agrees = known & (np.abs(theirs_m - expected_m) <= tolerance_m)
        confirming += agrees
        contradicting += known & (theirs_m - expected_m > tolerance_m)
        estimate_m = np.full(len(rows), np.nan)
        _, estimate_m[agrees] = camera.project(cameras[k].unproject(places[agrees], theirs_m[agrees]))
        agreeing_m.append(estimate_m)
    stays = (confirming >= settings.min_confirmed) & (contradicting <= confirming)
    if stays.any():
        kept[rows[stays], columns[stays]] = _median(np.stack(agreeing_m)[:, stays])
    return kept


def _median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Medians (N,) of columns (K, N), NaN left out; some seconds faster than numpy's own for a photograph."""
    ordered = np.sort(values, axis=0)  # NaN goes last
    count = np.count_nonzero(~np.isnan(ordered), axis=0)
    each = np.arange(values.shape[1])
    return np.asarray((ordered[(count - 1) // 2, each] + ordered[count // 2, each]) / 2)


def _nearest(cameras: Sequence[Pinhole], index: int, count: int) -> list[int]:
    """Views that are most similar: nearest positions, the earlier one first where equal."""
    away = [float(np.linalg.norm(other.position_m - cameras[index].position_m)) for other in cameras]
    return [k for k in np.argsort(away, kind="stable").tolist() if k != index][:count]


def _sample(
    camera: Pinhole, depth_m: NDArray[np.floating], step_m: NDArray[np.floating], places_px: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depth (N,) and its step at places (N, 2); between pixels where these are of one surface; 0 outside."""
    inside = np.all((places_px >= 0) & (places_px < (camera.width_px, camera.height_px)), axis=1)  # NaN is not
    places = np.where(inside[:, None], places_px, 0)
    column, row = places.astype(int).T
    nearest_m = np.where(inside, depth_m[row, column], 0).astype(np.float64)
    nearest_step_m = step_m[row, column].astype(np.float64)

    left = np.clip((places[:, 0] - 0.5).astype(int), 0, camera.width_px - 2)
    top = np.clip((places[:, 1] - 0.5).astype(int), 0, camera.height_px - 2)
    across, down = np.clip(places[:, 0] - 0.5 - left, 0, 1), np.clip(places[:, 1] - 0.5 - top, 0, 1)
    corners_m = np.stack(
        [depth_m[top, left], depth_m[top, left + 1], depth_m[top + 1, left], depth_m[top + 1, left + 1]]
    )
    weights = np.stack([(1 - across) * (1 - down), across * (1 - down), (1 - across) * down, across * down])
    one_surface = (corners_m > 0).all(axis=0) & (np.ptp(corners_m, axis=0) <= _ONE_SURFACE_STEPS * nearest_step_m)
    between_m = np.sum(weights * corners_m, axis=0)
    return np.where(inside & one_surface, between_m, nearest_m), nearest_step_m


def _drop_small_regions(
    depth_m: NDArray[np.float32], step_m: NDArray[np.floating], settings: ConsistencySettings
) -> NDArray[np.float32]:
    """Without connected pieces of depth below min_region_px; a jump of more than two planes parts pieces."""
    if not (depth_m > 0).any():
        return depth_m
    step = float(np.median(step_m[depth_m > 0] / depth_m[depth_m > 0] ** 2))  # the same everywhere, in inverse depth
    steps = np.zeros(depth_m.shape, np.float32)
    np.divide(1 / step, depth_m, out=steps, where=depth_m > 0)
    # filterSpeckles takes 16 bits: quarters of a step, modulo nothing, since a sweep has some hundred planes
    quarters = np.clip(np.rint(4 * (steps - steps[depth_m > 0].min())) + 1, 0, 32000).astype(np.int16)
    quarters[depth_m == 0] = 0
    cv2.filterSpeckles(quarters, 0, settings.min_region_px, 8)
    return np.where(quarters > 0, depth_m, np.float32(0))
