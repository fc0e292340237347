"""Places on axes that points of a surface belong to, and where branches come out of it."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.axis_places import Exits, Places, axis_exits, find_places
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.model import Skeleton


def ring_places(cage: BranchCage, skeleton: Skeleton) -> tuple[Places, NDArray[np.float64]]:
    """Where each ring and each hole of a cage is: the place next to its middle, on the parent for a hole; the middles.

    All points of a ring are one place: round a bend each has another nearest one.

    Returns:
        Places (R,), and (R, 3); of point p they are those of cage.ring[p].
    """
    sizes = np.bincount(cage.ring)
    curve = np.full(len(sizes), len(skeleton), np.int32)
    np.minimum.at(curve, cage.ring[cage.faces], cage.curve[:, None])  # a parent comes before its branches
    sums_m = np.stack([np.bincount(cage.ring, weights=column) for column in cage.points_m.T], axis=1)
    middle_m = sums_m / sizes[:, None]
    return find_places(skeleton, middle_m, curve), middle_m


def cage_places(cage: BranchCage, skeleton: Skeleton) -> Places:
    """The place that each point of a cage (P,) belongs to, that of its ring or hole."""
    rings, _ = ring_places(cage, skeleton)
    return Places(
        curve=rings.curve[cage.ring],
        vertex=rings.vertex[cage.ring],
        share=rings.share[cage.ring],
        arc_m=rings.arc_m[cage.ring],
    )


def cage_exits(cage: BranchCage, skeleton: Skeleton) -> Exits:
    """Where branches come out in a cage: in the middle of their holes; where axes do, for what is not in the cage."""
    exits = axis_exits(skeleton)
    rings, middle_m = ring_places(cage, skeleton)
    ring, curve = cage.ring[cage.faces.reshape(-1)], np.repeat(cage.curve, cage.faces.shape[1])
    shared = np.unique(np.column_stack([curve, ring])[rings.curve[ring] < curve], axis=0)
    child, first = np.unique(shared[:, 0], return_index=True)
    hole = shared[first, 1]
    arc_m = exits.arc_m.copy()
    arc_m[child] = find_places(skeleton, middle_m[hole], child).arc_m
    # A branch that goes on from a tip may have the hole of its neighbour, which springs from the same parent.
    below = np.array([_is_below(skeleton, *pair) for pair in zip(rings.curve[hole], child, strict=True)], bool)
    exit_curve, parent_arc_m = exits.curve.copy(), exits.parent_arc_m.copy()
    exit_curve[child[below]] = rings.curve[hole[below]]
    parent_arc_m[child[below]] = rings.arc_m[hole[below]]
    return Exits(curve=exit_curve, parent_arc_m=parent_arc_m, arc_m=arc_m)


def _is_below(skeleton: Skeleton, lower: int, upper: int) -> bool:
    """Whether a branch carries another one."""
    while upper > lower:  # parents come first
        upper = skeleton.parent_curve[upper]
    return upper == lower
