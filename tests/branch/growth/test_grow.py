"""Growth towards points whose places decide what must grow."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree
from usdfoliage.branch.distances import distances_to_surface, near_surface
from usdfoliage.branch.growth.grow import grow_branches, seed_plants
from usdfoliage.branch.growth.logistic import LogisticSettings
from usdfoliage.branch.growth.regrowth import (
    RegrowthSettings,
    draw_to_axes,
    fill_hidden,
    fill_rest,
    find_feet,
    regrow,
    vary_growth,
)
from usdfoliage.branch.growth.settings import GrowthSettings

from tests.support.branch_clouds import line
from tests.support.branch_shapes import fork, plant_of

INTERNODE_M = 0.05
PLAIN = GrowthSettings(internode_m=INTERNODE_M, tropism=0.0, logistic=LogisticSettings(longest=40))


def ones(points_m: np.ndarray) -> np.ndarray:
    return np.ones(len(points_m))


def ball(middle_m, radius_m: float, count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(count, 3))
    places *= (rng.random(count) ** (1 / 3) / np.linalg.norm(places, axis=1))[:, None]
    return np.asarray(middle_m) + radius_m * places


def test_points_in_a_line_make_one_straight_stem_of_whole_internodes():
    points_m = line([0, 0, 0], [0, 2, 0], 201)
    grown = grow_branches(seed_plants(np.zeros((1, 3)), INTERNODE_M, 0.02), points_m, ones(points_m), PLAIN)
    skeleton = grown.skeleton
    assert len(skeleton) == 1
    assert grown.reached.all()
    np.testing.assert_allclose(skeleton.points_m[:, [0, 2]], 0, atol=1e-9)
    np.testing.assert_allclose(np.diff(skeleton.points_m[:, 1]), INTERNODE_M)
    assert abs(skeleton.points_m[-1, 1] - 2) < 2 * INTERNODE_M


def test_branching_angle_and_divergence_are_the_parameters():
    """Points at the side, where alone the laterals of a stem see them, each in the direction in which it stands."""
    settings = GrowthSettings(internode_m=0.1, tropism=0.0, pull=0.0, branching_deg=60, divergence_deg=90, stub=0)
    stem = seed_plants(np.zeros((1, 3)), 0.1, 0.02)
    stem = grow_branches(stem, line([0, 0.1, 0], [0, 1, 0], 100), np.ones(100), settings).skeleton
    around = ball([0, 0.6, 0], 0.6, 4000)
    around = around[np.hypot(around[:, 0], around[:, 2]) > 0.3]
    grown = grow_branches(stem, around, ones(around), settings, seed=3).skeleton
    lateral = np.flatnonzero(grown.order == 1)
    assert len(lateral) >= 4
    out = grown.points_m[grown.first[lateral] + 1] - grown.points_m[grown.first[lateral]]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    np.testing.assert_allclose(out[:, 1], np.cos(np.radians(60)), atol=1e-9)
    node = np.rint(grown.points_m[grown.first[lateral], 1] / 0.1)
    turn = np.degrees(np.arctan2(out[:, 2], out[:, 0]))
    quarters = (turn - turn[0]) / 90 + (node - node[0])
    np.testing.assert_allclose(quarters - np.rint(quarters / 4) * 4, 0, atol=1e-6)


def test_two_seeds_share_what_lies_between_them():
    roots_m = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    points_m = np.concatenate([ball([-1, 1, 0], 0.6, 3000, 1), ball([1, 1, 0], 0.6, 3000, 2)])
    points_m = np.concatenate([points_m, line([-1, 0, 0], [-1, 1, 0], 50), line([1, 0, 0], [1, 1, 0], 50)])
    grown = grow_branches(seed_plants(roots_m, INTERNODE_M, 0.02), points_m, ones(points_m), PLAIN)
    skeleton = grown.skeleton
    of_root = np.arange(len(skeleton))
    for number in np.flatnonzero(skeleton.parent_curve >= 0):
        of_root[number] = of_root[skeleton.parent_curve[number]]
    side = np.sign(skeleton.points_m[:, 0])
    np.testing.assert_array_equal(side, np.where(of_root[skeleton.curve] == 0, -1, 1))
    assert grown.reached.mean() > 0.9


def test_what_was_there_stays_and_radii_follow_allometry():
    start = fork()
    tip_m = start.points_m[start.counts[0] - 1]
    points_m = ball(np.add(tip_m, [0, 0.5, 0]), 0.4, 2000)
    grown = grow_branches(start, points_m, ones(points_m), PLAIN).skeleton
    assert len(grown) > len(start)
    for number in range(len(start)):
        for vertex in start.points_m[start.branch(number)]:
            assert np.linalg.norm(grown.points_m[grown.branch(number)] - vertex, axis=1).min() < 1e-9
    child = np.arange(len(start), len(grown))
    assert (grown.radius_m[grown.first[child]] <= grown.radius_m[grown.parent_vertex[child]] + 1e-12).all()
    inner = np.setdiff1d(np.arange(len(grown.points_m)), grown.first)
    new = inner[grown.curve[inner] >= len(start)]
    assert (np.diff(grown.radius_m)[new - 1] <= 1e-12).all()


def test_beside_a_stem_that_is_there_a_plant_grows_as_if_it_grew_with_it():
    stem = plant_of(([[0, 0, 0], [0, 4, 0]], 0.05, None, None))
    rng = np.random.default_rng(0)
    points_m = np.column_stack([rng.uniform(0.15, 0.4, 400), rng.uniform(1, 3.5, 400), rng.uniform(-0.1, 0.1, 400)])
    settings = replace(PLAIN, logistic=LogisticSettings(longest=80))
    angles_deg = []
    for ages in (False, True):
        grown = grow_branches(stem, points_m, ones(points_m), settings, ages=ages)
        tree = grown.skeleton
        assert grown.reached.mean() > 0.9
        first = np.flatnonzero(tree.order == 1)
        ends_m = tree.points_m[tree.first[first] + np.minimum(tree.counts[first] - 1, 3)]
        offset_m = ends_m - tree.points_m[tree.first[first]]
        up = offset_m[:, 1] / np.linalg.norm(offset_m, axis=1)
        angles_deg.append(float(np.degrees(np.arccos(up)).mean()))
    assert angles_deg[1] < angles_deg[0] - 8


def test_from_a_short_stem_a_plant_of_its_age_grows_too():
    stem = plant_of(([[0, 0, 0], [0, 0.2, 0]], 0.05, None, None))
    points_m = ball(np.array([0.0, 0.8, 0.0]), 0.6, 1500)
    grown = grow_branches(stem, points_m, ones(points_m), PLAIN, ages=True)
    assert grown.reached.mean() > 0.9


def test_stubs_and_whips_are_shed():
    points_m = np.concatenate([line([0, 0, 0], [0, 1, 0], 100), [[0.06, 0.5, 0.0], [0, 0.5, 0.07]]])
    seed = seed_plants(np.zeros((1, 3)), INTERNODE_M, 0.02)
    kept = grow_branches(seed, points_m, ones(points_m), GrowthSettings(internode_m=INTERNODE_M, stub=0, kill=0.2))
    shed = grow_branches(seed, points_m, ones(points_m), GrowthSettings(internode_m=INTERNODE_M, stub=3, kill=0.2))
    assert len(shed.skeleton) == 1
    assert len(kept.skeleton) == 1 + shed.shed
    cloud = ball([0, 1, 0], 0.7, 4000)
    stout = grow_branches(seed, cloud, ones(cloud), GrowthSettings(internode_m=INTERNODE_M, slenderness=60))
    slim = grow_branches(seed, cloud, ones(cloud), GrowthSettings(internode_m=INTERNODE_M, slenderness=1e9))
    assert stout.shed > slim.shed
    assert len(slim.skeleton) > len(stout.skeleton) > 1


def test_weights_draw_shoots():
    seed = seed_plants(np.zeros((1, 3)), INTERNODE_M, 0.02)
    points_m = np.array([[0.1, 0.2, 0.0], [-0.1, 0.2, 0.0]])
    settings = GrowthSettings(internode_m=INTERNODE_M, tropism=0.0)
    even = grow_branches(seed, points_m, np.ones(2), settings).skeleton
    drawn = grow_branches(seed, points_m, np.array([9.0, 1.0]), settings).skeleton
    assert even.points_m[2, 0] == pytest.approx(0, abs=1e-9)
    assert drawn.points_m[2, 0] > 0.005


def test_a_seed_grows_the_same_plant_and_another_another():
    points_m = ball([0, 1, 0], 0.8, 3000)
    roots_m = np.zeros((1, 3))
    one, again, other = (regrow(points_m, roots_m, 0.03, PLAIN, seed=seed).skeleton for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.points_m, again.points_m)
    np.testing.assert_array_equal(one.radius_m, again.radius_m)
    assert one.points_m.shape != other.points_m.shape or not np.array_equal(one.points_m, other.points_m)


def test_points_without_weights_are_refused():
    with pytest.raises(ValueError, match="3 points have 2 weights"):
        grow_branches(fork(), np.zeros((3, 3)), np.ones(2), PLAIN)


def test_no_points_leave_the_plant_as_it_is():
    grown = grow_branches(fork(), np.zeros((0, 3)), np.zeros(0), PLAIN)
    assert (len(grown.skeleton), grown.grown, grown.cycles) == (len(fork()), 0, 0)
    grown = fill_hidden(fork(), line([0, 0, 0], [0, 1, 0], 60), 0.02, PLAIN)
    assert (len(grown.skeleton), grown.grown) == (len(fork()), 0)


def test_the_inside_of_a_closed_crown_is_grown_into():
    rng = np.random.default_rng(0)
    shell_m = rng.normal(size=(20_000, 3))
    shell_m = [0, 1.5, 0] + shell_m / np.linalg.norm(shell_m, axis=1, keepdims=True)
    trunk = seed_plants(np.zeros((1, 3)), 0.6, 0.04)  # from the ground into the ball
    grown = fill_hidden(trunk, shell_m, 0.03, GrowthSettings(internode_m=INTERNODE_M), RegrowthSettings())
    assert grown.grown > 20
    away_m = np.linalg.norm(grown.skeleton.points_m - [0, 1.5, 0], axis=1)
    inside = grown.skeleton.curve > 0
    assert (away_m[inside] < 1.01).all()  # from the trunk, which comes in through the surface
    assert grown.reached.mean() > 0.8


def test_limbs_grow_on_into_what_they_leave_of_a_cloud():
    """A trunk and a limb are traced; beside the limb's tip there is a ball of points, as of leaves."""
    limb_m = np.concatenate([line([0, 1, 0], [0.4, 1.0, 0], 20), line([0.4, 1.0, 0], [0.8, 1.2, 0.2], 21)[1:]])
    traced = plant_of((line([0, 0, 0], [0, 2, 0], 61), 0.03, None, 0), (limb_m, 0.015, 0, 30))
    leaves_m = ball([1.1, 1.3, 0], 0.3, 800)
    cloud_m = np.concatenate([traced.points_m, leaves_m])
    filled = fill_rest(traced, cloud_m, 0.1, PLAIN)
    assert filled.grown > 5
    assert filled.reached.mean() > 0.95
    skeleton = filled.skeleton
    for number in range(2):  # as they were, as far as they went
        before_m, after_m = traced.points_m[traced.branch(number)], skeleton.points_m[skeleton.branch(number)]
        fine_m = np.concatenate([line(a, b, 200) for a, b in pairwise(after_m)])
        assert cKDTree(fine_m).query(before_m)[0].max() < 5e-3  # between the points of the finer line
        assert cKDTree(after_m).query(before_m[[0, 19, -1]])[0][[0, 2]].max() < 1e-9
    assert cKDTree(skeleton.points_m).query(limb_m[19])[0] < 1e-9  # its bend, too
    assert not skeleton.inferred[0]
    assert skeleton.inferred[2:].all()
    again = fill_rest(skeleton, cloud_m[filled.reached], 0.1, PLAIN)
    assert (again.grown, again.cycles) == (0, 0)
    np.testing.assert_array_equal(again.skeleton.points_m, skeleton.points_m)


