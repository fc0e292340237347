"""Allometry: radii by what branches carry, after equation 5."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from usdfoliage.branch.allometry import AllometrySettings, carried_lengths, grow_radii
from usdfoliage.branch.rooted_tree import RootedTree

# A stem of two internodes of 1 m; arms of three and of one.
FORK = RootedTree(np.array([-1, 0, 1, 2, 3, 4, 2], np.int32))
STEPS_M = np.array([0.0, 1, 1, 1, 1, 1, 1])


def random_tree(seed: int) -> tuple[RootedTree, np.ndarray]:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 60))
    parent = np.array([-1, *(rng.integers(max(0, node - 4), node) for node in range(1, count))], np.int32)
    step_m = rng.uniform(0, 1, count) ** 3 * (rng.random(count) < 0.9)
    step_m[0] = 0
    return RootedTree(parent), step_m


def test_carried_is_all_above_and_half_an_internode():
    assert carried_lengths(FORK, STEPS_M).tolist() == [6.5, 5.5, 4.5, 2.5, 1.5, 0.5, 0.5]


@pytest.mark.parametrize("exponent", [0.3, 0.45, 1.0])
def test_at_a_fork_the_arms_have_the_thickness_of_the_equation(exponent):
    radius_m = grow_radii(FORK, STEPS_M, 0.1, AllometrySettings(exponent=exponent))
    assert radius_m[0] == 0.1
    assert radius_m[3] / radius_m[2] == pytest.approx((2.5 / 4.5) ** exponent)
    assert radius_m[6] / radius_m[2] == pytest.approx((0.5 / 4.5) ** exponent)
    assert radius_m == pytest.approx(0.1 * (carried_lengths(FORK, STEPS_M) / 6.5) ** exponent)


@given(seed=st.integers(0, 2**32 - 1), exponent=st.floats(0.01, 2))
def test_nothing_becomes_thicker_outwards(seed, exponent):
    tree, step_m = random_tree(seed)
    radius_m = grow_radii(tree, step_m, 0.1, AllometrySettings(exponent=exponent))
    carried_m = carried_lengths(tree, step_m)
    assert radius_m[0] == 0.1
    assert (radius_m[1:] <= radius_m[tree.parent[1:]]).all()
    assert (radius_m > 0).all()
    assert radius_m == pytest.approx(0.1 * (carried_m / carried_m[0]) ** exponent, rel=1e-9)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.01, 100))
def test_a_plant_twice_as_large_is_twice_as_thick(seed, scale):
    tree, step_m = random_tree(seed)
    if not step_m.any():
        return
    assert grow_radii(tree, scale * step_m, scale * 0.1) == pytest.approx(scale * grow_radii(tree, step_m, 0.1))


def test_every_root_may_have_a_radius_of_its_own():
    tree = RootedTree(np.array([-1, 0, -1, 2], np.int32))
    radius_m = grow_radii(tree, np.array([0.0, 1, 0, 1]), np.array([0.1, np.nan, 0.3, np.nan]))
    assert radius_m[[0, 2]].tolist() == [0.1, 0.3]
    assert radius_m[3] / radius_m[2] == pytest.approx(radius_m[1] / radius_m[0])


def test_nodes_at_one_place_are_as_thick_as_each_other():
    tree = RootedTree(np.array([-1, 0, 1], np.int32))
    assert grow_radii(tree, np.zeros(3), 0.1).tolist() == [0.1] * 3


@pytest.mark.parametrize("exponent", [0.0, -1.0, 2.1, np.nan])
def test_exponents_beyond_what_plants_have_are_refused(exponent):
    with pytest.raises(ValueError, match="exponent must be in"):
        AllometrySettings(exponent=exponent)
