"""The surface of branches in one piece, within a number of faces."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.branch.axis_places import axis_exits
from usdfoliage.branch.cage import closed as closed_module
from usdfoliage.branch.cage import join
from usdfoliage.branch.cage.astray import choose_astray, find_afloat
from usdfoliage.branch.cage.build import build_branch_cage, check_cage
from usdfoliage.branch.cage.closed import close_branches
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.twig_choice import TwigChoice
from usdfoliage.branch.cage.twigs import TwigSettings
from usdfoliage.branch.cage.with_twigs import build_with_twigs
from usdfoliage.branch.whole_wood import bare_lengths, measure_wholeness
from usdfoliage.geometry.smooth_mesh import refine_smooth
from usdfoliage.jobs.branches.surfaces import build_surfaces

from tests.support.branch_shapes import off_axis, plant_of, random_tree

UP = np.array([0.0, 1.0, 0.0])
TRUNK = np.linspace(0, 2, 21)[:, None] * UP
SIDE = np.array([[0, 1.0, 0], [0.3, 1.05, 0], [0.6, 1.2, 0]])


def plant(twig_m=0.01, trunk_m=0.05):
    """A trunk of 2 m and a twig of .6 m from its middle, with a twig of its own from its end."""
    end = np.array([SIDE[-1], SIDE[-1] + [0.2, 0.1, 0.1]])
    return plant_of((TRUNK, trunk_m, None, 0), (SIDE, twig_m, 0, 10), (end, twig_m / 2, 1, 2))


def twigs(skeleton, is_twig, coarser=1.0):
    choice = TwigChoice(
        is_twig=np.array(is_twig), gone=np.zeros(len(skeleton), bool), twig_settings=TwigSettings(coarser=coarser)
    )
    return build_with_twigs(skeleton, choice, BranchCageSettings(), axis_exits(skeleton))


def test_coarse_twigs_keep_near_their_axes_in_bends():
    """A twig that winds: with three times fewer rings along straight pieces, not in bends, it stays at its axis."""
    angle = np.linspace(0, 4 * np.pi, 160)
    winding_m = np.stack([0.05 + 0.01 * angle, 1 + 0.03 * np.sin(angle), 0.03 * np.cos(angle) - 0.03], axis=1)
    winding_m = np.concatenate([[[0, 1, 0]], winding_m])
    skeleton = plant_of((TRUNK, 0.05, None, 0), (winding_m, 0.004, 0, 10))
    faces = []
    for coarser in (1.0, 2.0, 3.0):
        cage = twigs(skeleton, [False, True], coarser)
        bare_m = bare_lengths(skeleton, *refine_smooth(cage.points_m, cage.faces, 2))
        assert bare_m[1] < 0.02 * skeleton.lengths_m[1]
        faces.append(len(cage.faces))
    assert faces[0] > faces[1] >= faces[2]


def test_a_twig_is_drawn_out_of_a_face_of_the_trunk():
    skeleton = plant()
    cage = twigs(skeleton, [False, True, True])
    checked = check_cage(cage)
    assert checked.clean
    assert checked.components == 1
    assert not cage.dropped
    assert not cage.loose
    assert (cage.curve == 2).sum() == 13  # four rows of three, and a cap
    points, faces = refine_smooth(cage.points_m, cage.faces, 3)
    points = points[np.unique(faces[np.repeat(cage.curve == 1, 4**3)])]
    apart, along = off_axis(points, SIDE, np.full(3, 0.01))
    middle = (along > 0.15) & (along < 0.5)
    assert np.abs(apart[middle] - 1).max() < 1  # between two rings the surface cuts a bend
    assert along.max() == pytest.approx(np.linalg.norm(np.diff(SIDE, axis=0), axis=1).sum(), abs=0.004)


def test_a_straight_twig_is_round():
    side = np.array([[0, 1.0, 0], [0.6, 1.1, 0]])
    cage = twigs(plant_of((TRUNK, 0.05, None, 0), (side, 0.01, 0, 10)), [False, True])
    points, faces = refine_smooth(cage.points_m, cage.faces, 3)
    points = points[np.unique(faces[np.repeat(cage.curve == 1, 4**3)])]
    apart, along = off_axis(points, side, np.full(2, 0.01))
    off = np.abs(apart[(along > 0.15) & (along < 0.5)] - 1)
    assert np.median(off) < 0.12
    assert off.max() < 0.35  # towards its ends, where rows are long


def test_a_twig_has_its_own_texture_coordinates_from_where_it_leaves():
    cage = twigs(plant(), [False, True, True])
    st_m = cage.st_m[cage.face_st[cage.curve == 1]]
    rows = st_m[st_m[..., 0].min(axis=1) >= 0, :, 1]  # caps are flat about their middle
    assert rows.min() > 0.03  # outside of the trunk, whose radius is 5 cm
    assert rows.max() == pytest.approx(0.64, abs=0.01)


def test_a_twig_without_a_free_face_begins_inside_of_its_parent():
    parts = [(TRUNK, 0.05, None, 0)]
    for turn in np.linspace(0, 2 * np.pi, 30, endpoint=False):
        tip = TRUNK[10] + 0.3 * np.array([np.cos(turn), 0, np.sin(turn)])
        parts.append((np.array([TRUNK[10], tip]), 0.004, 0, 10))
    skeleton = plant_of(*parts)
    closed = close_branches(skeleton, max_faces=900)
    assert check_cage(closed.cage).clean
    assert closed.cage.loose
    assert not find_afloat(closed).any()
    assert len(closed.skeleton) == 31


def test_what_ends_inside_its_parent_is_in_neither_and_what_it_carries_goes_on():
    inside = np.array([[0, 1.0, 0], [0.03, 1.0, 0]])
    outside = np.array([[0.03, 1.0, 0], [0.5, 1.1, 0]])
    skeleton = plant_of((TRUNK, 0.05, None, 0), (inside, 0.02, 0, 10), (outside, 0.01, 1, 1))
    for max_faces in (None, 150):
        closed = close_branches(skeleton, max_faces=max_faces)
        assert closed.left_out in ({DropReason.TOO_SHORT: 1}, {DropReason.COVERED: 1})
        assert closed.number.tolist() == [0, -1, 1]
        assert closed.skeleton.parent_curve.tolist() == [-1, 0]
        assert set(closed.cage.curve.tolist()) == {0, 1}
        assert closed.cage.order.max() == 1


def test_a_twig_that_goes_on_from_elsewhere_keeps_its_place_along_its_axis():
    inside = np.array([[0, 1.0, 0], [0.03, 1.0, 0]])
    outside = np.array([[0.03, 1.0, 0], [0.5, 1.1, 0]])
    skeleton = plant_of((TRUNK, 0.05, None, 0), (inside, 0.02, 0, 10), (outside, 0.01, 1, 1))
    closed = close_branches(skeleton, max_faces=80)
    assert closed.is_twig.tolist() == [False, True]
    st_m = closed.cage.st_m[closed.cage.face_st[closed.cage.curve == 1]]
    rows = st_m[st_m[..., 0].min(axis=1) >= 0, :, 1]
    assert rows.max() == pytest.approx(closed.skeleton.lengths_m[1])
    assert (rows > 0.03).all()


def test_the_surfaces_of_lower_orders_are_as_lean_as_the_whole():
    tree = random_tree(32, 20)
    closed = close_branches(tree, max_faces=700)
    assert closed.settings.lean
    made = build_surfaces(tree, 700)
    assert len(made.surfaces.whole.faces) <= 700
    (_, first), *_ = made.surfaces.by_order
    assert (first.order <= 1).all()
    assert len(first.faces) <= (made.surfaces.whole.order <= 1).sum() + 13  # a face for each twig that left there


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), wild=st.booleans(), each=st.sampled_from([None, 60, 30, 20]))
def test_the_surface_of_any_tree_is_closed_and_that_of_its_skeleton(seed, wild, each):
    tree = random_tree(seed, 20, wild)
    max_faces = None if each is None else max(each * len(tree), 400)
    closed = close_branches(tree, max_faces=max_faces)
    cage = closed.cage
    assert check_cage(cage).clean
    assert not find_afloat(closed).any()
    assert sorted(set(cage.curve.tolist())) == list(range(len(closed.skeleton)))
    assert np.array_equal(cage.order, closed.skeleton.order[cage.curve])
    assert len(tree) - len(closed.skeleton) == sum(closed.left_out.values())
    assert max_faces is None or len(cage.faces) <= max_faces or len(closed.skeleton) == 1
    found = measure_wholeness(closed.skeleton, *refine_smooth(cage.points_m, cage.faces, 2))
    assert found.bare < 0.25 if wild else found.bare < 0.05


def test_fewer_faces_leave_the_thick_branches_joined():
    tree = random_tree(32, 20)
    assert len(tree) > 10
    whole = close_branches(tree)
    few = close_branches(tree, max_faces=len(whole.cage.faces) // 2)
    assert len(few.cage.faces) <= len(whole.cage.faces) // 2
    assert few.thickest_twig_m > 0 or few.left_out


def test_long_branches_stay_as_far_as_there_are_faces_for_them():
    """Thick branches have more faces each than the thin tips that are left out before them."""
    around = np.linspace(0, 40, 72)
    directions = np.stack([np.cos(around), np.full(72, 0.2), np.sin(around)], axis=1)
    parts = [(TRUNK, 0.05, None, 0)]
    for number, direction in enumerate(directions[:60]):
        start = 3 + number % 14
        parts.append((TRUNK[start] + np.outer([0, 0.3], direction), 0.002, 0, start))
    for number, direction in enumerate(directions[60:]):
        start = 4 + number
        zigzag_m = TRUNK[start] + np.outer(np.linspace(0, 2, 60), direction)
        zigzag_m[1:, 1] += 0.06 * (-1.0) ** np.arange(59)
        parts.append((zigzag_m, 0.004, 0, start))
    skeleton = plant_of(*parts)
    closed = close_branches(skeleton, max_faces=3000)
    assert 1500 < len(closed.cage.faces) <= 3000
    assert (np.flatnonzero(closed.number >= 0)[1:] > 60).all()
    assert len(closed.skeleton) > 3


def test_less_is_joined_where_what_is_drawn_otherwise_takes_too_many_faces(monkeypatch):
    tree, asked = random_tree(3, 20), []
    whole = close_branches(tree)

    def redraw(skeleton, closed, choice, settings, exits):
        asked.append(len(closed.cage.faces))
        return whole if len(asked) == 1 else closed

    monkeypatch.setattr(closed_module, "_redraw_astray", redraw)
    max_faces = len(whole.cage.faces) - 100
    closed = close_branches(tree, max_faces=max_faces)
    assert len(asked) == 2
    assert len(closed.cage.faces) == asked[1] <= max_faces - 100


def test_a_fork_beside_a_twig_is_as_large_as_without_it():
    """Of three forks of a trunk that crossed each other, one is a twig's."""
    skeleton = random_tree(7, 20, True)
    exits, none = axis_exits(skeleton), np.zeros(len(skeleton), bool)
    choice = TwigChoice(is_twig=none, gone=none, twig_settings=TwigSettings())
    joined = build_with_twigs(skeleton, choice, BranchCageSettings(), exits)
    assert joined.tries is not None
    assert (joined.tries[[1, 2, 14]] > 0).all()
    is_twig = none.copy()
    for branch, parent in enumerate(skeleton.parent_curve.tolist()):  # parents first
        is_twig[branch] = branch == 2 or (parent >= 0 and is_twig[parent])
    free, later = (
        build_with_twigs(skeleton, replace(choice, is_twig=is_twig, tried=tried), BranchCageSettings(), exits)
        for tried in (None, joined.tries)
    )
    assert free.tries is not None
    assert later.tries is not None
    assert np.array_equal(free.tries, later.tries)
    assert np.array_equal(free.points_m, later.points_m)
    assert later.tries[1] < joined.tries[1]


