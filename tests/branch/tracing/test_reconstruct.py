"""From clouds of known branches back to these: all parts together."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree
from usdfoliage.branch.distances import distances_to_cloud, distances_to_surface, sample_axes
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.cloud_cut import point_spacing
from usdfoliage.branch.tracing.reconstruct import TracedBranches, reconstruct_branches
from usdfoliage.branch.tracing.settings import BranchSettings

from tests.support.branch_clouds import cloud_of, cone, line, small_tree, y_fork

SETTINGS = BranchSettings(internode_m=0.1)
FOOT_M = np.zeros((1, 3))
LONG_M = 0.25  # branches of the small tree are longer; what is shorter is bumps of its bark


def tree_cloud(noise_m: float = 0.0, seed: int = 0) -> np.ndarray:
    return cloud_of(small_tree(), 10_000, seed, noise_m)


@cache
def trace(noise_m: float) -> TracedBranches:
    return reconstruct_branches(tree_cloud(noise_m), FOOT_M, SETTINGS)


@pytest.fixture(params=[0.0, 0.002], ids=["exact", "2 mm of noise"])
def traced(request) -> TracedBranches:
    return trace(request.param)


def missed(true: Skeleton, found: Skeleton) -> np.ndarray:
    """(K,) distances of places on the true axes from the axes found."""
    return cKDTree(sample_axes(found, 0.005)[0]).query(sample_axes(true, 0.02)[0])[0]


def long_ones(skeleton: Skeleton, min_m: float = LONG_M) -> list[int]:
    return np.flatnonzero(skeleton.lengths_m > min_m).tolist()


def test_all_axes_of_a_tree_are_found(traced):
    away_m = missed(small_tree(), traced.skeleton)
    assert np.mean(away_m < 0.02) > 0.95
    assert away_m.max() < 0.06  # at the forks, inside of the trunk


def test_branches_have_the_order_and_the_parents_that_they_have(traced):
    skeleton, true = traced.skeleton, small_tree()
    found = long_ones(skeleton)
    assert sorted(skeleton.order[found]) == [0, 1, 1, 1, 1, 2, 2]
    assert skeleton.parent_curve[0] == -1
    tips_m = {number: skeleton.points_m[skeleton.branch(number)][-1] for number in found}
    true_of = {}
    for number, tip_m in tips_m.items():
        true_tips_m = true.points_m[true.first + true.counts - 1]
        away_m = np.linalg.norm(true_tips_m - tip_m, axis=1)
        true_of[number] = int(np.argmin(away_m))
        assert away_m.min() < 0.1
    for number in found[1:]:
        assert true_of[int(skeleton.parent_curve[number])] == true.parent_curve[true_of[number]]


def test_what_is_traced_is_about_as_long_as_the_tree(traced):
    skeleton = traced.skeleton
    long_m = skeleton.lengths_m[long_ones(skeleton)].sum()
    assert long_m == pytest.approx(small_tree().lengths_m.sum(), rel=0.05)
    assert skeleton.lengths_m.sum() < 1.2 * small_tree().lengths_m.sum()
    assert skeleton.lengths_m[0] == pytest.approx(4, rel=0.05)


def test_the_trunk_is_as_thick_as_it_is(traced):
    skeleton = traced.skeleton
    trunk = skeleton.branch(0)
    height_m = skeleton.points_m[trunk, 1]
    inner = (height_m > 0.1) & (height_m < 3)
    ratio = skeleton.radius_m[trunk][inner] / (0.06 - 0.01 * height_m[inner])
    assert np.median(ratio) == pytest.approx(1, abs=0.05)
    assert np.abs(ratio - 1).max() < 0.12


def test_surface_and_cloud_are_near_each_other(traced):
    cloud_m = tree_cloud()
    assert np.median(distances_to_surface(cloud_m, traced.skeleton, 0.02)) < 0.006
    assert np.median(distances_to_cloud(traced.skeleton, cloud_m, 0.02)) < 0.01


def test_radii_never_grow_along_a_branch_nor_beyond_the_parent(traced):
    skeleton = traced.skeleton
    for number in range(len(skeleton)):
        assert (np.diff(skeleton.radius_m[skeleton.branch(number)]) <= 1e-12).all()
    child = skeleton.parent_curve >= 0
    assert (skeleton.radius_m[skeleton.first[child]] <= skeleton.radius_m[skeleton.parent_vertex[child]]).all()


def test_the_graph_of_a_whole_cloud_is_one_piece(traced):
    assert traced.pieces == 1
    assert traced.internode_m == 0.1
    assert traced.spacing_m == pytest.approx(np.sqrt(6 / (np.pi * 10_000)), rel=0.1)
    assert len(traced.radii.radius_m) == len(traced.radii.believed)


def test_at_a_fork_the_thick_arm_goes_on_and_the_thin_one_springs():
    traced = reconstruct_branches(cloud_of(y_fork(), 8000), FOOT_M, SETTINGS)
    skeleton = traced.skeleton
    first, second = long_ones(skeleton)
    assert np.linalg.norm(skeleton.points_m[skeleton.branch(first)][-1] - [0.6, 2.04, 0]) < 0.08
    assert np.linalg.norm(skeleton.points_m[skeleton.branch(second)][-1] - [-0.35, 1.35, 0]) < 0.05
    assert skeleton.parent_curve[second] == first
    springs_m = skeleton.points_m[skeleton.parent_vertex[second]]
    assert np.linalg.norm(springs_m - [0, 1, 0]) < 0.12


def test_the_same_cloud_gives_the_same_skeleton():
    first, second = trace(0.002).skeleton, reconstruct_branches(tree_cloud(0.002), FOOT_M, SETTINGS).skeleton
    for name in Skeleton.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_a_tree_far_away_is_the_same_tree():
    path_m = np.array([-1000, 1000, 1000])
    far = reconstruct_branches(tree_cloud() + path_m, FOOT_M + path_m, SETTINGS).skeleton
    assert_same_tree(trace(0.0).skeleton, far, path_m)


def assert_same_tree(one: Skeleton, other: Skeleton, path_m=(0, 0, 0)) -> None:
    """The long branches are the same; the bumps of the bark need not be, as digits and order decide of them."""
    assert other.lengths_m.sum() == pytest.approx(one.lengths_m.sum(), rel=0.1)
    assert sorted(one.order[long_ones(one)]) == sorted(other.order[long_ones(other)])
    places_m, radii_m, _ = sample_axes(one, 0.02)
    others_m, other_radii_m, _ = sample_axes(other, 0.005)
    away_m, found = cKDTree(others_m - path_m).query(places_m)
    assert np.quantile(away_m, 0.9) < 0.02
    assert np.median(np.abs(other_radii_m[found] / radii_m - 1)) < 0.05


@pytest.mark.parametrize("seed", [1, 2])
def test_the_order_of_the_points_does_not_matter(seed):
    shuffled_m = np.random.default_rng(seed).permutation(tree_cloud(0.002))
    assert_same_tree(trace(0.002).skeleton, reconstruct_branches(shuffled_m, FOOT_M, SETTINGS).skeleton)


def test_points_that_come_twice_lose_no_branch():
    skeleton = reconstruct_branches(np.repeat(tree_cloud(0.002), 2, axis=0), FOOT_M, SETTINGS).skeleton
    assert np.mean(missed(small_tree(), skeleton) < 0.05) > 0.95
    assert skeleton.parent_curve.tolist().count(-1) == 1


def test_points_that_come_twenty_times_are_no_cloud_without_spacing():
    points_m = np.repeat(tree_cloud()[::10], 20, axis=0)
    traced = reconstruct_branches(points_m, FOOT_M, SETTINGS)
    assert traced.spacing_m > 0.01
    assert np.mean(missed(small_tree(), traced.skeleton) < 0.06) > 0.9


def test_two_stems_are_two_trees():
    other_m = [1.5, 0, 0]
    clouds = [cloud_of(small_tree(), 5000, seed) for seed in (0, 500)]
    points_m = np.concatenate([clouds[0], clouds[1][:, [2, 1, 0]] + other_m])
    skeleton = reconstruct_branches(points_m, np.array([[0, 0, 0], other_m]), SETTINGS).skeleton
    trunks = np.flatnonzero(skeleton.parent_curve < 0)
    assert len(trunks) == 2
    assert np.allclose(skeleton.points_m[skeleton.first[trunks]][:, [0, 2]], [[0, 0], [1.5, 0]], atol=0.05)
    for trunk in trunks:
        assert skeleton.lengths_m[trunk] == pytest.approx(4, rel=0.05)


def test_a_foot_of_few_points_does_not_take_those_of_another_tree():
    stem_m = cone([0, 0, 0], [0, 2, 0], 0.05, 80)
    roots_m = np.array([[0, 0, 0], [30, 0, 0]])
    skeleton = reconstruct_branches(np.concatenate([stem_m, stem_m + roots_m[1]]), roots_m, SETTINGS).skeleton
    edges_m = np.linalg.norm(np.diff(skeleton.points_m, axis=0), axis=1)[np.diff(skeleton.curve) == 0]
    assert edges_m.max() < 2.1  # and not 30
    first_m = skeleton.points_m[skeleton.first[skeleton.parent_curve < 0], 0]
    assert np.sort(first_m) == pytest.approx([0, 30], abs=0.1)


def test_a_gap_is_bridged():
    points_m = tree_cloud()
    points_m = points_m[(points_m[:, 1] < 1) | (points_m[:, 1] > 1.1)]
    traced = reconstruct_branches(points_m, FOOT_M, SETTINGS)
    assert traced.pieces == 2
    assert np.mean(missed(small_tree(), traced.skeleton) < 0.03) > 0.95
    assert traced.skeleton.lengths_m[0] == pytest.approx(4, rel=0.05)


def test_a_trunk_goes_on_across_a_gap_though_a_limb_leads_round_it():
    stem_m = np.concatenate([cone([0, 0, 0], [0, 2, 0], 0.1, 2500), cone([0, 2.5, 0], [0, 5, 0], 0.1, 3100, 1)])
    path_m = [[0, 1.9, 0], [1.5, 1.9, 0], [1.5, 2.6, 0], [0, 2.6, 0]]  # close together all the way
    limb_m = np.concatenate([cone(one, other, 0.02, 400, 2) for one, other in pairwise(path_m)])
    skeleton = reconstruct_branches(np.concatenate([stem_m, limb_m]), FOOT_M, SETTINGS).skeleton
    trunk_m = skeleton.points_m[skeleton.branch(0)]
    assert np.linalg.norm(trunk_m[:, [0, 2]], axis=1).max() < 0.1
    assert trunk_m[-1, 1] == pytest.approx(5, abs=0.1)


def test_a_stem_that_was_cut_aslant_ends_straight():
    stem_m = cone([0, 0, 0], [0, 4, 0], 0.2, 12_000)
    stem_m = stem_m[stem_m[:, 1] < 3.8 + stem_m[:, 0]]  # 3.6 to 4 high
    skeleton = reconstruct_branches(stem_m, FOOT_M, SETTINGS).skeleton
    assert np.linalg.norm(skeleton.points_m[skeleton.branch(0)][:, [0, 2]], axis=1).max() < 0.05
    assert skeleton.points_m[:, 1].max() == pytest.approx(3.9, abs=0.15)
    np.testing.assert_allclose(skeleton.radius_m[skeleton.branch(0)], 0.2, rtol=0.05)


def test_of_60_points_something_is_traced():
    points_m = np.random.default_rng(0).permutation(tree_cloud())[:60]
    skeleton = reconstruct_branches(points_m, FOOT_M).skeleton
    assert len(skeleton)
    away_m = cKDTree(points_m).query(skeleton.points_m)[0]
    assert away_m.max() < 0.5


@pytest.mark.parametrize(("count", "within"), [(60, 0.35), (300, 0.1)])
def test_a_line_of_points_is_one_branch(count, within):
    skeleton = reconstruct_branches(line([0, 0, 0], [0, 1, 0], count), FOOT_M).skeleton
    assert len(skeleton) == 1
    assert 1 - within < skeleton.lengths_m[0] <= 1
    assert np.abs(skeleton.points_m[:, [0, 2]]).max() < 1e-9


@pytest.mark.parametrize(("count", "roots"), [(2, 1), (3, 1), (5, 5), (5, 9)])
def test_where_all_points_are_at_a_foot_there_is_no_branch(count, roots):
    points_m = line([0, 0, 0], [0, 1, 0], count)
    assert not len(reconstruct_branches(points_m, line([0, 0, 0], [0, 1, 0], roots)).skeleton)


def test_a_bare_stem_has_its_radius():
    points_m = cone([0, 0, 0], [0, 4, 0], (0.1, 0.06), 12_000, 3, 0.002)
    skeleton = reconstruct_branches(points_m, FOOT_M, SETTINGS).skeleton
    height_m = skeleton.points_m[skeleton.branch(0), 1]
    ratio = (skeleton.radius_m[skeleton.branch(0)] / (0.1 - 0.01 * height_m))[(height_m > 0.2) & (height_m < 3)]
    assert np.median(ratio) == pytest.approx(1, abs=0.07)
    assert len(long_ones(skeleton, 0.3)) == 1


def test_progress_is_reported():
    calls = []
    reconstruct_branches(
        line([0, 0, 0], [0, 1, 0], 20), FOOT_M, progress=lambda name, share: calls.append((name, share))
    )
    assert [share for _, share in calls] == sorted(share for _, share in calls)
    assert calls[-1] == ("branches", 1.0)


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_points_are_refused(count):
    with pytest.raises(ValueError, match=f"two points, not {count}"):
        reconstruct_branches(np.zeros((count, 3)), FOOT_M)


def test_points_at_one_place_are_refused():
    with pytest.raises(ValueError, match="at one place"):
        reconstruct_branches(np.ones((50, 3)), FOOT_M)


def test_a_plant_without_root_is_refused():
    with pytest.raises(ValueError, match="has a root"):
        reconstruct_branches(tree_cloud(), np.zeros((0, 3)))


@pytest.mark.parametrize(
    "change",
    [
        {"internode_m": 0.0},
        {"internode_m": np.inf},
        {"path_power": 0.5},
        {"search_power": 0.5},
        {"sparse_power": 0.5},
        {"fine": 0.0},
    ],
)
def test_settings_that_trace_nothing_are_refused(change):
    with pytest.raises(ValueError, match="must be"):
        BranchSettings(**change)


def test_spacing_is_the_distance_to_the_sixth_neighbor():
    assert point_spacing(line([0, 0, 0], [0, 99, 0], 100)) == pytest.approx(3)
    assert point_spacing(line([0, 0, 0], [0, 1, 0], 2)) == pytest.approx(1)