def test_what_a_cloud_does_not_show_of_a_crown_is_inferred():
    rng = np.random.default_rng(0)
    shell_m = rng.normal(size=(8000, 3))
    shell_m = [0, 1.5, 0] + shell_m / np.linalg.norm(shell_m, axis=1, keepdims=True)
    grown = fill_hidden(seed_plants(np.zeros((1, 3)), 0.6, 0.04), shell_m, 0.03, PLAIN)
    assert grown.skeleton.inferred[1:].all()
    assert not regrow(shell_m, np.zeros((1, 3)), 0.03, PLAIN).skeleton.inferred.any()


def test_a_trunk_is_grown_along_its_axis():
    rng = np.random.default_rng(0)
    turn, height = rng.uniform(0, 2 * np.pi, 5000), rng.uniform(0, 2, 5000)
    bark_m = np.column_stack([0.1 * np.cos(turn), height, 0.1 * np.sin(turn)])
    trunk = seed_plants(np.zeros((1, 3)), 2.0, 0.1)
    drawn_m = draw_to_axes(bark_m, trunk, 0.025)
    np.testing.assert_allclose(drawn_m[:, [0, 2]], 0, atol=1e-9)
    np.testing.assert_allclose(drawn_m[:, 1], height, atol=1e-9)
    np.testing.assert_array_equal(draw_to_axes(bark_m, trunk, 0.2), bark_m)
    away_m = 2 * bark_m
    above_foot = away_m[:, 1] > 0.4  # below it a stem may flare
    drawn_m = draw_to_axes(away_m, trunk, 0.025)
    np.testing.assert_array_equal(drawn_m[above_foot], away_m[above_foot])
    assert (drawn_m[~above_foot] != away_m[~above_foot]).any()
    grown = regrow(bark_m, np.zeros((1, 3)), 0.1, PLAIN, stems=trunk).skeleton
    assert len(grown) == 1


