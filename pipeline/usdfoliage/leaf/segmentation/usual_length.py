"""How long the usual leaf of a scene is, before any leaf is known: from patches that look like whole leaves."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.segmentation.overlap import Overlaps
from usdfoliage.leaf.segmentation.patches import Patches

MOST_OF_PICTURE = 0.2  # share of a picture that one leaf takes, at most, to say what is usual


def gather_measure(patches: Sequence[Patches], name: str) -> NDArray[np.float64]:
    """(P,), a measure of the patches of all views, view after view."""
    return np.concatenate([np.asarray(getattr(found, name), np.float64) for found in patches])


def free_share(patches: Sequence[Patches]) -> NDArray[np.float64]:
    """(P,), share of the edge of each patch that is known to be free."""
    free, hidden, unknown = (gather_measure(patches, name) for name in ("free_px", "hidden_px", "unknown_px"))
    return free / np.maximum(free + hidden + unknown, 1)


def measure_usual_length(patches: Sequence[Patches], overlaps: Overlaps) -> float:
    """Length that half of the area of patches lies below that stand free, are flat ellipses and seen alike by views."""
    length_m, width_m, area_m2, fill = (
        gather_measure(patches, name) for name in ("length_m", "width_m", "area_m2", "fill")
    )
    slender, flat = width_m / np.maximum(length_m, 1e-30), gather_measure(patches, "thickness_m") < 0.08 * length_m
    small = gather_measure(patches, "pixels") < MOST_OF_PICTURE * min(found.labels.size for found in patches)
    shaped = small & (fill > 0.65) & (fill < 1.1) & (slender > 0.25) & flat & (gather_measure(patches, "pixels") > 150)
    shaped &= (overlaps.stability > 0.7) | (overlaps.views_seen == 0)
    sure = shaped & (free_share(patches) > 0.6)
    for least in (0.3, 0.1):  # where depth has holes along its edges, few edges are known to be free
        if np.count_nonzero(sure) < 10:
            sure = shaped & (free_share(patches) > least)
    if not sure.any():
        sure = small & (slender > 0.2)
    if not sure.any():
        return float(np.median(length_m)) if len(length_m) else 1.0
    order = np.argsort(length_m[sure], kind="stable")
    rising = np.cumsum(area_m2[sure][order])
    return float(length_m[sure][order][np.searchsorted(rising, rising[-1] / 2)])
