"""Twigs on a parent whose surface is not where its axis is."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.branch.axis_places import axis_exits
from usdfoliage.branch.cage.build import build_branch_cage, check_cage
from usdfoliage.branch.cage.twigs import draw_twigs

from tests.support.branch_shapes import plant_of

TRUNK = np.array([[0, 0.1 * k, 0] for k in range(21)])


@pytest.mark.parametrize("aside_m", [0.0, 0.1])
def test_a_piece_begins_in_the_surface_of_its_parent(aside_m):
    """Of the twelve twigs at one place some find no face to leave by."""
    twigs = [np.array([[0, 1.0, 0], [0.6 * np.cos(turn), 1.0, 0.6 * np.sin(turn)]]) for turn in np.arange(12) / 1.9]
    plant = plant_of((TRUNK, 0.05, None, 0), *((each, 0.004, 0, 10) for each in twigs))
    is_twig = np.arange(13) > 0
    cage = build_branch_cage(plant.only(~is_twig))
    drawn = draw_twigs(
        plant, is_twig, replace(cage, points_m=cage.points_m + np.array([0, 0, aside_m]), loose=()), axis_exits(plant)
    )
    assert drawn.loose
    assert check_cage(drawn).clean
    for number in drawn.loose:
        own_m = drawn.points_m[np.unique(drawn.faces[drawn.curve == number])]
        from_axis_m = np.hypot(own_m[:, 0], own_m[:, 2] - aside_m)
        assert from_axis_m.min() < 0.01


def test_where_nothing_is_joined_every_branch_is_a_piece_of_its_own():
    plant = plant_of((TRUNK, 0.05, None, 0), (np.array([[0, 1.0, 0], [0.6, 1.2, 0]]), 0.02, 0, 10))
    cage = build_branch_cage(plant)
    nothing = replace(
        cage,
        points_m=np.zeros((0, 3)),
        st_m=np.zeros((0, 2)),
        ring=np.zeros(0, np.int32),
        curve=np.zeros(0, np.int32),
        order=np.zeros(0, np.int32),
        faces=np.zeros((0, 4), np.int32),
        face_st=np.zeros((0, 4), np.int32),
        fork_faces=np.zeros(0, np.int32),
        fork_counts=np.zeros(0, np.int32),
        fork_curve=np.zeros(0, np.int32),
        loose=(),
    )
    drawn = draw_twigs(plant, np.ones(2, bool), nothing, axis_exits(plant))
    assert set(drawn.curve) == {0, 1}
    assert 0 in drawn.loose
    assert check_cage(drawn).clean
    trunk_m = drawn.points_m[np.unique(drawn.faces[drawn.curve == 0])]
    np.testing.assert_allclose(np.ptp(trunk_m[:, 1]), 2, rtol=0.05)
