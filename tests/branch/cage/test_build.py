"""Cages of single branches, whose limit surface is known."""

import numpy as np
import pytest
from usdfoliage.branch.cage.build import build_branch_cage, check_cage
from usdfoliage.branch.cage.settings import BranchCageSettings

from tests.support.branch_shapes import arc, fork, limit, off_axis, plant_of, volume

UP = np.array([0.0, 1.0, 0.0])


def straight(count=2, length_m=2.0):
    return np.linspace(0, length_m, count)[:, None] * UP


@pytest.mark.parametrize("count", [2, 9, 400])
def test_a_cylinder_is_met_to_a_percent(count):
    axis = straight(count)
    cage = build_branch_cage(plant_of((axis, 0.05, None, 0)))
    points, quads = limit(cage)
    apart, along = off_axis(points, axis, np.full(count, 0.05))
    inside = (along > 0.1) & (along < 1.9)
    assert np.abs(apart[inside] - 1).max() < 0.01
    assert volume(points, quads) == pytest.approx(np.pi * 0.05**2 * 2, rel=0.02)
    assert check_cage(cage).clean
    assert check_cage(cage).components == 1


def test_the_ends_are_where_the_branch_ends():
    points, _ = limit(build_branch_cage(plant_of((straight(), 0.05, None, 0))))
    assert points[:, 1].min() == pytest.approx(0, abs=0.005)
    assert points[:, 1].max() == pytest.approx(2, abs=0.02)
    assert np.linalg.norm(points[:, [0, 2]], axis=1).max() < 0.05 * 1.03  # nothing stands out at the caps


@pytest.mark.parametrize(("bend_m", "count"), [(0.5, 100), (0.5, 1000), (2.0, 100), (0.25, 100)])
def test_a_bent_branch_is_met_to_a_percent(bend_m, count):
    axis = arc(bend_m, 1.5, count)
    points, _ = limit(build_branch_cage(plant_of((axis, 0.05, None, 0))))
    apart, along = off_axis(points, axis, np.full(count, 0.05))
    inside = (along > 0.1) & (along < 1.5 * bend_m - 0.1)
    assert np.abs(apart[inside] - 1).max() < 0.01


def test_corners_of_a_coarse_axis_are_rounded_off_by_little():
    axis = arc(0.5, 1.5, 10)
    points, _ = limit(build_branch_cage(plant_of((axis, 0.05, None, 0))))
    apart, along = off_axis(points, axis, np.full(10, 0.05))
    inside = (along > 0.1) & (along < 0.65)
    assert np.abs(apart[inside] - 1).max() < 0.02


def test_a_cone_is_met_to_a_percent():
    axis = straight(2)
    points, quads = limit(build_branch_cage(plant_of((axis, [0.1, 0.02], None, 0))))
    apart, along = off_axis(points, axis, np.array([0.1, 0.02]))
    inside = (along > 0.2) & (along < 1.9)
    assert np.abs(apart[inside] - 1).max() < 0.01
    assert volume(points, quads) == pytest.approx(np.pi * 2 / 3 * (0.1**2 + 0.1 * 0.02 + 0.02**2), rel=0.02)


@pytest.mark.parametrize("angle_deg", [60, 100, 140, 175])
def test_a_sharp_bend_stays_a_tube(angle_deg):
    turn = np.radians(angle_deg)
    axis = np.array([[0, 0, 0], [0, 1, 0], [np.sin(turn), 1 + np.cos(turn), 0]])
    cage = build_branch_cage(plant_of((axis, 0.05, None, 0)))
    assert check_cage(cage).clean
    assert cage.dropped == ()
    points, _ = limit(cage)
    assert off_axis(points, axis, np.full(3, 0.05))[0].max() < 1.6


def test_texture_coordinates_are_metres():
    cage = build_branch_cage(fork(60))
    for branch, radius in ((0, 0.05), (1, 0.03), (2, 0.015)):
        own = cage.curve == branch
        corners, st = cage.points_m[cage.faces[own]], cage.st_m[cage.face_st[own]]
        s_m = np.abs(np.diff(st, axis=1, append=st[:, :1])[..., 0])
        along = np.linalg.norm(np.diff(corners, axis=1, append=corners[:, :1]), axis=2)
        t_m = np.abs(np.diff(st, axis=1, append=st[:, :1])[..., 1])
        free = (s_m < 1e-9) & (t_m > 3 * radius)  # edges that run along the branch, away from forks and bends
        assert free.any()
        np.testing.assert_allclose(t_m[free], along[free], rtol=0.05)
        assert st[..., 1].max() == pytest.approx([2.0, 1.0, np.sqrt(0.5)][branch], abs=2.5 * radius)
        row = np.sort(s_m, axis=1)[:, -1]
        assert np.median(row) == pytest.approx(2 * np.pi * radius / 6, rel=0.2)


def test_texture_coordinates_are_continuous_but_at_the_seam():
    cage = build_branch_cage(fork(60))
    jumps = {}
    for face, st, curve in zip(cage.faces, cage.face_st, cage.curve, strict=True):
        for vertex, index in zip(face.tolist(), st.tolist(), strict=True):
            jumps.setdefault((vertex, int(curve)), set()).add(index)
    several = [key for key, used in jumps.items() if len(used) > 1]
    for vertex, curve in several:
        values = cage.st_m[sorted(jumps[vertex, curve])]
        s = np.sort(values[:, 0])
        girth = 2 * np.pi * [0.05, 0.03, 0.015][curve]
        seam = len(values) == 2 and s[1] - s[0] == pytest.approx(girth)
        cap = np.abs(values).max(axis=1).min() < 0.07  # of a cap, which is flat about its own middle
        assert seam or cap
    assert len(several) < 0.45 * len(cage.points_m)


def test_the_same_skeleton_gives_the_same_cage():
    one, two = build_branch_cage(fork(45)), build_branch_cage(fork(45))
    for name in ("points_m", "faces", "st_m", "face_st", "curve", "order", "fork_faces", "fork_counts"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_a_cage_does_not_depend_on_size():
    small, plant = build_branch_cage(fork(45)), fork(45)
    large = build_branch_cage(
        type(plant)(
            points_m=plant.points_m * 64,
            radius_m=plant.radius_m * 64,
            counts=plant.counts,
            parent_curve=plant.parent_curve,
            parent_vertex=plant.parent_vertex,
            order=plant.order,
        )
    )
    np.testing.assert_array_equal(large.faces, small.faces)
    np.testing.assert_allclose(large.points_m, small.points_m * 64, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("wrong", [{"axis_tolerance": 0}, {"longest_row": 0.5}, {"clearance": -1}])
def test_settings_are_checked(wrong):
    with pytest.raises(ValueError, match="not"):
        BranchCageSettings(**wrong)


def test_several_plants_are_several_components():
    cage = build_branch_cage(plant_of((straight(), 0.05, None, 0), (straight() + np.array([1, 0, 0]), 0.02, None, 0)))
    assert check_cage(cage).clean
    assert check_cage(cage).components == 2
