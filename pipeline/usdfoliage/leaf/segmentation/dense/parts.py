"""Parts of patches: leaves that touch are one patch, bent where they touch, or joined where no step is seen. Our own.

Where one leaf lies before another the depth steps, but not everywhere: next to its base, and where smoothing has closed
the step, both go on into each other. What is left between the steps is narrower there than the leaves are.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.segmentation.dense.patches import LocalPlanes

SPECK = 0.1  # squares of the radius that an island of a step has at most, to be noise
REACH = 2.5  # radii from a wide place to what is around it


@dataclass(frozen=True, kw_only=True)
class PartSettings:
    """Where patches are parted at narrow places."""

    # A step lies where the planes of neighbouring pixels are farther apart than this. Unit: footprints. Range: above
    # 0.
    gap: float = 1.0
    # Patches are parted where discs of these radii do not pass. Unit: median leaf lengths. Range: above 0.
    wide: tuple[float, ...] = (0.1, 0.15)

    def __post_init__(self) -> None:
        if not all(value > 0 for value in (self.gap, *self.wide)):
            raise ValueError(f"gap and wide must be above 0, not {self}")


def find_creases(normals: NDArray[np.float32], crease_deg: float, radius_px: int) -> NDArray[np.bool_]:
    """(H, W), where the surface of these normals (H, W, 3) turns by more than an angle within a window for planes."""
    reach = max(1, radius_px - 1)
    min_cosine = np.cos(np.radians(crease_deg))
    crease = np.zeros(normals.shape[:2], bool)
    across = np.sum(normals[:, 2 * reach :] * normals[:, : -2 * reach], axis=2) < min_cosine
    down = np.sum(normals[2 * reach :] * normals[: -2 * reach], axis=2) < min_cosine
    crease[:, reach:-reach] |= across
    crease[reach:-reach] |= down
    return crease


def find_steps(planes: LocalPlanes, gap: float) -> NDArray[np.bool_]:
    """(H, W) pixels on either side of a gap of so many footprints between the planes of neighbours."""
    steps = np.zeros(planes.support.shape, bool)
    right, down = planes.gap_right > gap, planes.gap_down > gap
    steps |= right | down
    steps[:, 1:] |= right[:, :-1]
    steps[1:] |= down[:-1]
    return steps


def part_at_necks(
    patches: NDArray[np.int32], steps: NDArray[np.bool_], radius_px: float, min_px: int
) -> NDArray[np.int32]:
    """Parts (H, W) of patches, from 1, 0 for none: each a place that is wide, and what of its patch is around it.

    Args:
        patches: (H, W), from 1, 0 for none.
        steps: (H, W), what bounds parts besides the rims of patches.
        radius_px: Of the disc that fits into a wide place.
        min_px: Smaller parts are dropped.
    """
    inside = patches > 0
    open_px = _without_specks(inside & ~steps, round(SPECK * radius_px**2))
    rim_px = cv2.distanceTransform(open_px.astype(np.uint8), cv2.DIST_L2, 5)
    wide = rim_px > radius_px
    count, cores = cv2.connectedComponents(wide.astype(np.uint8), connectivity=4)
    if count < 2:
        return np.zeros(inside.shape, np.int32)
    away_px, nearest = cv2.distanceTransformWithLabels(
        (~wide).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    core_of, patch_of = np.zeros((2, int(nearest.max()) + 1), np.int32)
    core_of[nearest[wide]] = cores[wide]
    patch_of[nearest[wide]] = patches[wide]
    near = inside & (away_px < REACH * radius_px) & (patches == patch_of[nearest])
    parts = np.where(near, core_of[nearest], 0)
    large = np.bincount(parts.ravel()) >= min_px
    large[0] = False
    return (np.cumsum(large) * large)[parts].astype(np.int32)


def _without_specks(open_px: NDArray[np.bool_], max_px: int) -> NDArray[np.bool_]:
    """(H, W), with small islands of what is not open opened."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats((~open_px).astype(np.uint8), connectivity=8)
    small = stats[:, cv2.CC_STAT_AREA] <= max_px
    small[0] = True  # what is open
    return np.asarray(small[labels])
