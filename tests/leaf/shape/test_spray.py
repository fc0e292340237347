"""Random sprays: any number of leaves, each on its twig, turned to the light."""

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.leaf.shape.spray import GOLDEN_ANGLE_RAD, SpraySettings, scatter_spray
from usdfoliage.leaf.shape.variation import VariationSettings, default_leaf

FEW = settings(max_examples=20, deadline=None)


def spray(count, seed=0, settings=SpraySettings()):
    return scatter_spray(count, np.random.default_rng(seed), settings)


def arrays(leaves):
    return leaves.parameters, leaves.base_m, leaves.orientation, leaves.length_m, leaves.phase


@FEW
@given(count=st.integers(0, 3000), seed=st.integers(0, 2**32 - 1))
def test_any_number_of_leaves_is_a_spray(count, seed):
    leaves = spray(count, seed)
    assert len(leaves) == count
    assert all(array.dtype == np.float64 and np.isfinite(array).all() for array in arrays(leaves))
    np.testing.assert_allclose(np.linalg.norm(leaves.orientation, axis=-1), 1, atol=1e-12)
    assert (leaves.orientation[:, 3] >= 0).all()
    assert (leaves.length_m > 0.03).all()
    assert (leaves.length_m < 0.16).all()
    np.testing.assert_array_equal(leaves.phase, spread_phases(count))


def test_the_same_seed_gives_the_same_bytes():
    for one, other in zip(arrays(spray(700, 3)), arrays(spray(700, 3)), strict=True):
        assert one.tobytes() == other.tobytes()
    assert (spray(700, 3).base_m != spray(700, 4).base_m).any()


def test_one_leaf_stands_near_the_root():
    leaves = spray(1)
    assert np.linalg.norm(leaves.base_m) < 0.05


def test_a_few_leaves_are_one_twig_up_from_the_root():
    leaves = spray(12)
    steps = np.linalg.norm(np.diff(leaves.base_m, axis=0), axis=-1)
    np.testing.assert_allclose(steps, 0.42 * 0.08, rtol=0.05)  # the twig arches, so its chords are a little shorter
    assert (np.diff(leaves.base_m[:, 1]) > 0).all()


@pytest.mark.parametrize("count", [40, 400, 5000])
def test_a_spray_stands_on_its_root(count):
    leaves = spray(count)
    low, high = leaves.base_m.min(axis=0), leaves.base_m.max(axis=0)
    assert low[1] > 0
    assert low[0] < 0 < high[0]
    assert low[2] < 0 < high[2]
    assert high[1] > 0.8 * (high - low).max()


@pytest.mark.parametrize("count", [40, 300, 2000, 20_000])
def test_sprays_fill_a_volume_as_large_as_their_leaves_need(count):
    spread_m = np.mean([spray(count, seed).base_m.std(axis=0).mean() for seed in range(4)])
    assert spread_m == pytest.approx(0.03 * count ** (1 / 3), rel=0.25)


def test_blades_turn_to_the_light_and_towards_the_front():
    leaves = spray(2000)
    facing = leaves.asset_from_leaf()[:, :, 2] / leaves.length_m[:, None]
    assert (facing[:, 1] > 0).mean() > 0.95
    assert (facing[:, 2] > 0).mean() > 0.7
    toward_left = spray(2000, settings=SpraySettings(light=(-3.0, 1.0, 0.0)))
    assert (toward_left.asset_from_leaf()[:, 0, 2] < 0).mean() > 0.85


def test_leaves_alternate_from_side_to_side():
    leaves = spray(12, settings=SpraySettings(light=(0.0, 0.0, 1.0)))
    side = leaves.asset_from_leaf()[:-1, 0, 1]  # the last leaf ends the twig
    signs = np.sign(side - np.median(side))
    assert (signs[1:] != signs[:-1]).mean() > 0.8


def test_leaves_may_stand_on_a_spiral():
    leaves = spray(12, settings=SpraySettings(divergence_rad=GOLDEN_ANGLE_RAD))
    along = leaves.asset_from_leaf()[:-1, :, 1]
    turn = np.arctan2(along[:, 2], along[:, 0])
    steps = np.abs(np.angle(np.exp(1j * np.diff(turn))))
    assert np.median(steps) < 2.9  # less than half a turn


def test_the_spray_grows_with_its_leaves():
    small, large = spray(300), spray(300, settings=SpraySettings(length_m=0.8))
    np.testing.assert_allclose(large.base_m, 10 * small.base_m, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(large.length_m, 10 * small.length_m)
    np.testing.assert_array_equal(large.orientation, small.orientation)


def test_lengths_are_what_was_asked_for_on_average():
    leaves = spray(20_000)
    assert leaves.length_m.mean() == pytest.approx(0.08, rel=0.02)
    assert 0.1 < leaves.length_m.std() / 0.08 < 0.25


def test_leaves_may_be_all_equal():
    without_variation = replace(SpraySettings(), length_variation=0, variation=VariationSettings(amount=0))
    leaves = spray(30, settings=without_variation)
    np.testing.assert_array_equal(leaves.parameters, np.broadcast_to(default_leaf(), (30, 7, 3)))


def test_a_hundred_thousand_leaves_take_a_moment():
    start = time.process_time()
    leaves = spray(100_000)
    assert time.process_time() - start < 3  # of the processor, whoever else is at work; it takes 0.3
    assert len(np.unique(leaves.base_m, axis=0)) == 100_000


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: spray(-1), "number of leaves must be 0 or more, not -1"),
        (lambda: SpraySettings(length_m=0), "length_m must be above 0"),
        (lambda: SpraySettings(internode=float("nan")), "internode must be above 0"),
        (lambda: SpraySettings(leaves_per_twig=0), "leaves_per_twig must be above 0"),
        (lambda: SpraySettings(length_variation=-0.1), "length_variation must be 0 or more"),
        (lambda: SpraySettings(divergence_rad=float("inf")), "divergence_rad must be finite"),
        (lambda: SpraySettings(light=(0, 0, 0)), "light must be a direction"),
    ],
)
def test_what_cannot_be_is_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()
