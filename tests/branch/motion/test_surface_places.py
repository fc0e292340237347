"""Places on the axes of branches, where they are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.branch.axis_places import axis_exits, find_places, nearest_places, places_at
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.motion.surface_places import cage_exits, cage_places

from tests.support.branch_shapes import fork, plant_of, random_tree


def test_the_nearest_place_of_a_branch_is_found():
    plant = fork()
    points_m = np.array([[0.3, 0.5, 0], [0, 3, 0], [0.25, 1.2, 0.1]])
    places = find_places(plant, points_m, np.array([0, 0, 1]))
    assert places.arc_m == pytest.approx([0.5, 2, 0.25])
    assert places.between(plant.points_m) == pytest.approx(np.array([[0, 0.5, 0], [0, 2, 0], [0.25, 1, 0]]))
    assert places.between(plant.radius_m) == pytest.approx([0.05, 0.05, 0.03])


def test_the_nearest_bark_may_be_that_of_the_farther_axis():
    thick, thin = ([[0, 0, 0], [0, 2, 0]], 0.5), ([[1, 0, 0], [1, 2, 0]], 0.1)
    plant = plant_of((*thick, None, None), (*thin, None, None))
    points_m = np.array([[0.55, 1, 0], [0.85, 0.4, 0], [0.69, 1.3, 0], [0.71, 1.3, 0]])  # the middle of the gap is 0.7
    places = nearest_places(plant, points_m, np.array([0, 1]), apart_m=0.01)
    assert places.curve.tolist() == [0, 1, 0, 1]
    assert places.arc_m == pytest.approx([1, 0.4, 1.3, 1.3])
    alone = nearest_places(plant, points_m, np.array([1]), apart_m=0.01)
    assert alone.curve.tolist() == [1, 1, 1, 1]


@given(seed=st.integers(0, 10_000), share=st.floats(0, 1))
def test_a_length_along_a_branch_and_its_place_are_one(seed, share):
    plant = random_tree(seed, max_branches=6)
    curve = np.arange(len(plant))
    there = places_at(plant, curve, share * plant.lengths_m)
    assert there.arc_m == pytest.approx(share * plant.lengths_m)
    again = find_places(plant, there.between(plant.points_m), curve)
    assert again.between(plant.points_m) == pytest.approx(there.between(plant.points_m), abs=1e-9)


def test_beyond_its_ends_a_branch_has_its_ends():
    plant = fork()
    ends = places_at(plant, np.array([1, 1]), np.array([-1.0, 9.0]))
    assert ends.between(plant.points_m) == pytest.approx(plant.points_m[[3, 4]])


def test_lengths_begin_again_with_every_branch():
    assert fork().arcs_m == pytest.approx([0, 1, 2, 0, 1, 0, np.sqrt(0.5)])


@pytest.mark.parametrize("angle_deg", [90, 60, 30])
def test_a_branch_comes_out_where_its_axis_cuts_the_cylinder(angle_deg):
    exits = axis_exits(fork(angle_deg))
    assert exits.curve.tolist() == [-1, 0, 1]
    assert exits.arc_m[:2] == pytest.approx([0, 0.05 / np.sin(np.radians(angle_deg))], rel=1e-6)
    assert exits.parent_arc_m[1] == pytest.approx(1 + 0.05 / np.tan(np.radians(angle_deg)), rel=1e-6)


def test_a_branch_that_stays_inside_comes_out_at_its_end():
    trunk = [[0, 0, 0], [0, 2, 0]]
    inside = [[0, 0, 0], [0.01, 0.3, 0]]
    plant = plant_of((trunk, 0.1, None, 0), (inside, 0.02, 0, 0))
    assert axis_exits(plant).arc_m[1] == pytest.approx(plant.lengths_m[1])


def test_points_of_a_cage_lie_round_their_places():
    plant = fork()
    cage = build_branch_cage(plant)
    places = cage_places(cage, plant)
    away_m = np.linalg.norm(cage.points_m - places.between(plant.points_m), axis=1)
    assert (away_m < 1.6 * places.between(plant.radius_m)).all()
    assert set(places.curve) == {0, 1, 2}


def test_in_a_cage_a_branch_comes_out_of_the_middle_of_its_hole():
    plant = fork()
    exits = cage_exits(build_branch_cage(plant), plant)
    assert exits.curve.tolist() == [-1, 0, 1]
    assert exits.arc_m[1] == pytest.approx(0.05, rel=0.2)
    assert exits.parent_arc_m[1] == pytest.approx(1, abs=0.01)


def test_what_a_branch_without_a_surface_carries_comes_out_of_the_next_one_below():
    trunk, stub = [[0, 0, 0], [0, 1, 0], [0, 2, 0]], [[0, 1, 0], [0.05, 1, 0]]
    twig = [[0.05, 1, 0], [0.6, 1.2, 0]]
    plant = plant_of((trunk, 0.1, None, 0), (stub, 0.03, 0, 1), (twig, 0.02, 1, 1))
    cage = build_branch_cage(plant)
    assert set(cage.curve) == {0, 2}
    exits = cage_exits(cage, plant)
    assert exits.curve.tolist() == [-1, 0, 0]
    assert exits.parent_arc_m[2] == pytest.approx(1, abs=0.05)
    assert exits.arc_m[2] == pytest.approx(0.05, abs=0.02)
