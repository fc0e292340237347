"""The points of a leaf's silhouette in order along its axis."""

from dataclasses import replace

import numpy as np

from usdfoliage.leaf.model import Leaves

MIN_STEP = 1e-3  # of the axis, from one silhouette point's foot to the next
MAX_MOVED = 0.1  # of the axis, of a foot that is put in order; the silhouette moves by less than half of it


def order_silhouettes(leaves: Leaves) -> Leaves:
    """Leaves whose silhouettes' points stand in order along the axis, base to apex, where that moves them little.

    A round base fits best with its first point a little behind it, which no asset takes and no edit expects. Leaves
    that would change visibly stay as they are.
    """
    feet = leaves.parameters[:, 2:5, 0]
    ordered = feet.copy()
    for point in range(3):
        lowest = (ordered[:, point - 1] if point else 0.0) + MIN_STEP
        ordered[:, point] = np.clip(feet[:, point], lowest, 1 - (3 - point) * MIN_STEP)
    near = (np.abs(ordered - feet) <= MAX_MOVED).all(axis=1)  # not of numbers that are none
    parameters = leaves.parameters.copy()
    parameters[near, 2:5, 0] = ordered[near]
    return replace(leaves, parameters=parameters)
