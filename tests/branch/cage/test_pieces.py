"""Branches that cannot be joined: they begin beside what they spring from, and nothing that they carry is lost."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from usdfoliage.branch.cage.build import build_branch_cage, check_cage
from usdfoliage.branch.cage.pieces import _NEAREST, _segments_near, cut_loose
from usdfoliage.branch.distances import sample_axes

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


def test_a_piece_begins_a_hair_outside_of_what_it_springs_from():
    plant = side_plant()
    lost = np.array([False, True, True, True])
    pieces = cut_loose(plant, lost, ~lost)
    assert pieces.curve.tolist() == [1, 2, 3]
    assert pieces.skeleton.parent_curve.tolist() == [-1, 0, -1]  # what left from the part inside is a piece as well
    begins_m = pieces.skeleton.points_m[pieces.skeleton.first]
    # A ring that stands along the trunk's bark is clear of it from 5 cm and a tenth of the arm on.
    assert 0.052 <= begins_m[0, 0] <= 0.052 + 0.25 * 0.02
    assert np.linalg.norm(begins_m[2, [0, 2]]) >= 0.05
    np.testing.assert_allclose(pieces.skeleton.points_m[pieces.skeleton.parent_vertex[1]], [0.8, 1, 0])
    assert pieces.skeleton.order.tolist() == [0, 1, 0]


def test_a_limb_that_comes_back_to_the_trunk_is_not_cut_there():
    bow_m = np.array([[0.0, 1, 0], [0.5, 1, 0], [0.5, 1.5, 0], [0.06, 1.5, 0], [0.06, 1.9, 0]])
    plant = plant_of((UP_M, [0.05] * 3, None, 0), (bow_m, [0.02] * 5, 0, 1))
    lost = np.array([False, True])
    begins_m = cut_loose(plant, lost, ~lost).skeleton.points_m[0]
    assert begins_m[1] == pytest.approx(1)
    assert 0.05 < begins_m[0] < 0.08


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
        points_m = cage.points_m[np.unique(cage.faces[cage.curve == curve])]
        start_m = plant.points_m[plant.parent_vertex[curve]]
        away_m = np.linalg.norm(points_m - start_m, axis=1)
        thick_m = plant.radius_m[plant.parent_vertex[curve]] + plant.radius_m[plant.branch(curve)].max()
        assert away_m.min() < 4 * thick_m
    again = build_branch_cage(plant)
    np.testing.assert_array_equal(again.points_m, cage.points_m)


@pytest.mark.parametrize("seed", range(6))
def test_the_segments_near_some_places_hold_the_nearest_places(seed):
    plant = random_tree(seed, max_branches=14)
    step_m = 0.01
    places_m = plant.points_m[-1] + np.random.default_rng(seed).normal(size=(30, 3)) * 0.1
    near = _segments_near(plant, list(range(len(plant))), places_m, step_m)
    distance_m = [cKDTree(sample_axes(axes, step_m)[0]).query(places_m, k=_NEAREST)[0] for axes in (plant, near)]
    np.testing.assert_allclose(distance_m[1], distance_m[0], rtol=1e-12)


def test_few_segments_are_near_a_twig():
    plant = random_tree(2, max_branches=14)
    near = _segments_near(plant, list(range(len(plant))), plant.points_m[-1:], 0.01)
    assert len(near) < 0.5 * (plant.counts - 1).sum()
