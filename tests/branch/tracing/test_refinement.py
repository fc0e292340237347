"""Fewer vertices and no sharp bends: what may move, by how much, and what stays."""

from itertools import pairwise

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.refinement import (
    RefinementSettings,
    collapse_nodes,
    draw_fair,
    refine_branches,
    round_bends,
    split_edges,
    turns_rad,
)

from tests.support.branch_clouds import line
from tests.support.branch_shapes import plant_of, random_tree

SEEDS = st.integers(0, 2**32 - 1)


def off_polyline(points_m: np.ndarray, axis_m: np.ndarray) -> np.ndarray:
    """(N,) distances of points from a polyline."""
    step_m = np.diff(axis_m, axis=0)
    square = np.maximum(np.sum(step_m**2, axis=1), 1e-300)
    share = np.clip(np.sum((points_m[:, None] - axis_m[:-1]) * step_m, axis=2) / square, 0, 1)
    return np.linalg.norm(points_m[:, None] - axis_m[:-1] - share[..., None] * step_m, axis=2).min(axis=1)


def bends_deg(points_m: np.ndarray) -> np.ndarray:
    step_m = np.diff(points_m, axis=0)
    step_m = step_m[np.linalg.norm(step_m, axis=1) > 1e-9]
    step_m = step_m / np.linalg.norm(step_m, axis=1, keepdims=True)
    return np.degrees(np.arccos(np.clip(np.sum(step_m[1:] * step_m[:-1], axis=1), -1, 1)))


def nothing() -> Skeleton:
    none = np.zeros(0, np.int32)
    return Skeleton(
        points_m=np.zeros((0, 3)), radius_m=np.zeros(0), counts=none, parent_curve=none, parent_vertex=none, order=none
    )


def corner(angle_deg: float, legs_m=(1.0, 1.0)) -> Skeleton:
    """A branch that goes up and then off by an angle."""
    turn = np.radians(angle_deg)
    end_m = [legs_m[1] * np.sin(turn), legs_m[0] + legs_m[1] * np.cos(turn), 0]
    return plant_of((np.array([[0, 0, 0], [0, legs_m[0], 0], end_m]), np.array([0.03, 0.02, 0.01]), None, 0))


def test_long_edges_are_split_evenly_and_what_springs_from_their_ends_still_does():
    plant = plant_of(
        ([[0, 0, 0], [0, 1, 0], [0, 1.1, 0]], [0.2, 0.1, 0.1], None, None),
        ([[0, 1, 0], [0.5, 1, 0]], 0.05, 0, 1),
    )
    split, before = split_edges(plant, np.array([0.3, 0.3, 0.3, 0.2, 0.2]))
    np.testing.assert_array_equal(split.points_m[before], plant.points_m)
    np.testing.assert_array_equal(split.counts, [6, 4])
    np.testing.assert_allclose(split.points_m[:6, 1], [0, 0.25, 0.5, 0.75, 1, 1.1])
    np.testing.assert_allclose(split.radius_m[:6], [0.2, 0.175, 0.15, 0.125, 0.1, 0.1])
    np.testing.assert_allclose(split.points_m[6:, 0], [0, 1 / 6, 1 / 3, 0.5])
    np.testing.assert_array_equal(split.parent_vertex, [-1, 4])
    whole, _ = split_edges(plant, np.full(5, 2.0))
    np.testing.assert_array_equal(whole.points_m, plant.points_m)


def test_of_a_straight_branch_the_ends_and_the_forks_stay():
    trunk_m, radius_m = line([0, 0, 0], [0, 2, 0], 41), np.linspace(0.1, 0.05, 41)
    twig_m = line(trunk_m[13], trunk_m[13] + [1, 0, 0], 11)
    of_any_length = RefinementSettings(longest=100)
    plant = collapse_nodes(plant_of((trunk_m, radius_m, None, 0), (twig_m, 0.01, 0, 13)), 0.05, of_any_length)
    assert plant.counts.tolist() == [3, 2]
    np.testing.assert_allclose(plant.points_m[:3], trunk_m[[0, 13, 40]])
    np.testing.assert_allclose(plant.radius_m[:3], radius_m[[0, 13, 40]])
    assert plant.parent_vertex.tolist() == [-1, 1]


