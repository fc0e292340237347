"""Forks of a cage that are tried with what is near them, and axes that stay where they are."""

import numpy as np
import pytest
from usdfoliage.branch.cage.bending import ease_bends
from usdfoliage.branch.cage.exits import find_exits
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.settle import ATTEMPTS, TOGETHER, find_beside, settle, take_around
from usdfoliage.branch.cage.tubes import arcs_along, find_paths, pack_paths

from tests.support.branch_shapes import plant_of, random_tree

TRUNK = np.linspace([0.0, 0, 0], [0, 8, 0], 81)
HEIGHTS = (1.0, 1.2, 3.0, 6.0)


def tall_plant():
    """A trunk with four branches, of which the first two are close together; the second one carries a twig."""
    sides = [
        (TRUNK[round(10 * height)] + [[0, 0, 0], [0.5, 0.25, 0], [1, 0.5, 0]], 0.02, 0, round(10 * height))
        for height in HEIGHTS
    ]
    twig = (np.array([[0.5, 1.45, 0], [1, 1.45, 0.5]]), 0.005, 2, 1)
    return plant_of((TRUNK, 0.05, None, 0), *sides, twig)


def exits_of(plant):
    paths, _ = find_paths(plant)
    tubes = pack_paths(paths)
    return paths, tubes, find_exits(tubes, np.flatnonzero(tubes.parent >= 0), np.full((tubes.parent >= 0).sum(), 0.2))


@pytest.mark.parametrize("seed", range(8))
def test_beside_a_fork_is_what_leaves_the_same_parent_nearby(seed):
    _, tubes, exits = exits_of(random_tree(seed, max_branches=14))
    forks = np.random.default_rng(seed).choice(len(exits.tube), len(exits.tube) // 3, replace=False)
    apart = np.abs(exits.hole_arc_m[:, None] - exits.hole_arc_m[forks])
    near = (exits.parent[:, None] == exits.parent[forks]) & (apart <= TOGETHER * exits.parent_radius_m[forks])
    np.testing.assert_array_equal(find_beside(tubes, exits, forks), near.any(axis=1))


def test_a_fork_is_taken_with_its_parent_and_the_siblings_nearby():
    plant = tall_plant()
    paths, tubes, exits = exits_of(plant)
    taken = take_around(paths, tubes, exits, np.array([0]))
    first = [plant.points_m[plant.first[branch]] for branch in (0, 1, 2)]
    np.testing.assert_array_equal([path.points_m[0] for path in taken], first)
    assert [path.parent for path in taken] == [-1, 0, 0]
    assert [path.pieces[0][0] for path in taken] == [0, 1, 2]


def test_a_parent_that_is_taken_alone_begins_where_it_is_clear():
    paths, tubes, exits = exits_of(tall_plant())
    twig = int(np.flatnonzero(tubes.parent[exits.tube] > 0)[0])
    parent, child = take_around(paths, tubes, exits, np.array([twig]))
    whole = paths[tubes.parent[exits.tube[twig]]]
    cut_m = arcs_along(whole.points_m)[-1] - arcs_along(parent.points_m)[-1]
    assert 0.03 < cut_m < 0.2
    assert child.parent_arc_m == pytest.approx(paths[exits.tube[twig]].parent_arc_m - cut_m)
    assert parent.pieces[0][1] == pytest.approx(-cut_m)
    assert parent.parent == -1


def test_what_may_not_move_stays():
    plant = random_tree(5, max_branches=14)
    moved, fixed = find_paths(plant)[0], find_paths(plant)[0]
    for paths in (moved, fixed):
        ease_bends(paths)
    before = [path.points_m for path in fixed]
    tries = np.zeros(len(plant), np.int64)
    settle(moved, tries, BranchCageSettings(), {})
    settle(fixed, tries, BranchCageSettings(), {}, np.zeros(len(plant), bool))
    assert all(np.array_equal(path.points_m, points) for path, points in zip(fixed, before, strict=True))
    assert not all(np.array_equal(path.points_m, points) for path, points in zip(moved, before, strict=True))


def test_an_axis_that_changed_is_eased_again():
    paths = find_paths(tall_plant())[0]
    ease_bends(paths)
    assert all(path.eased for path in paths)
    straight = len(paths[0].points_m)
    zigzag = paths[0].points_m.copy()
    zigzag[1::2, 0] += 0.2
    paths[0].points_m, paths[0].eased = zigzag, False
    ease_bends(paths)
    assert len(paths[0].points_m) < straight


def test_a_branch_that_would_move_too_far_leaves_no_hole():
    """Twelve at one place: there is room for six of them round the trunk at the most."""
    twig = np.array([[0, 1.0, 0], [0.6, 1.0, 0]])
    plant = plant_of((TRUNK, 0.05, None, 0), *(((twig, 0.02, 0, 10),) * 12))
    for farthest in (np.inf, 1.5):
        paths, tries = find_paths(plant)[0], np.zeros(len(plant), np.int64)
        ease_bends(paths)
        exits, _, holes = settle(paths, tries, BranchCageSettings(farthest=farthest), {})
        moved_m = np.array([np.linalg.norm(paths[exits.tube[each]].points_m[0] - twig[0]) for each in holes.exit])
        if farthest == np.inf:
            assert len(holes.exit) == 12
            assert moved_m.max() > 0.1
        else:
            assert 0 < len(holes.exit) <= 6
            assert moved_m.max() <= farthest * 0.02 + 1e-9
            assert (tries == ATTEMPTS).sum() == 12 - len(holes.exit)
