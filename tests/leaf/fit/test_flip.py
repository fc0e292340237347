"""Leaves turned end for end: the same surface, named from the other end."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.fit.flip import flip_leaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.surface import evaluate_normals, evaluate_points

from tests.support.leaves.shapes import random_leaves, wild_leaves

PLACES = np.random.default_rng(3).uniform((-1, 0), (1, 1), (60, 2))
TURNED = PLACES * (-1, -1) + (0, 1)


def leaves_of(parameters, seed=0):
    rng = np.random.default_rng(seed)
    count = len(parameters)
    return Leaves(
        parameters=np.asarray(parameters, np.float64),
        base_m=rng.normal(size=(count, 3)),
        orientation=Rotation.random(count, random_state=seed).as_quat(),
        length_m=rng.uniform(0.05, 2.0, count),
        phase=np.zeros(count),
        residual_m=np.arange(count, dtype=float),
    )


def slowest_axis(parameters):
    """The least speed of the axes in the leaf's plane where the silhouettes stand on them."""
    leaves = np.asarray(parameters, np.float64)
    first, second = leaves[:, None, 0, :2], leaves[:, None, 1, :2]
    v = leaves[:, 2:5, :1]
    rest = np.array([0.0, 1.0]) - second
    tangents = 3 * (1 - v) ** 2 * first + 6 * (1 - v) * v * (second - first) + 3 * v**2 * rest
    return np.linalg.norm(tangents, axis=-1).min()


@settings(max_examples=25, deadline=None)
@given(parameters=wild_leaves(), seed=st.integers(0, 100))
def test_the_surface_stays_where_it_is(parameters, seed):
    assume(slowest_axis(parameters) > 1e-3)  # where the axis stands still rounding decides on its normal
    leaves = leaves_of(parameters, seed)

    flipped = flip_leaves(leaves, np.array([True, False, True, True]))

    before = evaluate_points(leaves.parameters, PLACES, placements=leaves.asset_from_leaf())
    after = evaluate_points(
        flipped.parameters,
        np.stack([TURNED, PLACES, TURNED, TURNED]),
        placements=flipped.asset_from_leaf(),
    )
    assert np.abs(after - before).max() <= 1e-12 * (1 + np.abs(before).max())


def test_the_same_side_faces_the_cameras():
    leaves = leaves_of(random_leaves(5, spread=0.1))

    flipped = flip_leaves(leaves, np.ones(5, bool))

    before, after = (
        evaluate_normals(each.parameters, places, placements=each.asset_from_leaf())[1]
        for each, places in ((leaves, PLACES), (flipped, TURNED))
    )
    assert after == pytest.approx(before, abs=1e-9)


def test_base_and_apex_change_places():
    leaves = leaves_of(random_leaves(3))

    flipped = flip_leaves(leaves, np.array([True, True, False]))

    apex = leaves.asset_from_leaf() @ (0, 1, 0, 1)
    assert flipped.base_m[:2] == pytest.approx(apex[:2])
    assert (flipped.asset_from_leaf() @ (0, 1, 0, 1))[:2] == pytest.approx(leaves.base_m[:2])
    assert np.array_equal(flipped.parameters[2], leaves.parameters[2])
    assert np.array_equal(flipped.residual_m, leaves.residual_m)


def test_twice_is_as_before():
    leaves, all_of_them = leaves_of(random_leaves(4)), np.ones(4, bool)

    twice = flip_leaves(flip_leaves(leaves, all_of_them), all_of_them)

    assert twice.parameters == pytest.approx(leaves.parameters, abs=1e-14)
    assert twice.base_m == pytest.approx(leaves.base_m)
    assert twice.asset_from_leaf() == pytest.approx(leaves.asset_from_leaf())


def test_a_mask_that_does_not_fit_is_refused():
    leaves = leaves_of(random_leaves(2))
    for mask in (np.ones(3, bool), np.array([0, 1])):
        with pytest.raises(ValueError, match="mask"):
            flip_leaves(leaves, mask)