@pytest.mark.parametrize(("radius_m", "longest_m"), [(0.01, 0.4), (0.1, 0.8)])
def test_an_edge_of_a_straight_branch_is_no_longer_than_its_internodes_or_its_radius_allow(radius_m, longest_m):
    trunk_m = line([0, 0, 0], [0, 4, 0], 401)
    plant = collapse_nodes(plant_of((trunk_m, radius_m, None, 0)), 0.05)
    edges_m = np.diff(plant.points_m[:, 1])
    assert edges_m.max() <= longest_m + 0.011
    assert len(edges_m) <= np.ceil(4 / longest_m) + 1


def test_a_change_of_radius_stays():
    radius_m = np.where(np.arange(11) < 5, 0.1, 0.05)
    plant = collapse_nodes(plant_of((line([0, 0, 0], [0, 1, 0], 11), radius_m, None, 0)), 0.2)
    assert plant.points_m[:, 1] == pytest.approx([0, 0.4, 0.5, 1])


@examples(max_examples=50)
@given(seed=SEEDS, max_moved=st.floats(0, 2), min_moved=st.floats(0, 1), wild=st.booleans())
def test_collapsing_moves_no_branch_by_more_than_it_may(seed, max_moved, min_moved, wild):
    plant = random_tree(seed, wild=wild)
    settings = RefinementSettings(max_moved=max_moved, min_moved=min_moved, radius_change=0.2)
    simple = collapse_nodes(plant, 0.05, settings)
    assert len(simple) == len(plant)
    assert simple.parent_curve.tolist() == plant.parent_curve.tolist()
    for number in range(len(plant)):
        own, kept = plant.branch(number), simple.branch(number)
        before_m, after_m = plant.points_m[own], simple.points_m[kept]
        np.testing.assert_array_equal(after_m[[0, -1]], before_m[[0, -1]])
        allowed_m = np.maximum(max_moved * plant.radius_m[own], min_moved * 0.05)
        assert (off_polyline(before_m, after_m) <= allowed_m + 1e-9).all()
    forks = plant.parent_curve >= 0
    np.testing.assert_array_equal(
        simple.points_m[simple.parent_vertex[forks]], plant.points_m[plant.parent_vertex[forks]]
    )


@examples(max_examples=30)
@given(seed=SEEDS)
def test_where_nothing_may_move_bends_stay(seed):
    plant = random_tree(seed)
    simple = collapse_nodes(plant, 0.05, RefinementSettings(max_moved=0, min_moved=0, radius_change=0))
    inner = np.setdiff1d(np.arange(len(plant.points_m)), [*plant.first, *(plant.first + plant.counts - 1)])
    inner = np.setdiff1d(inner, plant.parent_vertex)
    bent = [vertex for vertex in inner if bends_deg(plant.points_m[vertex - 1 : vertex + 2]).max(initial=0) > 0.01]
    assert len(simple.points_m) >= len(plant.points_m) - len(inner) + len(bent)


@pytest.mark.parametrize("angle_deg", [25, 60, 90, 120])
@pytest.mark.parametrize("legs_m", [(1.0, 1.0), (1.0, 0.2), (0.3, 2.0)])
def test_a_sharp_bend_is_shared_among_three(angle_deg, legs_m):
    plant = corner(angle_deg, legs_m)
    rounded = round_bends(plant)
    assert rounded.counts.tolist() == [5]
    bends = bends_deg(rounded.points_m)
    assert bends.max() < 0.7 * angle_deg
    assert bends.sum() == pytest.approx(angle_deg)  # in one plane and one way round
    np.testing.assert_array_equal(rounded.points_m[[0, -1]], plant.points_m[[0, -1]])
    assert off_polyline(rounded.points_m, plant.points_m).max() <= 0.5 * min(legs_m)
    assert (np.diff(rounded.radius_m) <= 0).all()


def test_a_slight_bend_stays_as_it_is():
    for angle_deg, vertices in ((9.9, 3), (10.1, 5)):
        assert len(round_bends(corner(angle_deg)).points_m) == vertices
    assert len(round_bends(corner(120), RefinementSettings(sharpest_deg=121)).points_m) == 3


def test_a_bend_from_which_a_branch_springs_stays():
    trunk_m = corner(90).points_m
    plant = plant_of((trunk_m, 0.05, None, 0), (trunk_m[1] + [[0, 0, 0], [0, 0, 1]], 0.01, 0, 1))
    np.testing.assert_array_equal(round_bends(plant).points_m, plant.points_m)


