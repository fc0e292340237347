"""Leaves on twigs whose every number is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.branch.foliage.place import YOUNG, FoliageSettings, place_leaves
from usdfoliage.branch.foliage.species import GENERIC, load_species

from tests.support.branch_shapes import arc, plant_of, random_tree

RADIUS_M, LENGTH_M = 0.002, 0.3
EXACT = FoliageSettings(variation=0.0)
SPIRAL = replace(load_species(GENERIC), droop_rad=0.0, bare_internodes=0, shoot_m=10.0, internode_m=0.04)
PAIRS = replace(SPIRAL, leaves_per_node=2, divergence_rad=np.pi / 2)
FEW = settings(max_examples=30)

directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.1)
angles = st.floats(0.1, 3.0)


def twig(direction=(0, 1, 0), length_m=LENGTH_M, radius_m=RADIUS_M):
    unit = np.asarray(direction, float) / np.linalg.norm(direction)
    return plant_of((np.outer([0, 0.3, 1], length_m * unit), radius_m, None, -1)), unit


def place(skeleton, species, how=EXACT, seed=0):
    return place_leaves(skeleton, species, np.random.default_rng(seed), how)


def frames(places):
    """Unit vectors x, y, z (N, 3) each: across the leaf, along it, out of it."""
    matrix = Rotation.from_quat(places.orientation).as_matrix()
    return matrix[:, :, 0], matrix[:, :, 1], matrix[:, :, 2]


def around(points_m, unit):
    """(N,) angles of places about an axis through the origin, and their distance from it."""
    first = np.cross(unit, np.eye(3)[np.argmin(np.abs(unit))])
    first /= np.linalg.norm(first)
    x, y = points_m @ first, points_m @ np.cross(unit, first)
    return np.arctan2(y, x), np.hypot(x, y)


def wrapped(angle):
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


@FEW
@given(direction=directions)
def test_nodes_follow_each_other_at_the_internode_from_the_tip(direction):
    skeleton, unit = twig(direction)
    places = place(skeleton, SPIRAL)
    along_m = places.base_m @ unit
    assert along_m == pytest.approx(LENGTH_M - 0.04 * np.arange(8), abs=1e-9)
    assert list(places.node) == list(range(8))
    assert (places.shoots, places.grown) == (1, 8)


@FEW
@given(direction=directions, divergence=st.floats(0, 2 * np.pi))
def test_leaves_go_around_the_twig_by_the_divergence_and_stand_on_its_bark(direction, divergence):
    skeleton, unit = twig(direction)
    places = place(skeleton, replace(SPIRAL, divergence_rad=divergence))
    turn, distance_m = around(places.base_m, unit)
    assert wrapped(np.diff(turn) - divergence) == pytest.approx(0, abs=1e-6)
    assert distance_m == pytest.approx(RADIUS_M, abs=1e-9)


@pytest.mark.parametrize("each", [2, 3, 6])
def test_leaves_of_a_node_stand_evenly_around_it(each):
    skeleton, unit = twig((1, 2, 3))
    places = place(skeleton, replace(SPIRAL, leaves_per_node=each, divergence_rad=np.pi / each))
    turn, _ = around(places.base_m, unit)
    turn = turn.reshape(-1, each)
    assert wrapped(np.diff(turn, axis=1) - 2 * np.pi / each) == pytest.approx(0, abs=1e-6)
    assert wrapped(np.diff(turn[:, 0]) - np.pi / each) == pytest.approx(0, abs=1e-6)
    assert (np.diff(places.node.reshape(-1, each), axis=1) == 0).all()


def test_opposite_leaves_of_a_level_twig_stand_level_and_upright_in_turn():
    skeleton, _ = twig((1, 0, 0))
    _, y, _ = frames(place(skeleton, PAIRS))
    rise = np.abs(y[:, 1]).reshape(-1, 2)
    assert rise[::2] == pytest.approx(0, abs=1e-9)
    assert rise[1::2] == pytest.approx(np.sin(SPIRAL.petiole_rad))


def test_two_rows_of_a_level_twig_lie_level():
    skeleton, _ = twig((1, 0, 1))
    _, y, z = frames(place(skeleton, replace(SPIRAL, divergence_rad=np.pi)))
    assert y[:, 1] == pytest.approx(0, abs=1e-9)
    assert z[:, 1] == pytest.approx(1)


@FEW
@given(direction=directions, angle=angles)
def test_leaves_stand_at_their_angle_to_the_twig(direction, angle):
    skeleton, unit = twig(direction)
    _, y, _ = frames(place(skeleton, replace(SPIRAL, petiole_rad=angle)))
    assert np.arccos(np.clip(y @ unit, -1, 1)) == pytest.approx(angle, abs=1e-6)


@FEW
@given(angle=st.floats(0.1, 3.0), droop=st.floats(0, 3.0))
def test_leaves_of_an_upright_twig_droop_from_their_angle_and_no_farther_than_down(angle, droop):
    skeleton, unit = twig()
    _, y, _ = frames(place(skeleton, replace(SPIRAL, petiole_rad=angle, droop_rad=droop)))
    assert np.arccos(np.clip(y @ unit, -1, 1)) == pytest.approx(min(angle + droop, np.pi), abs=1e-6)


@FEW
@given(direction=directions, angle=st.floats(0.2, 1.4))
def test_blades_look_up_as_far_as_their_direction_lets_them(direction, angle):
    skeleton, _ = twig(direction)
    x, y, z = frames(place(skeleton, replace(SPIRAL, petiole_rad=angle)))
    assert z[:, 1] == pytest.approx(np.sqrt(1 - y[:, 1] ** 2), abs=1e-6)
    assert np.abs(y[:, 1]).max() > 0.999 or np.abs(x[:, 1]).max() < 1e-6


def test_frames_do_not_turn_about_a_bent_twig():
    bow = plant_of((arc(0.3, 1.5, 40), RADIUS_M, None, -1))  # in the plane of x and y
    places = place(bow, replace(SPIRAL, divergence_rad=0.0))
    assert np.abs(places.base_m[:, 2]) == pytest.approx(RADIUS_M)
    assert len(np.unique(np.sign(places.base_m[:, 2]))) == 1


def test_the_last_leaf_is_young_and_others_have_their_length():
    skeleton, _ = twig(length_m=0.8)
    length_m = place(skeleton, SPIRAL).length_m
    assert length_m[0] == pytest.approx((1 - YOUNG) * SPIRAL.leaf_length_m)
    assert length_m[8:] == pytest.approx(SPIRAL.leaf_length_m, rel=1e-3)
    assert (np.diff(length_m) > 0).all()


def test_the_base_of_a_shoot_is_bare():
    skeleton, unit = twig()
    along_m = place(skeleton, replace(SPIRAL, bare_internodes=3)).base_m @ unit
    assert along_m.min() == pytest.approx(0.14)


def test_leaves_end_at_the_distance_from_the_tip_that_the_species_gives():
    skeleton, unit = twig(length_m=2.0)
    along_m = place(skeleton, replace(SPIRAL, shoot_m=0.2)).base_m @ unit
    assert (along_m.min(), along_m.max()) == (pytest.approx(1.8), pytest.approx(2.0))


def test_thick_wood_is_bare_and_so_is_what_carries_it():
    trunk = ([[0, 0, 0], [0, 0.5, 0], [0, 1, 0]], [0.02, 0.01, 0.0015], None, -1)
    stump = ([[0, 0.5, 0], [0.3, 0.5, 0]], 0.008, 0, 1)
    bud = ([[0, 0.5, 0], [0, 0.5, 0.02]], 0.001, 0, 1)  # ends one centimetre beyond the bark of 1 cm
    shoot = ([[0, 0.5, 0], [-0.2, 0.5, 0]], 0.002, 0, 1)
    places = place(plant_of(trunk, stump, bud, shoot), replace(SPIRAL, twig_radius_m=0.003))
    assert set(places.branch) == {0, 3}
    assert places.base_m[places.branch == 0, 1].min() >= 0.5
    # The first of the shoot lies outside the trunk.
    assert np.abs(places.base_m[places.branch == 3, 0]).min() >= 0.01


def test_a_thick_root_makes_thicker_twigs_carry_leaves():
    trunk = ([[0, 0, 0], [0, 5, 0]], [0.2, 0.1], None, -1)
    branch = ([[0, 4, 0], [1, 4, 0]], 0.009, 0, 0)
    plant = plant_of(trunk, ([[0, 0, 0], [1, 0, 0]], *branch[1:]))
    assert set(place(plant, SPIRAL).branch) == {1}
    assert not len(place(plant, SPIRAL, replace(EXACT, of_root=0.01)))


def test_a_plant_without_twigs_has_no_leaves():
    places = place(twig(radius_m=0.5)[0], SPIRAL, replace(EXACT, of_root=0.0))
    assert (len(places), places.grown, places.shoots) == (0, 0, 0)
    assert places.orientation.shape == (0, 4)


def test_many_leaves_are_thinned_evenly_by_whole_nodes():
    shoots = [(np.array([[0, 0, k], [0, 4.0, k]]), RADIUS_M, None, -1) for k in range(50)]
    plant = plant_of(*shoots)
    every = place(plant, PAIRS)
    assert len(every) == every.grown == 50 * 2 * 101
    some = place(plant, PAIRS, replace(EXACT, max_leaves=1001))
    assert (len(some), some.grown) == (1000, every.grown)
    pairs = some.base_m.reshape(-1, 2, 3)
    assert np.linalg.norm(pairs[:, 0] - pairs[:, 1], axis=1) == pytest.approx(2 * RADIUS_M)
    share = np.bincount(some.branch, minlength=50)
    assert 18 <= share.min() <= share.max() <= 22
    assert 1.7 < some.base_m[:, 1].mean() < 2.3
    assert len(place(plant, PAIRS, replace(EXACT, max_leaves=1))) == 2  # a node is never parted


def test_the_same_seed_places_the_same_leaves():
    plant = random_tree(3)
    species = load_species("maple")
    first, second = (place(plant, species, FoliageSettings(), seed=5) for _ in range(2))
    for name in ("base_m", "orientation", "length_m"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    other = place(plant, species, FoliageSettings(), seed=6)
    assert not np.array_equal(first.orientation, other.orientation)


@FEW
@given(seed=st.integers(0, 10**6), name=st.sampled_from(["maple", "willow", "ash"]))
def test_any_tree_has_leaves_that_are_finite(seed, name):
    plant = random_tree(seed, wild=True)
    places = place(plant, load_species(name), replace(FoliageSettings(), of_root=1.0, max_leaves=500))
    for array in (places.base_m, places.orientation, places.length_m):
        assert np.isfinite(array).all()
    assert np.linalg.norm(places.orientation, axis=1) == pytest.approx(1)
    assert (places.length_m > 0).all()
    assert (places.branch < len(plant)).all()


@pytest.mark.parametrize(
    "bad", [{"max_leaves": 0}, {"variation": -1.0}, {"light": (0.0, 0.0, 0.0)}, {"of_root": np.nan}]
)
def test_settings_that_cannot_be_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        FoliageSettings(**bad)
