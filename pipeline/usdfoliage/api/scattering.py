"""Leaves out of nothing."""

import numpy as np

from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.spray import SpraySettings, scatter_spray


def scatter_leaves(count: int, *, seed: int = 0, settings: SpraySettings = SpraySettings()) -> Leaves:
    """Draw a spray of leaves on twigs that arch from a root at the origin, Y up, the blades turned up and towards +Z.

    The same count, seed and settings give the same leaves.

    Args:
        count: How many, 0 or more.
        seed: Of the random choices, 0 or more.
        settings: Length in metres, distances along a twig in leaf lengths, and how much leaves differ.

    Returns:
        Leaves in metres. They have no colour, confidence, residual or view of their own.

    Raises:
        ValueError: count or seed is below 0.
    """
    return scatter_spray(count, np.random.default_rng(seed), settings)
