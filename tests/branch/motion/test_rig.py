"""Joints of branches, and what follows them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.branch.axis_places import axis_exits
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.motion.rig import RigSettings, build_rig, skin_places
from usdfoliage.branch.motion.skinning import pose_joints, skin_points
from usdfoliage.branch.motion.surface_places import cage_places

from tests.support.branch_shapes import fork, random_tree


def weight_of(rig, skin, joint):
    """(P,) how much places follow a joint."""
    return np.where(skin.joints == joint, skin.weights, 0).sum(axis=1)


def test_a_joint_stands_where_its_branch_springs_and_points_along_it():
    rig = build_rig(fork())
    assert list(rig.curve) == [0, 1, 2]
    assert list(rig.parent) == [-1, 0, 1]
    assert rig.origin_m == pytest.approx(np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0]]), abs=1e-12)
    along = np.array([[0, 1, 0], [1, 0, 0], [np.sqrt(0.5), 0, np.sqrt(0.5)]])
    assert rig.axes[:, :, 1] == pytest.approx(along, abs=1e-12)


@given(seed=st.integers(0, 10_000), order=st.integers(0, 3))
@settings(max_examples=30)
def test_the_product_of_the_rest_transforms_is_the_bind_transform(seed, order):
    plant = random_tree(seed)
    rig = build_rig(plant, RigSettings(order=order))
    assert list(rig.curve) == np.flatnonzero(plant.order <= order).tolist()
    assert (rig.parent < np.arange(len(rig))).all()
    bind = rig.bind
    assert bind[:, :3, :3] @ bind[:, :3, :3].transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (len(rig), 1, 1)))
    assert np.linalg.det(bind) == pytest.approx(1)
    assert pose_joints(rig, np.zeros((len(rig), 3))) == pytest.approx(bind, abs=1e-9)


def test_a_branch_that_points_down_has_a_frame():
    rig = build_rig(fork(180))
    assert rig.axes[1][:, 1] == pytest.approx([0, -1, 0], abs=1e-12)
    assert np.linalg.det(rig.axes[1]) == pytest.approx(1)


def test_a_branch_goes_over_from_its_parent_to_itself():
    plant = fork()
    rig = build_rig(plant)
    leaves_m, blend_m = rig.leaves_m[1], rig.blend_m[1]
    assert leaves_m == pytest.approx(0.05)
    assert blend_m == pytest.approx(0.2)  # four radii of the trunk
    arc_m = np.array([0, leaves_m, leaves_m + blend_m / 2, leaves_m + blend_m, 0.9])
    skin = skin_places(rig, np.full(5, 1), arc_m)
    assert weight_of(rig, skin, 1) == pytest.approx([0, 0, 0.5, 1, 1])
    assert weight_of(rig, skin, 0) == pytest.approx([1, 1, 0.5, 0, 0])
    trunk = skin_places(rig, np.zeros(3, int), np.array([0.0, 0.01, 2]))
    assert weight_of(rig, trunk, 0) == pytest.approx([1, 1, 1])


def test_beyond_the_last_order_a_branch_follows_the_place_that_it_springs_from():
    plant = fork()
    one = build_rig(plant, RigSettings(order=1))
    assert weight_of(one, skin_places(one, np.full(3, 2), np.array([0, 0.1, 0.7])), 1) == pytest.approx([1, 1, 1])
    none = build_rig(plant, RigSettings(order=0))
    assert len(none) == 1
    skin = skin_places(none, np.array([0, 1, 2]), np.full(3, 0.5))
    assert skin.joints.tolist() == [[0], [0], [0]]
    assert skin.weights.tolist() == [[1], [1], [1]]


@given(seed=st.integers(0, 10_000), order=st.integers(0, 3))
@settings(max_examples=30)
def test_weights_are_whole_and_have_no_steps(seed, order):
    plant = random_tree(seed)
    exits = axis_exits(plant)
    rig = build_rig(plant, RigSettings(order=order), exits)
    share = np.linspace(0, 1, 400)
    for number in range(len(plant)):
        skin = skin_places(rig, np.full(400, number), share * plant.lengths_m[number])
        assert (skin.weights.sum(axis=1) == 1).all()
        assert (skin.weights >= 0).all()
        assert (np.diff(skin.weights, axis=1) <= 0).all()
        step_m = plant.lengths_m[number] / 399
        for joint in np.unique(skin.joints):
            change = np.abs(np.diff(weight_of(rig, skin, joint)))
            assert (change <= 1.5 * step_m / rig.blend_m[number] + 3 / 512).all()
        if exits.curve[number] >= 0:  # it begins with the weights of the place that it comes out of
            spring = skin_places(rig, exits.curve[[number]], exits.parent_arc_m[[number]])
            for joint in range(len(rig)):
                assert weight_of(rig, spring, joint) == pytest.approx(weight_of(rig, skin, joint)[:1])


def test_what_is_not_drawn_has_no_joint_and_what_it_carries_springs_from_its_parent():
    plant = fork()
    assert list(build_rig(plant, drawn=np.array([True, True, False])).curve) == [0, 1]
    assert list(build_rig(plant, drawn=np.zeros(3, bool)).curve) == [0]  # a root has one always
    rig = build_rig(plant, drawn=np.array([True, False, True]))
    assert list(rig.curve) == [0, 2]
    assert list(rig.parent) == [-1, 0]
    assert rig.rest[1, :3, 3] == pytest.approx([1, 1, 0])
    skin = skin_places(rig, np.array([1, 2, 2]), np.array([0.9, 0.0, 0.7]))
    assert weight_of(rig, skin, 0) == pytest.approx([1, 1, 0])
    assert weight_of(rig, skin, 1) == pytest.approx([0, 0, 1])


@pytest.mark.parametrize("bad", [{"order": -1}, {"blend_radii": -1.0}, {"blend_share": 2.0}, {"max_share": 0.0}])
def test_settings_that_cannot_be_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        RigSettings(**bad)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=10)
def test_at_rest_a_surface_stays(seed):
    plant = random_tree(seed, max_branches=6)
    cage = build_branch_cage(plant)
    places = cage_places(cage, plant)
    rig = build_rig(plant)
    skin = skin_places(rig, places.curve, places.arc_m)
    posed = pose_joints(rig, np.zeros((len(rig), 3)))
    assert skin_points(rig, skin, cage.points_m, posed) == pytest.approx(cage.points_m, abs=1e-9)


@pytest.mark.parametrize("angle_rad", [0.3, -1.0])
def test_a_branch_turns_about_where_it_springs_with_all_that_it_carries(angle_rad):
    plant = fork()
    cage = build_branch_cage(plant)
    places = cage_places(cage, plant)
    rig = build_rig(plant)
    skin = skin_places(rig, places.curve, places.arc_m)
    turn_rad = np.zeros((3, 3))
    turn_rad[1] = rig.axes[1].T @ [0, 0, angle_rad]  # about the asset's z
    there_m = skin_points(rig, skin, cage.points_m, pose_joints(rig, turn_rad))
    turned = Rotation.from_rotvec([0, 0, angle_rad]).as_matrix()
    expected_m = [0, 1, 0] + (cage.points_m - [0, 1, 0]) @ turned.T
    own = (places.curve == 2) | ((places.curve == 1) & (places.arc_m > rig.leaves_m[1] + rig.blend_m[1]))
    assert own.sum() > 20
    assert there_m[own] == pytest.approx(expected_m[own], abs=1e-12)
    assert there_m[places.curve == 0] == pytest.approx(cage.points_m[places.curve == 0], abs=1e-12)