def test_bark_at_a_bend_and_around_a_thin_branch_inside_is_of_the_trunk():
    trunk = plant_of(
        ([[0, 0, 0], [0, 0.5, 0], [0, 1, 0], [0.3, 2, 0]], 0.1, None, None),
        ([[0, 0.5, 0], [0.08, 0.55, 0]], [0.03, 0.03], 0, 1),
    )
    turn = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    ring_m = 0.1 * np.column_stack([np.cos(turn), 0 * turn, np.sin(turn)])
    outside_bend_m = np.array([[-0.1, 1.02, 0.0]])  # beyond the end of the lower piece, and below the upper one's
    bark_m = np.concatenate([np.add(ring_m, [0, 0.55, 0]), outside_bend_m])
    drawn_m = draw_to_axes(bark_m, trunk, 0.01)
    np.testing.assert_allclose(drawn_m[:-1, [0, 2]], 0, atol=1e-9)
    assert np.linalg.norm(drawn_m[-1] - [0, 1, 0]) < 0.03


def test_a_plant_is_as_thick_as_the_stem_that_it_grows_along():
    """By allometry the trunk would be thin below the twigs that it ends in."""
    points_m = np.concatenate([line([0, 0, 0], [0, 2, 0], 201), ball([0, 2.3, 0], 0.3, 400)])
    trunk = seed_plants(np.zeros((1, 3)), 2.0, 0.1)
    plain = regrow(points_m, np.zeros((1, 3)), 0.1, PLAIN).skeleton
    seen = regrow(points_m, np.zeros((1, 3)), 0.1, PLAIN, stems=trunk).skeleton
    for skeleton, thick in ((plain, False), (seen, True)):
        low = (skeleton.points_m[:, 1] < 1.6) & (skeleton.order[skeleton.curve] == 0)
        assert (skeleton.radius_m[low].min() > 0.0999) == thick
    assert seen.radius_m.min() < 0.01


