"""Stages of a growth, where they are known."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.axis_places import places_at
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.motion.growth_stages import (
    carry_surface,
    grow_skeleton,
    grow_surface,
    plan_stages,
)
from usdfoliage.branch.motion.growth_times import GrowthStageSettings, LogisticFront

from tests.support.branch_clouds import small_tree
from tests.support.branch_shapes import fork, plant_of, random_tree


def stem(count=41, radius_m=0.05):
    """A straight one of 2 m."""
    return plant_of((np.linspace(0, 2, count)[:, None] * [0, 1, 0], radius_m, None, 0))


def front_of(stages, stage):
    """How long a single stem is."""
    return float(stages.times.reach(stages.at[stage])[0])


def test_lengths_are_logistic_from_the_first_to_all():
    front = LogisticFront(longest_m=200, start_m=2)
    times = np.linspace(0, 1, 50)
    lengths = front.length(times)
    assert lengths[[0, -1]] == pytest.approx([2, 200])
    assert (np.diff(lengths) > 0).all()
    # Equation 6 up to the share that is missing when it stops: its logit is a line in time.
    grown = 2 + (lengths - 2) * (0.95 * 200 - 2) / (200 - 2)
    logit = np.log(grown / (200 - grown))
    assert np.diff(logit) == pytest.approx(np.full(49, np.diff(logit)[0]))
    assert front.when(lengths) == pytest.approx(times)
    assert front.when(np.array([0.0, 1.0])) == pytest.approx([0, 0])


def test_a_front_begins_with_some_length():
    with pytest.raises(ValueError, match="start_m"):
        LogisticFront(longest_m=1, start_m=1)


def test_a_plant_of_few_internodes_grows_too():
    stages = plan_stages(stem(), 2.0, 5)  # one internode in all
    assert front_of(stages, 0) == pytest.approx(1)
    assert front_of(stages, 4) == pytest.approx(2)


def test_a_stem_rises_to_its_front():
    stages = plan_stages(stem(), 0.05, 21)
    for stage in range(len(stages)):
        points_m, _ = grow_skeleton(stages, stage)
        assert points_m[:, 1] == pytest.approx(np.minimum(np.linspace(0, 2, 41), front_of(stages, stage)))
    assert front_of(stages, 0) == pytest.approx(0.1)  # two internodes
    assert front_of(stages, 16) < 2 == pytest.approx(front_of(stages, 17))  # 0.15 of the time is left to thicken


def test_a_stem_is_as_thick_as_what_it_carries_asks_for():
    stages = plan_stages(stem(), 0.05, 12, GrowthStageSettings(allometry=AllometrySettings(exponent=0.5)))
    front_m = front_of(stages, 6)
    _, radius_m = grow_skeleton(stages, 6)
    assert 0.5 < front_m < 1.9
    foot = (front_m + 0.025) / (2 + 0.025)  # half an internode stands for the tip
    assert radius_m[0] == pytest.approx(0.05 * np.sqrt(foot))
    node = 4  # at 0.2 m, far below the tip
    assert radius_m[node] == pytest.approx(0.05 * np.sqrt((front_m - 0.2 + 0.025) / (1.8 + 0.025)))
    assert (radius_m[np.linspace(0, 2, 41) > front_m] < 1e-5).all()
    assert (radius_m > 0).all()


def test_a_place_thickens_from_nothing():
    stages = plan_stages(stem(), 0.05, 201, GrowthStageSettings(thicken_share=0.1))
    node = 20  # at 1 m
    radius_m = np.array([grow_skeleton(stages, stage)[1][node] for stage in range(201)])
    thickness = np.array([stages.thickness(stage)[node] for stage in range(201)])
    born = float(stages.times.born(np.zeros(1, int), np.array([1.0]))[0])
    expected = np.clip((stages.at - born) / 0.1, 1e-4, 1)
    assert radius_m == pytest.approx(0.05 * thickness * expected)
    assert np.diff(radius_m).max() < 0.1 * 0.05


def test_what_has_not_begun_lies_on_the_tip_of_its_parent():
    stages = plan_stages(small_tree(), 0.05, 20)
    plant = stages.skeleton
    reach_m = np.array([front_of(stages, stage) for stage in range(20)])
    stage = int(np.flatnonzero(reach_m < 1.5)[-1])  # the first branch leaves at 1.5 m
    points_m, radius_m = grow_skeleton(stages, stage)
    assert points_m[plant.curve > 0] == pytest.approx(
        np.tile([0, reach_m[stage], 0], (int((plant.curve > 0).sum()), 1))
    )
    assert (radius_m[plant.curve > 0] < 1e-5).all()


def grown_lengths(stages):
    """(T, B) lengths of branches."""
    plant = stages.skeleton
    lengths = []
    for stage in range(len(stages)):
        steps_m = np.linalg.norm(np.diff(grow_skeleton(stages, stage)[0], axis=0, prepend=0), axis=1)
        steps_m[plant.first] = 0
        lengths.append(np.bincount(plant.curve, steps_m))
    return np.array(lengths)


@pytest.mark.parametrize("plant", [small_tree(), *(random_tree(seed) for seed in (1, 4, 7))])
def test_no_branch_is_there_at_once(plant):
    frames, share = 100, 0.08
    stages = plan_stages(plant, 0.01 * float(np.ptp(plant.points_m, axis=0).max()), frames + 1)
    lengths_m = grown_lengths(stages)
    child = plant.parent_curve >= 0
    gained = np.diff(lengths_m, axis=0) / plant.lengths_m
    # A branch has the pace of the logistic growth along it, which is steepest where that is.
    assert gained[:, child].max() < 3 / (share * frames)
    begun = (lengths_m > 1e-6 * plant.lengths_m).argmax(axis=0)
    assert (lengths_m[begun, np.arange(len(plant))] / plant.lengths_m)[child].max() < 3 / (share * frames)
    takes = (np.diff(lengths_m, axis=0) > 1e-9).sum(axis=0)
    assert takes[child].min() >= share * frames - 1


def test_a_short_branch_takes_longer_than_the_front_that_passes_it():
    trunk = (np.linspace([0, 0, 0], [0, 10, 0], 101), 0.1, None, -1)
    twig = (np.linspace([0, 5, 0], [0.1, 5, 0], 3), 0.01, 0, 50)
    stages = plan_stages(plant_of(trunk, twig), 0.05, 201)
    lengths_m = grown_lengths(stages)[:, 1]
    assert np.flatnonzero(lengths_m > 0.0999)[0] - np.flatnonzero(lengths_m < 1e-4)[-1] == pytest.approx(16, abs=1)


def test_branches_upon_branches_are_there_before_the_end():
    parts = [(np.linspace([0, 0, 0], [0, 1, 0], 11), 0.05, None, -1)]
    tip_m = np.array([0.0, 1, 0])
    for number in range(20):  # each from the tip of the last one, short
        points_m = np.linspace(tip_m, tip_m + np.array([0.01, 0, 0]), 3)
        parts.append((points_m, 0.01, number, 10 if number == 0 else 2))
        tip_m = points_m[-1]
    stages = plan_stages(plant_of(*parts), 0.01, 101)
    lengths_m = grown_lengths(stages)
    assert lengths_m[85] == pytest.approx(stages.skeleton.lengths_m)
    assert lengths_m[50, 0] > 0.5  # they leave the front the larger part of the time
    assert (np.diff(lengths_m, axis=0)[:, 1:].max(axis=0) < 0.01).all()


def test_between_two_frames_a_branch_stays_on_its_parent():
    plant = small_tree()
    stages = plan_stages(plant, 0.05, 24)
    child = np.flatnonzero(plant.parent_curve >= 0)
    frames = [grow_skeleton(stages, stage)[0] for stage in range(24)]
    for before_m, after_m in pairwise(frames):
        for share in (0.25, 0.5, 0.75):  # USD interpolates points linearly
            points_m = (1 - share) * before_m + share * after_m
            assert points_m[plant.first[child]] == pytest.approx(points_m[plant.parent_vertex[child]])


def test_no_point_goes_farther_in_a_frame_than_the_front_does():
    plant = small_tree()
    surface = carry_surface(build_branch_cage(plant), plant)
    frames = 60
    stages = plan_stages(plant, 0.02, frames + 1)
    uniform_m = stages.times.front.longest_m / frames
    points_m = np.array([grow_surface(stages, stage, surface) for stage in range(frames + 1)])
    moves_m = np.linalg.norm(np.diff(points_m, axis=0), axis=2)
    front_m = np.array([front_of(stages, stage) for stage in range(frames + 1)])
    assert np.diff(front_m).max() < 3 * uniform_m
    assert moves_m.max() < np.diff(front_m).max() + 0.2 * plant.radius_m.max()


@given(seed=st.integers(0, 10_000), count=st.integers(2, 12))
@settings(max_examples=30)
def test_growth_adds_and_ends_with_the_plant(seed, count):
    plant = random_tree(seed)
    stages = plan_stages(plant, 0.01 * float(np.ptp(plant.points_m, axis=0).max()), count)
    before_m, before_radius_m = grow_skeleton(stages, 0)
    ends = np.setdiff1d(np.arange(len(plant.points_m)), plant.first)

    def lengths(points_m):
        return np.linalg.norm(points_m[ends] - points_m[ends - 1], axis=1)

    for stage in range(1, count):
        points_m, radius_m = grow_skeleton(stages, stage)
        assert np.isfinite(points_m).all()
        assert (radius_m > 0).all()
        assert (radius_m >= before_radius_m * (1 - 1e-12)).all()
        assert (lengths(points_m) >= lengths(before_m) - 1e-9).all()
        child = plant.parent_curve >= 0
        assert np.array_equal(points_m[plant.first[child]], points_m[plant.parent_vertex[child]])
        before_m, before_radius_m = points_m, radius_m
    assert np.array_equal(before_m, plant.points_m)
    assert np.array_equal(before_radius_m, plant.radius_m)


@pytest.mark.parametrize("seed", [0, 3, 5])
def test_a_surface_grows_inside_what_it_becomes(seed):
    plant = random_tree(seed, max_branches=6)
    cage = build_branch_cage(plant)
    stages = plan_stages(plant, 0.02 * float(np.ptp(plant.points_m, axis=0).max()), 6)
    surface = carry_surface(cage, plant)
    low_m = np.minimum(cage.points_m.min(axis=0), plant.points_m.min(axis=0)) - 1e-6
    high_m = np.maximum(cage.points_m.max(axis=0), plant.points_m.max(axis=0)) + 1e-6
    for stage in range(len(stages)):
        points_m = grow_surface(stages, stage, surface)
        assert np.isfinite(points_m).all()
        assert (points_m >= low_m).all()
        assert (points_m <= high_m).all()
    assert np.array_equal(points_m, cage.points_m)


def test_the_surface_goes_with_the_skeleton():
    plant = small_tree()
    stages = plan_stages(plant, 0.05, 16)
    surface = carry_surface(build_branch_cage(plant), plant)
    for stage in (3, 8, 12):
        points_m = grow_surface(stages, stage, surface)
        _, radius_m = grow_skeleton(stages, stage)
        assert points_m[:, 1].max() == pytest.approx(min(front_of(stages, stage), 4), abs=0.02)
        foot = np.hypot(points_m[:, 0], points_m[:, 2])[points_m[:, 1] < 0.02].max()
        assert foot == pytest.approx(1.37 * radius_m[0], rel=0.1)  # the cage's cap is wider


def test_a_branch_that_has_not_begun_is_closed_at_the_surface_of_its_parent():
    plant = fork()  # its branch springs at 1 m and comes out 0.05 m from the trunk's axis
    stages = plan_stages(plant, 0.05, 60)
    surface = carry_surface(build_branch_cage(plant), plant)
    assert surface.emerges_m[1] == pytest.approx(0.05, rel=0.2)
    stage = next(stage for stage in range(60) if front_of(stages, stage) > 1)
    points_m = grow_surface(stages, stage, surface)
    _, radius_m = grow_skeleton(stages, stage)
    branch = surface.places.curve == 1
    beyond = branch & (surface.places.arc_m > 0.3)
    tip_m = points_m[beyond]
    assert np.ptp(tip_m, axis=0).max() < 1e-3  # one point, nearly
    share = radius_m[1] / plant.radius_m[1]
    own_m = float(stages.times.reach(stages.at[stage])[1]) - 1
    expected_m = max(own_m, surface.emerges_m[1] * share)
    assert tip_m.mean(axis=0) == pytest.approx([expected_m, 1, 0], abs=2e-3)


@pytest.mark.parametrize(
    "bad",
    [
        {"initial_internodes": 0.0},
        {"branch_share": np.nan},
        {"finish_share": 1.0},
        {"thicken_share": 0.2, "finish_share": 0.1},
    ],
)
def test_settings_that_cannot_be_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        GrowthStageSettings(**bad)


def test_times_and_lengths_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="internode_m"):
        plan_stages(stem(), 0.0, 5)
    with pytest.raises(ValueError, match="2 times"):
        plan_stages(stem(), 0.1, 1)
    with pytest.raises(ValueError, match="without length"):
        plan_stages(plant_of((np.zeros((3, 3)), 0.1, None, -1)), 0.1, 5)


def test_rings_of_a_fork_come_nearer_to_it_while_it_is_thin():
    trunk = (np.linspace([0, 0, 0], [0, 9, 0], 91), 0.2, None, -1)
    plant = plant_of(trunk, (np.linspace([0, 1, 0], [2, 1, 0], 21), 0.15, 0, 10))
    stages = plan_stages(plant, 0.05, 60)
    surface = carry_surface(build_branch_cage(plant), plant)
    stage = next(stage for stage in range(60) if stages.times.reach(stages.at[stage])[1] > 1.8)
    points_m = grow_surface(stages, stage, surface)
    share = grow_skeleton(stages, stage)[1][10] / plant.radius_m[10]
    assert share < 0.5
    on_trunk = (surface.places.curve == 0) & (surface.nearness == 1)
    assert (surface.fork[on_trunk] == 1).all()
    apart_m = surface.places.arc_m - surface.fork_arc_m
    assert np.ptp(apart_m[on_trunk]) > 0.2
    from_place_m = share_of(stages, stage, surface)[:, None] * (
        surface.points_m - surface.places.between(plant.points_m)
    )
    ring_m = (points_m - from_place_m)[on_trunk, 1]
    assert ring_m - surface.fork_arc_m[on_trunk] == pytest.approx(share * apart_m[on_trunk], abs=1e-6)


def share_of(stages, stage, surface):
    """(P,) thickness over that at last, where the points of a trunk along y are now."""
    fork = np.maximum(surface.fork, 0)
    spring = stages.skeleton.parent_vertex[fork]
    at_fork = grow_skeleton(stages, stage)[1][spring] / stages.skeleton.radius_m[spring]
    arc_m = surface.places.arc_m - surface.nearness * (1 - at_fork) * (surface.places.arc_m - surface.fork_arc_m)
    places = places_at(stages.skeleton, surface.places.curve, arc_m)
    path_m = stages.times.base_m[places.curve] + arc_m
    return places.between(stages.thickness(stage)) * stages.birth(stage, places.curve, path_m)
