"""Which sections are wood: on ways and trees that are known, and on a tree with leaves of its own."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from usdfoliage.branch.distances import sample_axes
from usdfoliage.branch.rooted_tree import RootedTree
from usdfoliage.branch.tracing.reconstruct import TracedBranches, reconstruct_branches
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.branch.tracing.wood import (
    WoodSettings,
    best_rooted_part,
    choose_wood,
    shows_leaves,
    wood_features,
    wood_odds,
)

from tests.support.branch_clouds import chain, cloud_of, leaves_on, line, small_tree, twiggy_tree

FOOT_M = np.zeros((1, 3))
NOISE_M = 0.002


def wood_cloud() -> np.ndarray:
    return cloud_of(twiggy_tree(), 10_000, 0, NOISE_M)


def leafy_cloud(per_twig: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Points of the tree with its leaves on, and which of them are wood."""
    wood_m, leaves_m = wood_cloud(), leaves_on(twiggy_tree(), per_twig)
    leaves_m += NOISE_M * np.random.default_rng(1).normal(size=leaves_m.shape)
    return np.concatenate([wood_m, leaves_m]), np.arange(len(wood_m) + len(leaves_m)) < len(wood_m)


@cache
def trace(leaves: str) -> TracedBranches:
    return reconstruct_branches(leafy_cloud()[0], FOOT_M, BranchSettings(leaves=leaves))


@given(st.integers(0, 500), st.integers(1, 9))
def test_no_part_of_a_small_tree_is_better_than_the_best(seed, count):
    rng = np.random.default_rng(seed)
    parent = np.array([-1, *(rng.integers(-1, node) for node in range(1, count))], np.int32)
    gain = rng.normal(size=count)
    kept = best_rooted_part(RootedTree(parent), gain)
    totals = []
    for number in range(2**count):
        part = (number >> np.arange(count)) % 2 == 1
        if part[parent < 0].all() and part[parent[part & (parent >= 0)]].all():
            totals.append(gain[part].sum())
    assert kept[parent < 0].all()
    assert kept[parent[kept & (parent >= 0)]].all()
    assert gain[kept].sum() == pytest.approx(max(totals))


def test_a_straight_path_looks_more_like_wood_than_a_zigzag():
    straight_m = line([0, 0, 0], [0, 2, 0], 401)
    zigzag_m = straight_m + np.where(np.arange(401) % 8 < 4, 0.03, -0.03)[:, None] * [1.0, 0, 0]
    straight, zigzag = (wood_features(points_m, chain(points_m), 0.015) for points_m in (straight_m, zigzag_m))
    inner = slice(100, 300)
    assert (straight[inner, :2] > zigzag[inner, :2] + 0.5).all()


def test_the_straightness_of_a_straight_path_follows_from_the_length_of_its_windows():
    points_m = line([0, 0, 0], [0, 2, 0], 2001)
    features = wood_features(points_m, chain(points_m), 0.01)
    # Evenly spread over a window's length, the standard deviation is that length by the root of twelve.
    for column, window_m in ((0, 0.2), (1, 0.4)):
        assert features[1000, column] == pytest.approx(np.log(1 + window_m / np.sqrt(12) / 0.001), abs=0.02)


@pytest.mark.parametrize("scale", [0.01, 1.0, 40.0])
def test_a_larger_plant_has_the_features_of_a_small_one(scale):
    points_m = np.random.default_rng(0).normal(0, 0.01, (300, 3)).cumsum(axis=0)
    features = wood_features(points_m, chain(points_m), 0.013)
    assert wood_features(scale * points_m, chain(scale * points_m), 0.013 * scale) == pytest.approx(features, abs=1e-6)


def test_a_single_section_is_wood():
    points_m = np.zeros((1, 3))
    found = choose_wood(
        chain(points_m), wood_odds(wood_features(points_m, chain(points_m), 0.01)), np.zeros(1, bool), 0.01
    )
    assert found.sections.all()
    assert found.share == 1


def test_more_caution_keeps_no_less():
    points_m = np.random.default_rng(2).normal(0, 0.01, (500, 3)).cumsum(axis=0)
    nothing = np.zeros(500, bool)
    odds = wood_odds(wood_features(points_m, chain(points_m), 0.013))
    kept = [choose_wood(chain(points_m), odds + caution, nothing, 0.013).sections for caution in (-2, 0, 2)]
    assert (kept[0] <= kept[1]).all()
    assert (kept[1] <= kept[2]).all()


