"""Allometry: how thick branches are by what they carry.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, equation 5: of a node's diameter d_p
each child has d_c = d_p (l_c / sum l)^gamma, where l is the length of all that the child carries. Here the internode to
the child counts as carried by its parent, so that branches taper between forks as well, and the product along the way
from the root becomes d_root (l / l_root)^gamma.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.rooted_tree import RootedTree


@dataclass(frozen=True, kw_only=True)
class AllometrySettings:
    """How thickness follows from length."""

    exponent: float = 0.45  # gamma; table 2 has 0.41 to 0.50

    def __post_init__(self) -> None:
        if not 0 < self.exponent <= 2:
            raise ValueError(f"exponent must be in (0, 2], not {self.exponent:g}")


def carried_lengths(tree: RootedTree, step_m: NDArray[np.float64], min_m: float | None = None) -> NDArray[np.float64]:
    """(S,) length of all internodes above each node, and half its own, so that a tip carries something too.

    Args:
        tree: Of the nodes.
        step_m: (S,), internode to each node from its parent.
        min_m: What a tip carries at least; half of the typical internode by default.
    """
    if min_m is None:
        min_m = min_carried(step_m)
    return np.asarray(tree.sum_above(step_m) - step_m + np.maximum(0.5 * step_m, min_m))


def min_carried(step_m: NDArray[np.float64]) -> float:
    """Half of the median internode, of those (S,) that have a length."""
    return 0.5 * float(np.median(step_m[step_m > 0])) if (step_m > 0).any() else 1.0


def grow_radii(
    tree: RootedTree,
    step_m: NDArray[np.float64],
    known_m: float | NDArray[np.floating],
    settings: AllometrySettings = AllometrySettings(),
) -> NDArray[np.float64]:
    """(S,) radius of every node from those that are known, outwards (eq. 5).

    Args:
        tree: Of the nodes.
        step_m: (S,), internode to each node from its parent.
        known_m: Of all roots, or (S,) of nodes, NaN where it is to be found; that of a root must be known.
        settings: The exponent.

    Raises:
        ValueError: A root's radius is not known.
    """
    carried_m = carried_lengths(tree, step_m)
    radius_m = np.full(len(tree.parent), np.nan)
    if np.ndim(known_m):
        radius_m[:] = known_m
    else:
        radius_m[tree.levels[0]] = known_m
    if np.isnan(radius_m[tree.levels[0]]).any():
        raise ValueError("the radius of every root must be known")
    for level in tree.levels[1:]:
        level = level[np.isnan(radius_m[level])]
        above = tree.parent[level]
        radius_m[level] = radius_m[above] * (carried_m[level] / carried_m[above]) ** settings.exponent
    return radius_m
