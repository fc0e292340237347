"""Parts of a cloud that lie apart from the plant: too far for a branch to lead there."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.sections import SectionTree

_GAP = 3.0  # typical steps, from which on there is a gap between a section and its parent


def find_beyond_gaps(
    sections: SectionTree, typical_m: NDArray[np.floating] | float, max_gap: float
) -> NDArray[np.bool_]:
    """(S,) sections that are reached across a gap longer than the path through all that lies beyond it.

    Every point is linked with the rest of the plant at last, however far it is; a branch across the air that leads to
    a handful of points is none, while one that leads to half a crown was hidden.

    Args:
        sections: Of the cloud.
        typical_m: Step from a section to its parent where there is no gap, everywhere or at each (S,).
        max_gap: Of the path beyond it, that a gap may be long.
    """
    tree = RootedTree(sections.parent)
    step_m = step_lengths(sections.center_m, sections.parent)
    gap = step_m > _GAP * np.asarray(typical_m)
    beyond_m = tree.sum_above(np.where(gap, 0.0, step_m))
    far = gap & (step_m > max_gap * beyond_m)
    return np.asarray(tree.sum_below(far.astype(np.float64)) > 0)