def test_leaves_are_left_out_and_wood_stays():
    (points_m, is_wood), traced = leafy_cloud(), trace("auto")
    assert is_wood.mean() < 0.75
    assert traced.knows_leaves
    assert traced.wood.shape == (len(points_m),)
    assert traced.wood[is_wood].mean() > 0.95
    assert traced.wood[~is_wood].mean() < 0.4


def test_of_the_stem_nothing_is_left_out():
    points_m, is_wood = leafy_cloud()
    stem = is_wood & (np.hypot(points_m[:, 0], points_m[:, 2]) < 0.035) & (points_m[:, 1] < 1)
    assert stem.sum() > 500
    assert trace("auto").wood[stem].mean() > 0.99


def test_the_skeleton_of_a_tree_with_leaves_is_that_of_its_wood():
    true, found, blind = twiggy_tree(), trace("auto").skeleton, trace("off").skeleton
    places_m = sample_axes(true, 0.02)[0]
    away_m = cKDTree(sample_axes(found, 0.005)[0]).query(places_m)[0]
    assert np.mean(away_m < 0.03) > 0.9
    bare = reconstruct_branches(wood_cloud(), FOOT_M).skeleton
    assert found.lengths_m.sum() < 2 * true.lengths_m.sum()
    assert blind.lengths_m.sum() > 3 * bare.lengths_m.sum()


@pytest.mark.parametrize("skeleton", [small_tree(), twiggy_tree()], ids=["small", "twiggy"])
@pytest.mark.parametrize("noise_m", [0.0, NOISE_M])
def test_of_a_tree_without_leaves_nothing_is_left_out(skeleton, noise_m):
    traced = reconstruct_branches(cloud_of(skeleton, 10_000, 0, noise_m), FOOT_M)
    assert traced.knows_leaves
    assert traced.wood.all()


def test_off_takes_all_for_wood_and_on_looks_for_leaves_in_any_case():
    assert trace("off").wood.all()
    forced = reconstruct_branches(wood_cloud(), FOOT_M, BranchSettings(leaves="on"))
    assert 0.85 < forced.wood.mean() < 1


def test_points_far_apart_do_not_show_leaves():
    assert shows_leaves(0.01)
    assert not shows_leaves(0.05)
    points_m, _ = leafy_cloud()
    sparse = reconstruct_branches(points_m[::20], FOOT_M)
    assert not sparse.knows_leaves
    assert sparse.wood.all()


def test_points_that_come_twenty_times_have_one_label():
    points_m = np.repeat(leafy_cloud()[0][::3], 20, axis=0)
    traced = reconstruct_branches(points_m, FOOT_M, BranchSettings(leaves="on"))
    assert traced.wood.shape == (len(points_m),)
    assert (traced.wood.reshape(-1, 20).all(axis=1) == traced.wood.reshape(-1, 20).any(axis=1)).all()


def test_the_same_cloud_has_the_same_leaves():
    again = reconstruct_branches(leafy_cloud()[0], FOOT_M)
    np.testing.assert_array_equal(again.wood, trace("auto").wood)
    np.testing.assert_array_equal(again.skeleton.points_m, trace("auto").skeleton.points_m)


@pytest.mark.parametrize(
    "change", [{"leaf_m": 0.0}, {"leafless": 1.5}, {"settled": -0.1}, {"caution": np.nan}, {"max_turns": 0}]
)
def test_settings_that_cannot_be_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        WoodSettings(**change)


def test_the_error_of_a_wrong_leaves_setting_lists_its_values():
    with pytest.raises(ValueError, match="auto, on, off"):
        BranchSettings(leaves="perhaps")  # type: ignore[arg-type]


def test_leaves_of_a_dense_cloud_are_found_by_some_of_its_points():
    points_m, is_wood = leafy_cloud()
    some = len(points_m) * 2 // 3
    settings = BranchSettings(leaves="on", wood=WoodSettings(max_points=some, few_points=some))
    thinned = reconstruct_branches(points_m, FOOT_M, settings)
    assert len(thinned.wood) == len(points_m)
    assert thinned.wood[is_wood].mean() > 0.8
    assert thinned.wood[~is_wood].mean() < 0.5
