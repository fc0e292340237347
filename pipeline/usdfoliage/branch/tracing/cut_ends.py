"""Ends of thick branches that were cut off, or are seen no farther.

No branch tapers to a twig within its own thickness: where one as thick as that ends, its slices are bits of a rim, and
an axis through them turns aside to where the last point is.
"""

from dataclasses import replace

import numpy as np

from usdfoliage.branch.model import Skeleton

_NEAR_END = 4.0  # radii, within which no branch becomes a twig
_ASIDE = 0.5  # of the radius, that an end may lie beside where its branch points to
_MIN_FORWARD = 0.1  # of the radius, that an end goes on at least


def straighten_cut_ends(skeleton: Skeleton, thick_m: float) -> Skeleton:
    """Ends that turn aside within four radii of their branch go straight on, as far as they come and as thick.

    What springs there moves with its vertex, if it ends as near; what carries a longer branch is no end.

    Args:
        skeleton: Whose.
        thick_m: Radius from which on a branch is so thick that its slices have a rim.
    """
    if not len(skeleton):
        return skeleton
    path_m = skeleton.arcs_m
    beyond_m = path_m[skeleton.first + skeleton.counts - 1]  # of a branch, and of the longest that it carries
    for number in range(len(skeleton) - 1, -1, -1):
        parent, leaves_from = int(skeleton.parent_curve[number]), int(skeleton.parent_vertex[number])
        if parent >= 0:
            beyond_m[parent] = max(beyond_m[parent], path_m[leaves_from] + beyond_m[number])
    points_m, radius_m = skeleton.points_m.copy(), skeleton.radius_m.copy()
    for number in np.flatnonzero(np.maximum.reduceat(radius_m, skeleton.first) > thick_m).tolist():
        part = skeleton.branch(number)
        at_m, thickness_m = points_m[part], radius_m[part]
        near = (beyond_m[number] - path_m[part] <= _NEAR_END * thickness_m) & (thickness_m > thick_m)
        near[0] = False
        if not near[:-1].any():
            continue
        last = int(np.argmax(near))
        before = int(np.searchsorted(path_m[part], path_m[part][last] - thickness_m[last], side="right")) - 1
        direction = at_m[last] - at_m[max(before, 0)]
        direction /= max(float(np.linalg.norm(direction)), 1e-12)
        tail_m = at_m[last + 1 :] - at_m[last]
        along_m = tail_m @ direction
        if np.linalg.norm(tail_m - along_m[:, None] * direction, axis=1).max() <= _ASIDE * thickness_m[last]:
            continue
        share = (path_m[part][last + 1 :] - path_m[part][last]) / (path_m[part][-1] - path_m[part][last])
        forward_m = max(float(along_m.max()), _MIN_FORWARD * thickness_m[last])
        tail = slice(part.start + last + 1, part.stop)
        points_m[tail] = at_m[last] + (forward_m * share)[:, None] * direction
        radius_m[tail] = thickness_m[last]
    for number in np.flatnonzero(skeleton.parent_curve >= 0).tolist():  # parents first
        leaves_from = int(skeleton.parent_vertex[number])
        moved_m = points_m[leaves_from] - points_m[skeleton.first[number]]
        if moved_m.any():
            points_m[skeleton.branch(number)] += moved_m
            points_m[skeleton.first[number]] = points_m[leaves_from]
    return replace(skeleton, points_m=points_m, radius_m=radius_m)
