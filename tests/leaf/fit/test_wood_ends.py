"""Which end of a leaf is at the wood."""

import numpy as np
from usdfoliage.leaf.fit.wood_ends import find_wood_ends

from tests.support.leaves.assets import random_leaves


def beside(ends_m, leaves, count=20):
    rng = np.random.default_rng(0)
    around = rng.normal(0, 0.03, (len(leaves), count, 3)) * leaves.length_m[:, None, None]
    return (ends_m[:, None] + around).reshape(-1, 3)


def test_the_end_beside_other_points_is_the_base():
    leaves = random_leaves(12)
    apex_m = leaves.base_m + leaves.asset_from_leaf()[:, :, 1]
    right = find_wood_ends(leaves, beside(leaves.base_m, leaves))
    assert not right.flip.any()
    assert (right.certainty > 0.9).all()
    assert find_wood_ends(leaves, beside(apex_m, leaves)).flip.all()


def test_without_points_beside_either_end_nothing_is_known():
    leaves = random_leaves(5)
    ends = find_wood_ends(leaves, np.full((10, 3), 1e3))
    assert not ends.flip.any()
    np.testing.assert_allclose(ends.certainty, 0.5)
    assert find_wood_ends(leaves, np.zeros((0, 3))).certainty.tolist() == [0.5] * 5
    assert find_wood_ends(random_leaves(0), np.zeros((4, 3))).flip.shape == (0,)