def test_a_seed_stands_on_the_axis_of_the_stem_that_a_root_is_on_the_bark_of():
    trunk = seed_plants(np.array([[0.0, 0.05, 0.0]]), 2.0, 0.1)
    np.testing.assert_allclose(
        find_feet(np.array([[0.1, 0.0, 0.0], [0.5, 0.0, 0.0]]), trunk), [[0, 0, 0], [0.5, 0, 0]], atol=1e-12
    )


GAPS = replace(PLAIN, max_gap_m=1.0)


@pytest.mark.parametrize("apart_m", [0.3, 0.9])
def test_a_trunk_of_points_far_apart_is_grown_along_to_its_crown(apart_m):
    trunk_m = line([0, 0, 0], [0, 1.8, 0], round(1.8 / apart_m) + 1)
    points_m = np.concatenate([trunk_m, ball([0, 2.3, 0], 0.5, 4000)])
    stopped = regrow(points_m, np.zeros((1, 3)), 0.03, PLAIN, near_m=0.15)
    assert stopped.reached.mean() < 0.5
    grown = regrow(points_m, np.zeros((1, 3)), 0.03, GAPS, near_m=0.15)
    assert grown.reached.mean() > 0.98
    assert grown.reached[: len(trunk_m)].all()
    foot = grown.skeleton.points_m[:, 1] < 1.6
    np.testing.assert_allclose(grown.skeleton.points_m[foot][:, [0, 2]], 0, atol=0.06)


