"""How long internodes are: the way along a branch from one side branch or petiole to the next. Our own."""

import numpy as np

from usdfoliage.branch.model import Skeleton

_ONE_NODE = 4.0  # radii of the branch, within which side branches leave from one node, as opposite leaves do
_FEW = 3  # internodes, of which fewer show no length


def measure_internode_m(skeleton: Skeleton) -> float | None:
    """The median length of the internodes of a skeleton, metres; None where it shows fewer than three.

    What is below the first node of a branch and above its last one is no internode. Nodes nearer to each other than
    two diameters of the branch are one.
    """
    side = np.flatnonzero(skeleton.parent_curve >= 0)
    parent, vertex = skeleton.parent_curve[side], skeleton.parent_vertex[side]
    at_m = skeleton.arcs_m[vertex]
    order = np.lexsort((at_m, parent))
    parent, vertex, at_m = parent[order], vertex[order], at_m[order]
    gap_m = np.diff(at_m)
    between = (np.diff(parent) == 0) & (gap_m > _ONE_NODE * skeleton.radius_m[vertex[1:]])
    if np.count_nonzero(between) < _FEW:
        return None
    return float(np.median(gap_m[between]))
