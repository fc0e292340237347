"""Leaves to test with: plain ones with a known answer, and wild ones."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp


def flat_leaf(width=0.4, feet=(0.25, 0.5, 0.75)):
    """A flat leaf (1, 7, 3) on a straight axis whose silhouette's control points stand at `width` on either side."""
    leaf = np.zeros((1, 7, 3))
    leaf[0, 0, 1], leaf[0, 1, 1] = 1 / 3, 2 / 3
    leaf[0, 2:5, 0] = feet
    leaf[0, 2:5, 1] = width
    return leaf


def wild_leaves(count=4, reach=2.0):
    """Strategy: leaves (count, 7, 3), all numbers within reach, folded and turned over as they come."""
    return hnp.arrays(np.float64, (count, 7, 3), elements=st.floats(-reach, reach, allow_subnormal=False, width=32))


def random_leaves(count, seed=0, spread=1.0):
    return np.random.default_rng(seed).normal(size=(count, 7, 3)) * spread