def test_a_gap_in_a_trunk_is_crossed_up_to_the_widest_that_is_allowed():
    low_m, high_m = line([0, 0, 0], [0, 0.5, 0], 51), line([0.1, 1.2, 0], [0.1, 2, 0], 81)
    points_m = np.concatenate([low_m, high_m])
    for max_gap_m, crosses in ((0.9, True), (0.5, False)):
        settings = replace(PLAIN, max_gap_m=max_gap_m)
        grown = regrow(points_m, np.zeros((1, 3)), 0.03, settings, near_m=0.1)
        assert grown.reached[: len(low_m)].all()
        assert grown.reached[len(low_m) :].all() == crosses
        assert len(grown.skeleton) == 1


def test_points_close_together_are_come_near_to():
    """From as far as three internodes a flat leaf would be used up by a shoot along its edge."""
    points_m = np.concatenate([line([0, 0, 0], [0, 1, 0], 51), ball([0, 1.3, 0], 0.3, 20_000)])
    for max_kill_m, comes in ((np.inf, False), (0.035, True)):
        settings = replace(PLAIN, max_kill_m=max_kill_m)
        skeleton = regrow(points_m, np.zeros((1, 3)), 0.03, settings).skeleton
        away_m = distances_to_surface(points_m, skeleton, 0.02)
        assert ((away_m < 0.05).mean() > 0.95) == comes


def test_what_is_inside_a_thick_branch_is_reached_whatever_twigs_are_near():
    skeleton = plant_of(
        ([[0, 0, 0], [0, 1, 0], [0, 2, 0]], 0.3, None, None),
        ([[0, 1, 0], [0.31, 1, 0]], 0.001, 0, 1),
    )
    bark_m = np.array([[0.3 * np.cos(turn), 1.0, 0.3 * np.sin(turn)] for turn in np.linspace(0, 1, 20)])
    assert near_surface(bark_m, skeleton, 0.02).all()
    assert not near_surface(1.2 * bark_m, skeleton, 0.02)[5:].any()


def test_variations_are_near_and_differ():
    varied = [vary_growth(PLAIN, 0.1, seed) for seed in range(4)]
    for settings in varied:
        assert abs(settings.branching_deg / PLAIN.branching_deg - 1) <= 0.1
        assert abs(settings.internode_m / PLAIN.internode_m - 1) <= 0.1
    assert len({settings.divergence_deg for settings in varied}) == 4
    assert vary_growth(PLAIN, 0, 1) == PLAIN


@pytest.mark.parametrize(
    "wrong",
    [
        {"internode_m": 0},
        {"internode_m": np.nan},
        {"internode_m": 1, "perception_deg": 0},
        {"internode_m": 1, "pull": -1},
        {"internode_m": 1, "rest": 0},
        {"internode_m": 1, "max_kill_m": 0},
        {"internode_m": 1, "max_gap_m": -1},
    ],
)
def test_settings_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must|kill|rest"):
        GrowthSettings(**wrong)
