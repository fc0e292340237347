"""Branches that cannot be joined: they run into what they spring from, and nothing that they carry is lost."""

import numpy as np
import pytest
from usdfoliage.branch.cage.build import build_branch_cage, check_cage
from usdfoliage.branch.cage.pieces import FOOT, THICKEST, StandingWood, cut_loose

from tests.support.branch_shapes import plant_of, random_tree

UP_M = np.array([[0.0, 0, 0], [0, 1, 0], [0, 2, 0]])


def side_plant():
    """A trunk 10 cm thick; an arm straight out of its middle, with a twig near its base and one near its tip."""
    arm_m = np.column_stack([np.linspace(0, 1, 11), np.full(11, 1.0), np.zeros(11)])
    return plant_of(
        (UP_M, [0.05] * 3, None, 0),
        (arm_m, [0.02] * 11, 0, 1),
        (arm_m[8] + [[0, 0, 0], [0, 0.3, 0]], [0.005] * 2, 1, 8),
        (arm_m[0] + [[0, 0, 0], [0.3, 0.3, 0]], [0.005] * 2, 1, 0),
    )


def test_a_piece_begins_inside_of_what_it_springs_from():
    plant = side_plant()
    lost = np.array([False, True, True, True])
    pieces = cut_loose(plant, lost, ~lost)
    assert pieces.curve.tolist() == [1, 2, 3]
    assert pieces.skeleton.parent_curve.tolist() == [
        -1,
        0,
        -1,
    ]  # what left from the part that is cut off is a piece too
    begins_m = pieces.skeleton.points_m[pieces.skeleton.first]
    assert begins_m[0, 0] == pytest.approx(0.05 - FOOT * 0.02, abs=0.25 * 0.02)  # the bark is 5 cm from the axis
    assert np.linalg.norm(begins_m[2, [0, 2]]) < 0.05
    np.testing.assert_allclose(pieces.skeleton.points_m[pieces.skeleton.parent_vertex[1]], [0.8, 1, 0])
    assert pieces.skeleton.order.tolist() == [0, 1, 0]


def test_a_piece_begins_no_thicker_than_what_it_springs_from():
    thick_m = np.array([[0.0, 1, 0], [0.3, 1, 0], [1, 1, 0]])
    plant = plant_of((UP_M, [0.05] * 3, None, 0), (thick_m, [0.09] * 3, 0, 1))
    lost = np.array([False, True])
    pieces = cut_loose(plant, lost, ~lost)
    assert pieces.skeleton.radius_m[0] <= THICKEST * 0.05 + 1e-12
    assert pieces.skeleton.radius_m[-1] == pytest.approx(0.09)


def test_a_limb_that_comes_back_to_the_trunk_is_not_cut_there():
    bow_m = np.array([[0.0, 1, 0], [0.5, 1, 0], [0.5, 1.5, 0], [0.06, 1.5, 0], [0.06, 1.9, 0]])
    plant = plant_of((UP_M, [0.05] * 3, None, 0), (bow_m, [0.02] * 5, 0, 1))
    lost = np.array([False, True])
    begins_m = cut_loose(plant, lost, ~lost).skeleton.points_m[0]
    assert begins_m[1] == pytest.approx(1)
    assert 0 <= begins_m[0] < 0.05


def test_a_branch_of_one_that_has_no_surface_begins_in_the_next_below():
    short_m = np.array([[0.0, 1, 0], [0.03, 1, 0]])
    twig_m = np.array([[0.03, 1, 0], [0.5, 1.2, 0]])
    plant = plant_of((UP_M, [0.05] * 3, None, 0), (short_m, [0.01] * 2, 0, 1), (twig_m, [0.01] * 2, 1, 1))
    lost = np.array([False, False, True])
    pieces = cut_loose(plant, lost, np.array([True, False, False]))
    assert pieces.curve.tolist() == [2]
    assert np.linalg.norm(pieces.skeleton.points_m[0, [0, 2]]) < 0.05


def test_pieces_alone_have_no_forks():
    plant = side_plant()
    lost = np.array([False, True, True, True])
    assert cut_loose(plant, lost, ~lost, alone=True).skeleton.parent_curve.tolist() == [-1, -1, -1]


def test_where_a_piece_leaves_is_found_on_the_surface():
    """The drawn trunk is half as thick as its skeleton states: the piece begins within what is drawn."""
    drawn = build_branch_cage(plant_of((UP_M, [0.025] * 3, None, 0)))
    wood = StandingWood(points_m=drawn.points_m, faces=drawn.faces)
    places_m = np.column_stack([np.linspace(0, 0.06, 13), np.full(13, 1.0), np.zeros(13)])
    outside = wood.find_outside(places_m)
    assert outside.tolist() == (places_m[:, 0] > 0.0251).tolist()
    plant = side_plant()
    lost = np.array([False, True, False, False])
    begins_m = cut_loose(plant, lost, ~lost, wood).skeleton.points_m[0]
    assert begins_m[0] < 0.025


def test_what_stays_inside_is_not_saved():
    inside_m = np.array([[0.0, 1, 0], [0.03, 1, 0]])
    plant = plant_of((UP_M, [0.05] * 3, None, 0), (inside_m, [0.01] * 2, 0, 1))
    lost = np.array([False, True])
    assert cut_loose(plant, lost, ~lost) is None
    assert cut_loose(plant, ~lost & False, ~lost) is None


@pytest.mark.parametrize("seed", [39157])
def test_branches_that_would_cross_are_in_the_surface(seed):
    plant = random_tree(seed)
    cage = build_branch_cage(plant)
    assert len(cage.loose) >= 1
    check = check_cage(cage)
    assert check.clean
    assert check.components == 1 + len(cage.loose)
    assert set(range(len(plant))) == {*cage.curve.tolist(), *(each.curve for each in cage.dropped)}
    for curve in cage.loose:
        assert np.isfinite(cage.points_m[cage.faces[cage.curve == curve]]).all()
        points_m = cage.points_m[np.unique(cage.faces[cage.curve == curve])]
        start_m = plant.points_m[plant.parent_vertex[curve]]
        away_m = np.linalg.norm(points_m - start_m, axis=1)
        thick_m = plant.radius_m[plant.parent_vertex[curve]] + plant.radius_m[plant.branch(curve)].max()
        assert away_m.min() < 4 * thick_m
    again = build_branch_cage(plant)
    np.testing.assert_array_equal(again.points_m, cage.points_m)
