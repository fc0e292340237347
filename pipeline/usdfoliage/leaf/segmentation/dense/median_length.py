"""How long the median leaf of a scene is, before any leaf is known: from patches that look like whole leaves."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.segmentation.dense.overlap import Overlaps
from usdfoliage.leaf.segmentation.dense.patches import Patches

SMALLEST_RADIUS, LARGEST_RADIUS = 3.0, 1 / 12  # in pixels, and in the longer side of a picture
MIN_PARTS = 10  # of one radius, that count
MAX_OF_PICTURE = 0.2  # share of a picture that one leaf takes, at most, to count for the median


def gather_measure(patches: Sequence[Patches], name: str) -> NDArray[np.float64]:
    """(P,), a measure of the patches of all views, view after view."""
    return np.concatenate([np.asarray(getattr(found, name), np.float64) for found in patches])


def free_share(patches: Sequence[Patches]) -> NDArray[np.float64]:
    """(P,), share of the edge of each patch that is known to be free."""
    free, hidden, unknown = (gather_measure(patches, name) for name in ("free_px", "hidden_px", "unknown_px"))
    return free / np.maximum(free + hidden + unknown, 1)


def measure_median_length(patches: Sequence[Patches], overlaps: Overlaps) -> float:
    """Length that half of the area of patches lies below that stand free, are flat ellipses and seen equally by
    views."""
    length_m, width_m, area_m2, fill = (
        gather_measure(patches, name) for name in ("length_m", "width_m", "area_m2", "fill")
    )
    slender, flat = width_m / np.maximum(length_m, 1e-30), gather_measure(patches, "thickness_m") < 0.08 * length_m
    small = gather_measure(patches, "pixels") < MAX_OF_PICTURE * min(found.labels.size for found in patches)
    shaped = small & (fill > 0.65) & (fill < 1.1) & (slender > 0.25) & flat & (gather_measure(patches, "pixels") > 150)
    shaped &= (overlaps.stability > 0.7) | (overlaps.views_seen == 0)
    sure = shaped & (free_share(patches) > 0.6)
    for min_free in (0.3, 0.1):  # where depth has holes along its edges, few edges are known to be free
        if np.count_nonzero(sure) < 10:
            sure = shaped & (free_share(patches) > min_free)
    if not sure.any():
        sure = small & (slender > 0.2)
    if not sure.any():
        return float(np.median(length_m)) if len(length_m) else 1.0
    order = np.argsort(length_m[sure], kind="stable")
    rising = np.cumsum(area_m2[sure][order])
    return float(length_m[sure][order][np.searchsorted(rising, rising[-1] / 2)])


def ladder_of_radii(side_px: int) -> list[float]:
    """Radii in pixels of discs that fit into leaves of all sizes that a picture of this longer side may show."""
    radii = []
    radius = SMALLEST_RADIUS
    while radius < LARGEST_RADIUS * side_px:
        radii.append(radius)
        radius *= 2**0.5
    return radii


def measure_part_length(
    parts: Sequence[Sequence[Patches]], radii_px: Sequence[float], footprint_m: float
) -> float | None:
    """Length that half of the area of parts lies below that are flat ellipses, mostly free, and as wide as they should.

    Patches of leaves that touch look like one large leaf; parted at necks of all sizes, leaves come out at about half
    of their own width. None where too few parts look like leaves.

    Args:
        parts: For each radius, the parts of some views with cores that a disc of this radius fits into.
        radii_px: The radii.
        footprint_m: Of a pixel.
    """
    lengths, areas = [], []
    for found, radius_px in zip(parts, radii_px, strict=True):
        length_m, width_m, area_m2, fill = (
            gather_measure(found, n) for n in ("length_m", "width_m", "area_m2", "fill")
        )
        slender, width_px = width_m / np.maximum(length_m, 1e-30), width_m / footprint_m
        sure = (
            (fill > 0.65) & (fill < 1.1) & (slender > 0.3) & (slender < 0.85) & (gather_measure(found, "pixels") > 150)
        )
        sure &= (gather_measure(found, "thickness_m") < 0.1 * length_m) & (free_share(found) > 0.4)
        sure &= (width_px > 2 * radius_px) & (width_px < 5 * radius_px)
        if np.count_nonzero(sure) >= MIN_PARTS:
            lengths.append(length_m[sure])
            areas.append(area_m2[sure])
    if not lengths:
        return None
    length_m, area_m2 = np.concatenate(lengths), np.concatenate(areas)
    order = np.argsort(length_m, kind="stable")
    rising = np.cumsum(area_m2[order])
    return float(length_m[order][np.searchsorted(rising, rising[-1] / 2)])
