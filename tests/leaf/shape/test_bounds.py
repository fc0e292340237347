"""Boxes contain the leaves, and little else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.bounds import common_bounds, leaf_bounds, leaf_bounds_m
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.leaf.shape.variation import default_leaf, vary_leaves

from tests.support.leaves.shapes import flat_leaf, random_leaves, wild_leaves

PLACES = grid_places(np.linspace(-1, 1, 81), np.linspace(0, 1, 201))
JITTERS = [NO_JITTER, Jitter(amplitude=0.05, frequency=40.0), Jitter(amplitude=0.05, map=np.array([0.3, -0.8]))]


def room(leaves, jitter, phase=None, placements=None):
    """How far the surface stays off each side: (N, 6)."""
    points = evaluate_points(leaves, PLACES, jitter, phase, placements=placements)
    bounds = leaf_bounds(leaves, jitter, placements=placements)
    return np.concatenate([points.min(axis=1) - bounds[:, 0], bounds[:, 1] - points.max(axis=1)], axis=1)


@settings(max_examples=30, deadline=None)
@given(leaves=wild_leaves(), jitter=st.sampled_from(JITTERS), phase=st.floats(0, 64), seed=st.integers(0, 9))
def test_wild_leaves_lie_inside(leaves, jitter, phase, seed):
    placements = np.random.default_rng(seed).normal(size=(len(leaves), 3, 4))
    phases = np.full(len(leaves), phase)

    assert room(leaves, jitter, phases).min() >= -1e-12
    assert room(leaves, jitter, phases, placements).min() >= -1e-12


def test_little_room_is_left():
    natural, wild = vary_leaves(200, np.random.default_rng(0)), random_leaves(200)

    assert room(natural, NO_JITTER).max() < 0.001
    size = np.ptp(leaf_bounds(wild), axis=1)
    assert (room(wild, NO_JITTER) / np.tile(size, 2)).max() < 0.025


def test_jitter_adds_no_more_than_its_reach_and_nothing_along_a_straight_axis():
    leaf = default_leaf()[None]
    leaf[0, :2, 0] = 0
    plain = leaf_bounds(leaf)
    jittered = leaf_bounds(leaf, JITTERS[1])

    assert jittered[0, :, 1:] == pytest.approx(plain[0, :, 1:], abs=1e-12)
    assert jittered[0, :, 0] == pytest.approx(plain[0, :, 0] + (-0.05, 0.05), abs=1e-6)
    assert Jitter(amplitude=0.05, map=np.array([0.3, -0.8])).reach == pytest.approx(0.04)


def test_a_flat_leaf_has_its_own_box():
    bounds = leaf_bounds(flat_leaf(width=0.4))[0]

    half = 0.4 * (1 - 2 / 16)
    assert bounds[:, 0] == pytest.approx((-half, half), abs=1e-3)
    assert bounds[1, 0] >= half
    assert bounds[:, 1].tolist() == [0, 1]
    assert bounds[:, 2].tolist() == [0, 0]


def test_the_box_of_all_is_the_union():
    leaves, placements = random_leaves(3000), np.random.default_rng(1).normal(size=(3000, 3, 4))

    for jitter in JITTERS:
        each, common = (find(leaves, jitter, placements=placements) for find in (leaf_bounds, common_bounds))
        assert common == pytest.approx(np.stack([each[:, 0].min(axis=0), each[:, 1].max(axis=0)]), rel=1e-14)


def test_leaves_in_the_assets_frame():
    turned = np.array([[0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]])  # a quarter turn about z: the apex points to -x
    leaves = Leaves(
        parameters=flat_leaf(width=0.4),
        base_m=np.array([[1.0, 2.0, 3.0]]),
        orientation=turned,
        length_m=np.array([0.5]),
        phase=np.zeros(1),
    )

    assert leaf_bounds_m(leaves) == pytest.approx(np.array([[0.5, 1.825, 3.0], [1.0, 2.175, 3.0]]), abs=1e-3)


def test_any_number_of_threads_gives_the_same():
    leaves = random_leaves(2000)

    assert np.array_equal(leaf_bounds(leaves, JITTERS[1], threads=1), leaf_bounds(leaves, JITTERS[1], threads=5))
    assert np.array_equal(common_bounds(leaves, threads=1), common_bounds(leaves, threads=5))


def test_no_leaves():
    none = np.zeros((0, 7, 3))

    assert leaf_bounds(none).shape == (0, 2, 3)
    assert common_bounds(none).tolist() == [[0, 0, 0], [0, 0, 0]]


def test_what_is_refused():
    broken = np.repeat(flat_leaf(), 4, axis=0)
    broken[2, 5, 1] = np.nan

    with pytest.raises(ValueError, match="parameters must be finite, those of leaf 2 are not"):
        leaf_bounds(broken)
    with pytest.raises(ValueError, match="placements must be finite, those of leaf 0 are not"):
        common_bounds(flat_leaf(), placements=np.full((1, 3, 4), np.inf))
    with pytest.raises(ValueError, match=r"placements must be \(1, 3, 4\)"):
        leaf_bounds(flat_leaf(), placements=np.zeros((1, 4, 4)))
