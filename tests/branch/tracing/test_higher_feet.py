"""Stems up a slope: each is a root, and nothing that hangs from a crown is."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.branch.tracing.ground import find_ground
from usdfoliage.branch.tracing.higher_feet import HigherFootSettings, find_higher_feet, stands_on_stem
from usdfoliage.branch.tracing.roots import RootSettings, find_roots

from tests.support.branch_clouds import cloud_of, cone, ground, line, small_tree

TREE = cloud_of(small_tree(), 6000, noise_m=0.002)
ORIGIN_M = np.zeros((1, 3))


def up_the_slope(*feet_m) -> np.ndarray:
    """The same tree at the origin and at feet up a slope."""
    return np.concatenate([TREE, *(TREE + foot_m for foot_m in feet_m)])


def away_m(found_m: np.ndarray, true_m) -> np.ndarray:
    """Of each true root from the nearest one that was found."""
    return np.linalg.norm(found_m[:, None] - np.asarray(true_m), axis=2).min(axis=0)


@examples(max_examples=20, deadline=None)
@given(turn=st.floats(0, 2 * np.pi), far_m=st.floats(2.5, 6), slope=st.floats(0.15, 0.55), count_given=st.booleans())
def test_a_tree_up_a_slope_is_a_root_with_and_without_a_given_number(turn, far_m, slope, count_given):
    foot_m = far_m * np.array([np.cos(turn), slope, np.sin(turn)])
    roots_m = find_roots(up_the_slope(foot_m), RootSettings(count=2 if count_given else None))
    assert len(roots_m) == 2
    assert away_m(roots_m, [[0, 0, 0], foot_m]).max() < 0.05


def test_each_of_a_row_of_trees_up_a_slope_is_a_root():
    feet_m = [[3.0, 1.5, 0.4], [6.0, 3.0, -0.3], [9.0, 4.5, 0.1]]
    roots_m = find_roots(up_the_slope(*feet_m))
    assert len(roots_m) == 4
    assert away_m(roots_m, [[0, 0, 0], *feet_m]).max() < 0.05


def test_no_more_than_the_given_number_are_found_on_a_slope():
    assert len(find_roots(up_the_slope([3.0, 1.5, 0]), RootSettings(count=1))) == 1


def test_a_stem_seen_from_one_side_alone_is_one():
    seen = TREE[TREE[:, 2] > -0.01] + [4.0, 1.6, 0]
    assert len(find_roots(np.concatenate([TREE, seen]))) == 2


@pytest.mark.parametrize("count", [None, 1])
def test_twigs_that_hang_are_no_roots(count):
    rng = np.random.default_rng(3)
    hanging = []
    for turn in rng.uniform(0, 2 * np.pi, 40):
        out = np.array([np.cos(turn), 0, np.sin(turn)])
        far_m, tip_m = rng.uniform(1, 2.5), rng.uniform(0.4, 1.2)
        hanging.append(line(far_m * out + [0, 3, 0], far_m * out + [0, tip_m, 0], 150))
        hanging.append(
            cone(far_m * out + [0, 3, 0], 1.05 * far_m * out + [0, tip_m, 0], (0.05, 0.004), 800, noise_m=0.001)
        )
    roots_m = find_roots(np.concatenate([TREE, *hanging]), RootSettings(count=count))
    assert roots_m == pytest.approx(ORIGIN_M, abs=0.03)


def test_a_limb_of_which_the_lower_part_is_hidden_is_no_root():
    limb = cone([0.6, 0.7, 0], [0.7, 3, 0], 0.04, 6000)  # steeper above the foot than any ground
    assert find_roots(np.concatenate([TREE, limb])) == pytest.approx(ORIGIN_M, abs=0.03)


@pytest.mark.parametrize("shape", ["leaves", "leaning"])
def test_what_is_not_round_and_upright_is_no_foot(shape):
    rng = np.random.default_rng(1)
    hung = {
        "leaves": rng.uniform([2.85, 1, -0.15], [3.15, 2, 0.15], (3000, 3)),
        "leaning": cone([3.0, 1.0, 0], [5, 2.0, 0], 0.05, 6000),
    }[shape]
    assert not find_higher_feet(np.concatenate([TREE, hung]), 0.03, ORIGIN_M).any()


def test_where_the_ground_is_known_height_above_it_counts():
    # Stems too ragged to be found by themselves, each beginning on a slope.
    rng = np.random.default_rng(2)
    bush = np.concatenate([cone([0, 0, 0], [x, 1.2, z], (0.03, 0.01), 1500, 4) for x, z in ((0.5, 0.1), (-0.4, 0.3))])
    feet_m = np.array([[-1.5, -0.6, 0], [1.5, 0.6, 0]])
    plants = np.concatenate([bush + foot_m + rng.normal(0, 0.01, bush.shape) for foot_m in feet_m])
    found = find_ground(np.concatenate([plants, ground(6, slope=(0.4, 0))]))
    plants = plants[~found.points[: len(plants)]]
    assert len(find_roots(plants)) == 1
    roots_m = find_roots(plants, ground=found.plane)
    assert len(roots_m) == 2
    assert away_m(roots_m, feet_m).max() < 0.12


@pytest.mark.parametrize("points_m", [np.ones((1, 3)), np.ones((40, 3)), np.eye(3)])
def test_a_cloud_of_nearly_nothing_has_no_higher_feet(points_m):
    assert not find_higher_feet(points_m, 0.1, points_m[:1]).any()


@pytest.mark.parametrize("change", [{"foot": 0.0}, {"highest": 1.5}, {"radius": (0.1, 0.1)}])
def test_settings_that_find_nothing_are_refused(change):
    with pytest.raises(ValueError, match="must be shares of the height"):
        HigherFootSettings(**change)


def test_a_tree_stands_on_a_stem_and_a_hedge_does_not():
    assert stands_on_stem(TREE, ORIGIN_M[0])
    assert stands_on_stem(up_the_slope([3.0, 1.5, 0]), np.array([3.0, 1.5, 0]))
    assert not stands_on_stem(TREE, np.array([0.5, 0, 0]))
    hedge = np.random.default_rng(1).uniform([-1, 0, -0.3], [1, 1.5, 0.3], (20_000, 3))
    for root_m in find_roots(hedge):
        assert not stands_on_stem(hedge, root_m)
    assert not stands_on_stem(np.ones((60, 3)), np.ones(3))
