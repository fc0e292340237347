"""Which points of the leaves in a cloud lie at their rims."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.directions import two_across
from usdfoliage.leaf.points import FREE_EDGE, INTERIOR
from usdfoliage.leaf.segmentation.cloud.working_cloud import WorkingCloud

GAP_RAD = 2.4  # widest angle without a neighbour of the same leaf from which a point lies at the rim


def find_rims(cloud: WorkingCloud, leaf: NDArray[np.int32]) -> NDArray[np.uint8]:
    """(W,) FREE_EDGE where the neighbours of the same leaf are all on one side, else INTERIOR.

    Args:
        cloud: W points with their neighbours.
        leaf: (W,), which leaf each is of, -1 for none.
    """
    kind = np.full(len(cloud), INTERIOR, np.uint8)
    own = np.flatnonzero(leaf >= 0)
    if not len(own):
        return kind
    near = cloud.neighbours[own]
    same = leaf[near] == leaf[own, None]
    right, up = two_across(cloud.normals[own])
    offset_m = cloud.points_m[near] - cloud.points_m[own, None]
    angle = np.arctan2(np.einsum("nki,ni->nk", offset_m, up), np.einsum("nki,ni->nk", offset_m, right))
    angle = np.sort(np.where(same, angle, np.inf), axis=1)
    count = same.sum(axis=1)
    first = angle[:, 0]
    last = angle[np.arange(len(own)), np.maximum(count - 1, 0)]
    with np.errstate(invalid="ignore"):
        gaps = np.diff(angle, axis=1)
    inner = np.max(np.where(np.isfinite(gaps), gaps, 0.0), axis=1, initial=0.0)
    around = np.full(len(own), 2 * np.pi)
    around[count > 0] -= last[count > 0] - first[count > 0]
    kind[own[np.maximum(inner, around) > GAP_RAD]] = FREE_EDGE
    return kind
