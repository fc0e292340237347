"""Rims of surfaces that matching left without depth, filled up to the edge that the photograph shows. Our own.

Depth of photographs has holes along every silhouette: no other view shows the same background there. Where a leaf ends
is then unknown by as many pixels, yet the photograph shows it: its colours part the leaf from what is behind it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.segmentation.dense.patches import LocalPlanes, Patches


@dataclass(frozen=True, kw_only=True)
class RimSettings:
    """Which holes are filled."""

    # A hole is filled up to this distance from a surface, as a share of the photograph's longer side. Range: 0 to
    # below 1.
    reach: float = 0.008
    # Where the two sides of a hole differ by less than this share of white, colour does not decide which one it
    # belongs to. Range: 0 or more.
    contrast: float = 0.1
    # The surfaces on the two sides of a hole must differ in depth by this share, because leaves close together have
    # one colour. Range: 0 or more.
    apart: float = 0.1
    # A surface continues over its rim nearer or farther by up to this share of its depth. Range: 0 to below 1.
    max_change: float = 0.02

    def __post_init__(self) -> None:
        if not (0 <= self.reach < 1 and 0 <= self.max_change < 1 and min(self.contrast, self.apart) >= 0):
            raise ValueError(f"reach and max_change must be in [0, 1), contrast and apart not below 0, not {self}")


def fill_rims(
    srgb: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    planes: LocalPlanes,
    patches: Patches,
    settings: RimSettings = RimSettings(),
) -> NDArray[np.float32]:
    """Depth (H, W) with the narrow holes beside patches filled: the patch that the colours give a pixel goes on there.

    Args:
        srgb: (H, W, 3), the photograph.
        depth_m: (H, W), 0 where there is none; what is there stays.
        planes: Of this depth.
        patches: Of this depth.
        settings: How far.
    """
    reach_px = round(settings.reach * max(depth_m.shape))
    unknown = depth_m <= 0
    if reach_px < 1 or not unknown.any() or not len(patches):
        return depth_m
    # Seeds end a pixel before the hole, where colours are mixed and depth is of either side.
    seeds = np.where(unknown, 0, patches.labels).astype(np.int32)
    owner = cv2.watershed(np.ascontiguousarray(srgb), seeds.copy())
    # The lines between owners are given to one of them, so that each meets the other.
    beside = cv2.dilate(np.maximum(owner, 0).astype(np.float32), np.ones((3, 3), np.uint8)).astype(np.int32)
    owner = np.where(owner < 0, beside, owner).astype(np.int32)
    source, other = _nearest_known(seeds, owner, unknown & (owner > 0), reach_px)
    filled = unknown & (source >= 0)
    beyond = other[filled]
    own_m, beyond_m = depth_m.ravel()[source[filled]], depth_m.ravel()[np.maximum(beyond, 0)]
    sure = (beyond < 0) | (np.abs(own_m - beyond_m) > settings.apart * np.minimum(own_m, beyond_m))
    filled[filled] = sure & _colors_differ(srgb, filled, source[filled], beyond, settings.contrast)
    row, column = np.nonzero(filled)
    from_row, from_column = np.divmod(source[filled], depth_m.shape[1])
    slopes = planes.slopes[from_row, from_column]
    known_m = depth_m[from_row, from_column]
    inverse = 1 / known_m + slopes[:, 0] * (column - from_column) + slopes[:, 1] * (row - from_row)
    change = settings.max_change
    goes_on_m = np.clip(1 / np.maximum(inverse, 1e-12), (1 - change) * known_m, (1 + change) * known_m)
    result = depth_m.copy()
    result[filled] = goes_on_m
    return result


def _nearest_known(
    seeds: NDArray[np.int32], owner: NDArray[np.int32], holes: NDArray[np.bool_], reach_px: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Index (H, W) of a near pixel with depth of the same owner, and of another one; -1 where there is none.

    The other one may be twice as far: it has to reach across the hole.
    """
    source = np.where(seeds > 0, np.arange(seeds.size, dtype=np.int32).reshape(seeds.shape), np.int32(-1))
    other = np.full(seeds.shape, -1, np.int32)
    for turn in range(2 * reach_px):
        of_own, of_other = source.copy(), other.copy()
        for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
            beside, label = _shifted(of_own, axis, step), _shifted(owner, axis, step)
            same = label == owner
            if turn < reach_px:
                taken = holes & (source < 0) & (beside >= 0) & same
                source[taken] = beside[taken]
            across = np.where(same, _shifted(of_other, axis, step), beside)
            taken = holes & (other < 0) & (across >= 0)
            other[taken] = across[taken]
        if (source == of_own).all() and (other == of_other).all():
            break
    return source, other


def _colors_differ(
    srgb: NDArray[np.uint8],
    holes: NDArray[np.bool_],
    source: NDArray[np.int32],
    other: NDArray[np.int32],
    contrast: float,
) -> NDArray[np.bool_]:
    """(K,) pixels of holes whose colour is that of their own surface rather than of the other one, if there is one."""
    colors = cv2.blur(srgb, (3, 3)).astype(np.float32) / 255
    flat, here = colors.reshape(-1, 3), colors[holes]
    own, beyond = flat[source], flat[np.maximum(other, 0)]
    differs = np.linalg.norm(own - beyond, axis=1) > contrast
    like_own = np.linalg.norm(here - own, axis=1) < 0.5 * np.linalg.norm(here - beyond, axis=1)
    return np.asarray((other < 0) | (differs & like_own))


def _shifted(values: NDArray[np.int32], axis: int, step: int) -> NDArray[np.int32]:
    """(H, W), of the neighbour before or after; -1 beyond the border."""
    moved = np.roll(values, step, axis=axis)
    edge = (0 if step > 0 else -1,) if axis == 0 else (slice(None), 0 if step > 0 else -1)
    moved[edge] = -1
    return moved
