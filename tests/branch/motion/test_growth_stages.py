"""Stages of a growth, where they are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.motion.growth_stages import (
    GrowthStageSettings,
    carry_surface,
    grow_skeleton,
    grow_surface,
    logistic_lengths,
    plan_stages,
)

from tests.support.branch_clouds import small_tree
from tests.support.branch_shapes import fork, plant_of, random_tree


def stem(count=41, radius_m=0.05):
    """A straight one of 2 m."""
    return plant_of((np.linspace(0, 2, count)[:, None] * [0, 1, 0], radius_m, None, 0))


def test_lengths_are_logistic_from_the_first_to_all():
    lengths = logistic_lengths(200, 50)
    assert lengths[0] == pytest.approx(2)
    assert lengths[-1] == 200
    assert (np.diff(lengths) > 0).all()
    # Equation 6 up to the share that is missing when it stops: its logit is a line in time.
    grown = 2 + (lengths - 2) * (0.99 * 200 - 2) / (200 - 2)
    logit = np.log(grown / (200 - grown))
    assert np.diff(logit) == pytest.approx(np.full(49, np.diff(logit)[0]))


def test_a_plant_of_few_internodes_grows_too():
    lengths = logistic_lengths(1.0, 5)
    assert lengths[0] == pytest.approx(0.5)
    assert lengths[-1] == 1


def test_a_stem_rises_to_its_front():
    stages = plan_stages(stem(), 0.05, 12)
    for stage in range(len(stages)):
        points_m, _ = grow_skeleton(stages, stage)
        assert points_m[:, 1] == pytest.approx(np.minimum(np.linspace(0, 2, 41), stages.front_m[stage]))
    assert stages.front_m[0] == pytest.approx(0.1)  # two internodes


def test_a_stem_is_as_thick_as_what_it_carries_asks_for():
    stages = plan_stages(stem(), 0.05, 12, GrowthStageSettings(allometry=AllometrySettings(exponent=0.5)))
    front_m = stages.front_m[6]
    _, radius_m = grow_skeleton(stages, 6)
    assert 0.5 < front_m < 1.9
    foot = (front_m + 0.025) / (2 + 0.025)  # half an internode stands for the tip
    assert radius_m[0] == pytest.approx(0.05 * np.sqrt(foot))
    node = 4  # at 0.2 m, far below the tip
    assert radius_m[node] == pytest.approx(0.05 * np.sqrt((front_m - 0.2 + 0.025) / (1.8 + 0.025)))
    assert (radius_m[np.linspace(0, 2, 41) > front_m] < 1e-5).all()
    assert (radius_m > 0).all()


def test_what_has_not_begun_lies_on_the_tip_of_its_parent():
    stages = plan_stages(small_tree(), 0.05, 20)
    plant = stages.skeleton
    stage = int(np.flatnonzero(stages.front_m < 1.5)[-1])  # the first branch leaves at 1.5 m
    points_m, radius_m = grow_skeleton(stages, stage)
    assert points_m[plant.curve > 0] == pytest.approx(
        np.tile([0, stages.front_m[stage], 0], (int((plant.curve > 0).sum()), 1))
    )
    assert (radius_m[plant.curve > 0] < 1e-5).all()


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
        assert points_m[:, 1].max() <= stages.front_m[stage] + 0.01
        assert points_m[:, 1].max() == pytest.approx(min(stages.front_m[stage], 4), abs=0.02)
        foot = np.hypot(points_m[:, 0], points_m[:, 2])[points_m[:, 1] < 0.02].max()
        assert foot == pytest.approx(1.37 * radius_m[0], rel=0.1)  # the cage's cap is wider


def test_a_branch_that_has_not_begun_is_closed_at_the_surface_of_its_parent():
    plant = fork()  # its branch springs at 1 m and comes out 0.05 m from the trunk's axis
    stages = plan_stages(plant, 0.05, 60)
    surface = carry_surface(build_branch_cage(plant), plant)
    assert surface.emerges_m[1] == pytest.approx(0.05, rel=0.2)
    stage = int(np.flatnonzero(stages.front_m > 1)[0])
    points_m = grow_surface(stages, stage, surface)
    _, radius_m = grow_skeleton(stages, stage)
    branch = surface.places.curve == 1
    beyond = branch & (surface.places.arc_m > 0.3)
    tip_m = points_m[beyond]
    assert np.ptp(tip_m, axis=0).max() < 1e-3  # one point, nearly
    share = radius_m[1] / plant.radius_m[1]
    expected_m = max(stages.front_m[stage] - 1, surface.emerges_m[1] * share)
    assert tip_m.mean(axis=0) == pytest.approx([expected_m, 1, 0], abs=2e-3)


@pytest.mark.parametrize("bad", [{"initial_internodes": 0.0}, {"taper_internodes": np.inf}])
def test_settings_that_cannot_be_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        GrowthStageSettings(**bad)


def test_times_and_lengths_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="internode_m"):
        plan_stages(stem(), 0.0, 5)
    with pytest.raises(ValueError, match="2 times"):
        plan_stages(stem(), 0.1, 1)
