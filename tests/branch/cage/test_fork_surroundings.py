"""Cages at forks: one closed surface whatever leaves where."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.branch.cage.build import build_branch_cage, check_cage
from usdfoliage.branch.cage.drop_reason import DropReason

from tests.support.branch_shapes import fork, limit, off_axis, plant_of, random_tree

TRUNK = np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0]], float)


def leaving(angle_deg, azimuth_deg=0.0, start=(0, 1, 0), length_m=1.0):
    """A straight branch that leaves at an angle from the trunk."""
    angle, azimuth = np.radians([angle_deg, azimuth_deg])
    direction = [np.sin(angle) * np.cos(azimuth), np.cos(angle), np.sin(angle) * np.sin(azimuth)]
    return np.array([start, start + length_m * np.array(direction)])


def assert_whole(plant, cage, dropped=0, loose=0):
    """Closed, joined, not crossing, and every branch there or named."""
    check = check_cage(cage)
    assert check.clean, check
    assert check.components == (plant.parent_curve < 0).sum() + loose
    assert len(cage.loose) == loose, cage.loose
    assert len(cage.dropped) == dropped, cage.dropped
    assert set(cage.curve.tolist()) == set(range(len(plant))) - {lost.curve for lost in cage.dropped}
    np.testing.assert_array_equal(cage.order, plant.order[cage.curve])
    assert set(cage.fork_curve.tolist()) <= set(cage.curve.tolist())


@pytest.mark.parametrize("child_m", [0.002, 0.01, 0.03, 0.045, 0.05, 0.08])
@pytest.mark.parametrize("angle_deg", [20, 30, 45, 60, 90, 120, 150])
def test_a_fork_at_any_angle(angle_deg, child_m):
    plant = fork(angle_deg, 0.05, child_m)
    assert_whole(plant, build_branch_cage(plant))


@pytest.mark.parametrize("angle_deg", [30, 60, 90, 120])
@pytest.mark.parametrize("child_m", [0.01, 0.03])
def test_away_from_a_fork_both_are_met_to_a_percent(angle_deg, child_m):
    plant = fork(angle_deg, 0.05, child_m)
    cage = build_branch_cage(plant)
    points, quads = limit(cage, 2)
    on = np.repeat(cage.curve, 16)
    axes = [plant.points_m[plant.branch(branch)] for branch in (0, 1)]
    for branch, other in ((0, 1), (1, 0)):
        own = points[quads[on == branch, 0]]
        radius = plant.radius_m[plant.branch(branch)]
        apart, along = off_axis(own, axes[branch], radius)
        far = off_axis(own, axes[other], np.full(len(axes[other]), 0.1))[0] > 1.0 + radius[0] / 0.1
        far &= (along > 2 * radius[0]) & (along < plant.lengths_m[branch] - 6 * radius[0])
        if branch == 1:
            far &= along * np.sin(np.radians(angle_deg)) > 0.1 + radius[0]
        assert far.any()
        assert np.abs(apart[far] - 1).max() < 0.01


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6])
@pytest.mark.parametrize("thickness", [0.2, 0.5, 0.9])
def test_a_whorl(count, thickness):
    turns = np.arange(count) * 360 / count
    plant = plant_of((TRUNK, 0.05, None, 0), *[(leaving(70, turn), 0.05 * thickness, 0, 1) for turn in turns])
    assert_whole(plant, build_branch_cage(plant))


def test_opposite_branches_share_their_rings():
    plant = plant_of((TRUNK, 0.05, None, 0), *[(leaving(60, turn), 0.02, 0, 1) for turn in (0, 180)])
    cage = build_branch_cage(plant)
    assert_whole(plant, cage)
    # Both leave at the same height.
    heights = [cage.points_m[np.unique(cage.faces[cage.curve == branch])][:, 1].min() for branch in (1, 2)]
    assert heights[0] == pytest.approx(heights[1], abs=0.01)


def test_branches_of_one_direction_leave_one_after_the_other():
    plant = plant_of((TRUNK, 0.05, None, 0), *[(leaving(angle, 0), 0.02, 0, 1) for angle in (40, 80, 120)])
    assert_whole(plant, build_branch_cage(plant))


@pytest.mark.parametrize("angles", [(10,), (30, -30), (40, -40, 90), (80, -80), (100,)])
def test_a_fork_at_the_tip(angles):
    tip = [(leaving(angle, 0, (0, 2, 0)), 0.04, 0, 2) for angle in angles]
    plant = plant_of((TRUNK, 0.05, None, 0), *tip)
    assert_whole(plant, build_branch_cage(plant))


@pytest.mark.parametrize("angle_deg", [45, 90])
def test_a_branch_at_the_foot(angle_deg):
    plant = plant_of((TRUNK, 0.05, None, 0), (leaving(angle_deg, 0, (0, 0, 0)), 0.02, 0, 0))
    assert_whole(plant, build_branch_cage(plant))


def test_a_branch_at_the_first_point_of_another_leaves_the_same_parent():
    others = [(leaving(60, 120), 0.015, 1, 0), (leaving(90, 240), 0.01, 2, 0)]
    plant = plant_of((TRUNK, 0.05, None, 0), (leaving(60), 0.02, 0, 1), *others)
    assert_whole(plant, build_branch_cage(plant))


def test_a_branch_inside_its_parent_is_named_and_what_it_carries_stays():
    stub = np.array([[0, 1, 0], [0.02, 1, 0]])
    plant = plant_of((TRUNK, 0.05, None, 0), (stub, 0.01, 0, 1), (leaving(80, 180, (0.02, 1, 0)), 0.008, 1, 1))
    cage = build_branch_cage(plant)
    assert_whole(plant, cage, dropped=1)
    assert (cage.dropped[0].curve, cage.dropped[0].reason) == (1, DropReason.TOO_SHORT)


def test_repeated_points_do_no_harm():
    trunk = np.repeat(TRUNK, 3, axis=0)
    branch = np.repeat(leaving(60), 2, axis=0)
    plant = plant_of((trunk, 0.05, None, 0), (branch, 0.02, 0, 4))
    assert_whole(plant, build_branch_cage(plant))


def test_branches_without_length_are_named():
    point = np.array([[0, 1, 0], [0, 1, 0]], float)
    plant = plant_of((TRUNK, 0.05, None, 0), (point, 0.02, 0, 1), (leaving(60), 0.02, 1, 1))
    cage = build_branch_cage(plant)
    assert_whole(plant, cage, dropped=1)
    assert cage.dropped[0].reason == DropReason.NO_LENGTH
    alone = build_branch_cage(plant_of((point, 0.02, None, 0)))
    assert len(alone.faces) == 0
    assert len(alone.dropped) == 1


def test_a_parent_too_short_for_its_branches_names_them():
    trunk = np.array([[0, 0, 0], [0, 0.06, 0]])
    sides = [(leaving(90, turn, (0, 0.06, 0)), 0.03, 0, 1) for turn in range(0, 360, 40)]
    plant = plant_of((trunk, 0.05, None, 0), *sides)
    cage = build_branch_cage(plant)
    assert check_cage(cage).clean
    assert set(cage.curve.tolist()) | {lost.curve for lost in cage.dropped} == set(range(len(plant)))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), wild=st.booleans())
def test_any_tree_gives_one_closed_surface(seed, wild):
    plant = random_tree(seed, wild=wild)
    cage = build_branch_cage(plant)
    assert np.isfinite(cage.points_m).all()
    assert np.isfinite(cage.st_m).all()
    assert_whole(plant, cage, dropped=len(cage.dropped), loose=len(cage.loose))
    if not wild:
        assert len(cage.dropped) <= 1 + len(plant) // 3


def test_few_branches_of_typical_trees_are_dropped():
    trees = [random_tree(seed) for seed in range(30)]
    dropped = sum(len(build_branch_cage(tree).dropped) for tree in trees)
    assert dropped <= 0.03 * sum(len(tree) for tree in trees)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000))
def test_a_cage_moves_with_its_tree(seed):
    plant = random_tree(seed, max_branches=6)
    moved = type(plant)(
        points_m=plant.points_m + np.array([4.0, -2.0, 8.0]),
        radius_m=plant.radius_m,
        counts=plant.counts,
        parent_curve=plant.parent_curve,
        parent_vertex=plant.parent_vertex,
        order=plant.order,
    )
    one, two = build_branch_cage(plant), build_branch_cage(moved)
    assert len(one.faces) == len(two.faces)
    np.testing.assert_allclose(two.points_m - [4.0, -2.0, 8.0], one.points_m, atol=1e-6)