def test_the_same_tree_gives_the_same_surface():
    one, two = (close_branches(random_tree(7, 20), max_faces=700) for _ in range(2))
    assert np.array_equal(one.cage.points_m, two.cage.points_m)
    assert np.array_equal(one.cage.faces, two.cage.faces)


def test_a_cage_that_knows_the_tries_of_the_former_is_whole_at_once(monkeypatch):
    built = []
    whole = join.build_paths
    monkeypatch.setattr(join, "build_paths", lambda paths, *rest: built.append(len(paths)) or whole(paths, *rest))
    tree = random_tree(36, 40)
    first = build_branch_cage(tree)
    assert first.tries is not None
    assert first.tries.max() > 0
    times, built[:] = len(built), []
    again = build_branch_cage(tree, tried=first.tries)
    assert len(built) < times
    assert check_cage(again).clean
    assert [each.curve for each in again.dropped] == [each.curve for each in first.dropped]
    assert len(again.faces) == pytest.approx(len(first.faces), rel=0.05)


def test_of_what_is_afloat_only_the_branches_that_are_asked_for_are_found():
    axes = [np.array([[1, 1.0, 0], [1.5, 1.1, 0]]), np.array([[1, 1.3, 0], [1.5, 1.4, 0]])]
    skeleton = plant_of((TRUNK, 0.05, None, 0), *((np.concatenate([TRUNK[10:11], each]), 0.01, 0, 10) for each in axes))
    closed = close_branches(plant_of((TRUNK, 0.05, None, 0)))
    parts = [build_branch_cage(plant_of((each, 0.01, None, 0))) for each in axes]
    points_m, faces, curve = [closed.cage.points_m], [closed.cage.faces], [closed.cage.curve]
    for number, part in enumerate(parts, 1):
        faces.append(part.faces + sum(map(len, points_m)))
        points_m.append(part.points_m)
        curve.append(np.full(len(part.faces), number))
    cage = replace(
        closed.cage, points_m=np.concatenate(points_m), faces=np.concatenate(faces), curve=np.concatenate(curve)
    )
    torn = replace(closed, skeleton=skeleton, cage=cage)
    assert find_afloat(torn).tolist() == [False, True, True]
    assert find_afloat(torn, np.array([True, False, True])).tolist() == [False, False, True]


def test_the_worst_of_what_is_bare_is_drawn_otherwise():
    allowed_each_m = np.full(4, 0.1)
    assert choose_astray(np.array([0.2, 0, 0.005, 0.02]), allowed_each_m, 0.03).tolist() == [True, False, False, False]
    assert choose_astray(np.array([0.2, 0, 0.005, 0.02]), allowed_each_m, 0.02).tolist() == [True, False, False, True]


@given(
    st.lists(st.tuples(st.floats(0, 1), st.floats(0.001, 0.5)), min_size=1, max_size=30),
    st.floats(0, 2),
)
def test_no_more_stays_bare_than_is_allowed(branches, allowed_m):
    bare_m, allowed_each_m = np.array(branches).T
    astray = choose_astray(bare_m, allowed_each_m, allowed_m)
    assert bare_m[~astray].sum() <= allowed_m * (1 + 1e-9)
    assert not astray[bare_m == 0].any()
