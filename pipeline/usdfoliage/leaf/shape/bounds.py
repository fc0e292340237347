"""Boxes around leaves, jittered ones too.

They contain the surface in double precision, with jitter of the given amplitude at any frequency and phase, and stand
off it by little: at most 0.1 % of the leaf's length for natural leaves and 2 % of the box for any; jitter adds what its
wave leaves unused.
"""

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.native_arguments import checked_leaves, checked_placements

GROUP = 1024  # leaves that share a box on the way to the box of all


def leaf_bounds(
    parameters: NDArray[np.floating],
    jitter: Jitter = NO_JITTER,
    *,
    placements: NDArray[np.floating] | None = None,
    threads: int = 0,
) -> NDArray[np.float64]:
    """Least and greatest x, y and z of each leaf: (N, 2, 3) from parameters (N, 7, 3).

    Args:
        placements: (N, 3, 4), for column vectors, as Leaves.asset_from_leaf gives; leaf space without.

    Raises:
        ValueError: A shape is wrong, or a number is not finite.
    """
    return _boxes(parameters, jitter, placements, 1, threads)


def common_bounds(
    parameters: NDArray[np.floating],
    jitter: Jitter = NO_JITTER,
    *,
    placements: NDArray[np.floating] | None = None,
    threads: int = 0,
) -> NDArray[np.float64]:
    """The box (2, 3) around all leaves; the origin twice for no leaves.

    It is the union of those of leaf_bounds, found sooner, with the same arguments.
    """
    boxes = _boxes(parameters, jitter, placements, GROUP, threads)
    if len(boxes) == 0:
        return np.zeros((2, 3))
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def leaf_bounds_m(leaves: Leaves, jitter: Jitter = NO_JITTER, *, threads: int = 0) -> NDArray[np.float64]:
    """The box (2, 3), in metres, around all leaves in the asset's frame; the origin twice for no leaves."""
    return common_bounds(leaves.parameters, jitter, placements=leaves.asset_from_leaf(), threads=threads)


def _boxes(
    parameters: NDArray[np.floating],
    jitter: Jitter,
    placements: NDArray[np.floating] | None,
    group: int,
    threads: int,
) -> NDArray[np.float64]:
    leaves = checked_leaves(parameters)
    matrices = checked_placements(leaves, placements)
    for name, array in (("parameters", leaves), ("placements", matrices)):
        if array is not None and not np.isfinite(array).all():
            where = int(np.argmin(np.isfinite(array).all(axis=(1, 2))))
            raise ValueError(f"{name} must be finite, those of leaf {where} are not")
    bounds = np.empty((-(-len(leaves) // group), 2, 3))
    _native.leaf_bounds(leaves, placements=matrices, reach=jitter.reach, group=group, bounds=bounds, threads=threads)
    return bounds