def test_bends_next_to_each_other_leave_no_edge_without_length():
    zigzag_m = np.array([[0.0, 0, 0], [0.1, 0.1, 0], [0, 0.2, 0], [0.1, 0.3, 0], [0, 0.4, 0]])
    rounded = round_bends(plant_of((zigzag_m, 0.01, None, 0)))
    assert np.linalg.norm(np.diff(rounded.points_m, axis=0), axis=1).min() > 1e-3
    assert bends_deg(rounded.points_m).max() < 0.7 * 90


@examples(max_examples=60)
@given(seed=SEEDS, wild=st.booleans(), sharpest_deg=st.floats(5, 180))
def test_after_rounding_it_is_a_skeleton_of_the_same_branches(seed, wild, sharpest_deg):
    plant = random_tree(seed, wild=wild)
    rounded = round_bends(plant, RefinementSettings(sharpest_deg=sharpest_deg))  # which checks that junctions repeat
    assert rounded.parent_curve.tolist() == plant.parent_curve.tolist()
    assert rounded.order.tolist() == plant.order.tolist()
    last = plant.first + plant.counts - 1
    np.testing.assert_array_equal(rounded.points_m[rounded.first], plant.points_m[plant.first])
    np.testing.assert_array_equal(rounded.points_m[rounded.first + rounded.counts - 1], plant.points_m[last])
    for number in range(len(plant)):
        sharpest = bends_deg(plant.points_m[plant.branch(number)]).max(initial=0)
        assert bends_deg(rounded.points_m[rounded.branch(number)]).max(initial=0) <= sharpest + 1e-3


def test_no_branches_stay_none():
    assert not len(collapse_nodes(nothing(), 0.05))
    assert not len(round_bends(nothing()))


def test_vertices_at_one_place_collapse_to_two():
    plant = plant_of((np.zeros((5, 3)), 0.01, None, 0))
    assert collapse_nodes(plant, 0.05).counts.tolist() == [2]
    assert round_bends(plant).counts.tolist() == [5]


@pytest.mark.parametrize("change", [{"max_moved": -0.1}, {"min_moved": -1.0}, {"radius_change": np.nan}])
def test_to_move_less_than_nothing_is_refused(change):
    with pytest.raises(ValueError, match="must not be below 0"):
        RefinementSettings(**change)


@pytest.mark.parametrize("sharpest_deg", [0.0, 181.0])
def test_a_bend_that_is_none_is_refused(sharpest_deg):
    with pytest.raises(ValueError, match="sharpest_deg must be in"):
        RefinementSettings(sharpest_deg=sharpest_deg)


def helix(count: int) -> np.ndarray:
    angle = np.linspace(0, 3 * np.pi, count)
    return np.stack([0.4 * np.cos(angle), 0.2 * angle, 0.4 * np.sin(angle)], axis=1)


def off_helix(points_m: np.ndarray) -> np.ndarray:
    return off_polyline(points_m, helix(3000))


def test_turns_are_those_of_the_curve():
    plant = plant_of((helix(400), 0.02, None, 0), (helix(400)[100] + line([0, 0, 0], [1, 0, 0], 5), 0.01, 0, 100))
    turns = turns_rad(plant)
    assert (turns[[0, 399]] == 0).all()
    np.testing.assert_allclose(turns[400:], 0, atol=1e-7)
    step = 3 * np.pi / 399
    along, around = 0.2 * step, 2 * 0.4 * np.sin(step / 2)  # of a chord
    cosine = (along**2 + around**2 * np.cos(step)) / (along**2 + around**2)
    np.testing.assert_allclose(turns[1:399], np.arccos(cosine), rtol=1e-4)


def test_vertices_at_one_place_have_the_turn_of_their_branch():
    corner_m = np.array([[0, 0, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0], [1, 1, 0], [1, 1, 0]], float)
    plant = plant_of((corner_m, 0.1, None, 0), (np.array([[1, 1, 0], [1, 1, 1.0]]), 0.1, 0, 4))
    np.testing.assert_allclose(turns_rad(plant), [0, 0, 0, np.pi / 2, 0, 0, 0, 0], atol=1e-12)


