"""Turning leaves end for end."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.model import Leaves


def flip_leaves(leaves: Leaves, mask: NDArray[np.bool_]) -> Leaves:
    """Turn the chosen leaves end for end: what was the apex is the base, and the surface stays where it is.

    L'(u, v) = L(-u, 1 - v) exactly, since the leaf is turned by half a turn about its z and both halves are equal. Only
    jitter is not kept: its wave runs from the base.

    Args:
        mask: (N,), True for the leaves to turn.

    Raises:
        ValueError: The mask is not (N,) bool.
    """
    chosen = np.asarray(mask)
    if chosen.shape != (len(leaves),) or chosen.dtype != np.bool_:
        raise ValueError(f"mask must be ({len(leaves)},) bool, not {chosen.shape} {chosen.dtype}")
    parameters, base_m, orientation = (
        np.array(a, np.float64) for a in (leaves.parameters, leaves.base_m, leaves.orientation)
    )
    # What leaf space's half turn about (0, 1/2, 0) does: (x, y, z) -> (-x, 1 - y, z).
    turned = parameters[chosen]
    turned[:, :2] = turned[:, 1::-1] * (-1, -1, 1) + (0, 1, 0)
    turned[:, 2:5] = turned[:, 4:1:-1]
    turned[:, 2:5, 0] = 1 - turned[:, 2:5, 0]
    turned[:, 5:] = turned[:, 5:, ::-1]
    parameters[chosen] = turned
    base_m[chosen] = leaves.asset_from_leaf()[chosen] @ (0, 1, 0, 1)
    x, y, z, w = np.moveaxis(orientation[chosen], -1, 0)
    orientation[chosen] = np.stack([y, -x, w, -z], axis=-1)  # times (0, 0, 1, 0)
    return replace(leaves, parameters=parameters, base_m=base_m, orientation=orientation)
