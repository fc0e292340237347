"""Where a branch springs from its parent: from where it points back to, not from the slice in which the two part.

Slices of a stem and of a limb beside it are one until they are apart, and the middle of the last one is the fork: the
limb would leave the stem level, inside it, and turn up outside, like a knee.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.model import Skeleton

_BELOW = 2.0  # radii of the parent, that a branch may spring lower than where it comes out: no flatter fork is sought
_ABOVE = 0.5  # and higher
_CHORD = 1.5  # radii of the parent, over which it is seen where a branch points


def settle_attachments(skeleton: Skeleton) -> Skeleton:
    """Branches that go straight from their parent's axis to where they come out of it, as they point there.

    Of what a branch was inside its parent nothing is left; what sprang there springs from where it comes out.

    Args:
        skeleton: With vertices closer together than its branches are thick.
    """
    points_m, radius_m, path_m = skeleton.points_m.copy(), skeleton.radius_m.copy(), skeleton.arcs_m
    leaves_from = skeleton.parent_vertex.copy()
    kept = np.ones(len(points_m), bool)
    comes_out = np.arange(len(points_m))  # the vertex that takes the place of each
    axes: dict[int, tuple[NDArray[np.intp], cKDTree]] = {}  # of parents, which stay once they are reached
    for number in np.flatnonzero(skeleton.parent_curve >= 0).tolist():
        part, parent = skeleton.branch(number), int(skeleton.parent_curve[number])
        leaves_from[number] = comes_out[leaves_from[number]]
        if parent not in axes:
            stem = skeleton.branch(parent)
            left = np.flatnonzero(kept[stem]) + stem.start
            axes[parent] = left, cKDTree(points_m[left])
        axis, tree = axes[parent]
        own_m = points_m[part]
        away_m, nearest = (np.asarray(each) for each in tree.query(own_m[1:]))
        outside = away_m > radius_m[axis][nearest]
        if outside.any() and len(axis) > 1:
            out = int(np.argmax(outside)) + 1
            thick_m = float(radius_m[axis[nearest[out - 1]]])
            own_path_m = path_m[part]
            far = min(int(np.searchsorted(own_path_m, own_path_m[out] + _CHORD * thick_m)), len(own_m) - 1)
            direction = own_m[far] - own_m[out] if far > out else own_m[out] - own_m[out - 1]
            level_m = path_m[axis[nearest[out - 1]]]
            low = np.searchsorted(path_m[axis], level_m - _BELOW * thick_m)
            high = np.searchsorted(path_m[axis], level_m + _ABOVE * thick_m, side="right")
            high = max(int(high), 2)  # not where the parent itself springs
            there = axis[min(max(int(low), 1), high - 1) : high]
            at = int(there[_pointing_best(points_m[there], own_m[out], direction)])
            leaves_from[number] = at
            comes_out[part.start : part.start + out] = part.start + out
            kept[part.start + 1 : part.start + out] = False
            radius_m[part.start] = min(radius_m[part.start + out], radius_m[at])
        points_m[part.start] = points_m[leaves_from[number]]
    return replace(
        skeleton, points_m=points_m, radius_m=radius_m, parent_vertex=leaves_from.astype(np.int32)
    ).only_vertices(kept)


def _pointing_best(from_m: NDArray[np.float64], to_m: NDArray[np.float64], direction: NDArray[np.float64]) -> int:
    """Of places (K, 3) the one from which the line to a point is nearest to a direction."""
    path_m = to_m - from_m
    return int(np.argmax(path_m @ direction / np.maximum(np.linalg.norm(path_m, axis=1), 1e-12)))