def test_a_few_nodes_become_the_curve_that_they_are_of():
    """A polyline through 19 nodes of a helix is 13.6 mm off it; a spline is not."""
    plant = plant_of((helix(19), 0.02, None, 0))
    assert off_polyline(helix(3000), plant.points_m).max() > 0.0135
    fair = draw_fair(plant, 0.05, 0.0, RefinementSettings(stiffness=1e-4))
    assert off_helix(fair.points_m[24:-24]).max() < 0.002
    refined = refine_branches(plant, 0.05)
    assert off_polyline(helix(3000)[300:-300], refined.points_m).max() < 0.0105  # moved by half of its radius at most
    assert np.percentile(bends_deg(refined.points_m), 95) < 8
    assert bends_deg(plant.points_m).max() > 25


def test_noise_within_the_radius_goes_and_forks_stay_joined():
    rng = np.random.default_rng(4)
    trunk_m = helix(90)
    limb_m = trunk_m[40] + line([0, 0, 0], [1.2, 0.3, 0], 30)
    noisy = [each + rng.normal(0, 0.006, each.shape) for each in (trunk_m, limb_m)]
    noisy[1][0] = noisy[0][40]
    plant = plant_of((noisy[0], 0.03, None, 0), (noisy[1], 0.02, 0, 40))
    refined = refine_branches(plant, 0.05)
    before, after = (np.sqrt(np.mean(off_helix(each.points_m[each.branch(0)]) ** 2)) for each in (plant, refined))
    assert after < 0.75 * before
    assert np.percentile(np.degrees(turns_rad(plant)), 95) > 40
    assert np.percentile(np.degrees(turns_rad(refined)), 95) < 8
    assert refined.parent_curve.tolist() == [-1, 0]


@examples(max_examples=30)
@given(seed=SEEDS, wild=st.booleans())
def test_vertices_are_moved_about_as_far_as_they_may(seed, wild):
    plant = random_tree(seed, wild=wild)
    fair = draw_fair(plant, 0.05, 0.001)
    before = split_edges(
        plant,
        np.maximum(np.linalg.norm(plant.edges_m, axis=1) / 8, np.maximum(0.04 * 0.05, 0.1 * plant.radius_m)),
    )[1]
    own = np.ones(len(plant.points_m), bool)
    own[plant.first[plant.parent_curve >= 0]] = False  # these go with their parents
    moved_m = np.linalg.norm(fair.points_m[before] - plant.points_m, axis=1)
    assert np.median(moved_m[own] / np.maximum(0.5 * plant.radius_m, 0.001)[own]) <= 1.01
    assert fair.parent_curve.tolist() == plant.parent_curve.tolist()
    assert np.isfinite(fair.points_m).all()


@examples(max_examples=30)
@given(seed=SEEDS)
def test_edges_stand_for_pieces_that_turn_little(seed):
    fine = split_edges(random_tree(seed), np.full(len(random_tree(seed).points_m), 0.01))[0]
    kept = collapse_nodes(fine, 0.05, RefinementSettings(max_moved=1e3, min_moved=1e3, radius_change=1e3))
    number = {tuple(place): at for at, place in enumerate(fine.points_m[: fine.counts[0]])}
    ends = [number[tuple(place)] for place in kept.points_m[: kept.counts[0]]]
    turns = turns_rad(fine)
    for first, last in pairwise(ends):
        assert turns[first + 1 : last].sum() <= np.radians(5.0) + 1e-9


def test_straight_branches_stay_however_uneven_their_vertices_are():
    at = np.array([0, 0.01, 0.02, 0.5, 0.51, 0.9, 2.0])
    plant = plant_of((at[:, None] * [0.3, 1, 0.1], 0.02, None, 0))
    fair = draw_fair(plant, 0.05, 0.01)
    assert off_polyline(fair.points_m, plant.points_m).max() < 1e-6
    assert refine_branches(plant, 0.3).counts.tolist() == [2]


@pytest.mark.parametrize(
    ("wrong", "named"),
    [({"stiffness": -1.0}, "stiffness"), ({"pieces": 0}, "pieces"), ({"max_turn_deg": 0.0}, "max_turn_deg")],
)
def test_settings_that_make_no_curve_are_refused(wrong, named):
    with pytest.raises(ValueError, match=named):
        RefinementSettings(**wrong)


def test_nothing_stays_nothing():
    assert len(refine_branches(nothing(), 0.05)) == 0
