"""Leaves that go with their twigs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.branch.axis_places import find_places, places_at
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.motion.growth_stages import carry_points, plan_stages
from usdfoliage.branch.motion.leaf_motion import UNBORN, UnfoldSettings, carry_leaves, sway_leaves, unfold_leaves
from usdfoliage.branch.motion.rig import RigSettings, Skin, build_rig, skin_places
from usdfoliage.branch.motion.skinning import pose_joints, skin_points

from tests.support.branch_clouds import small_tree
from tests.support.branch_motions import leaves_on
from tests.support.branch_shapes import fork, plant_of, random_tree

LEAF = np.array([[0.0, 0.0, 0.0, 1.0]])


def carried(plant, curve, arc_m, base_m):
    places = places_at(plant, np.asarray(curve), np.asarray(arc_m, float))
    return carry_points(build_branch_cage(plant), plant, np.asarray(base_m, float), places)


def test_a_leaf_turns_with_the_joint_of_its_twig():
    plant = fork()  # its branch goes along x from (0, 1, 0)
    rig = build_rig(plant)
    skin = skin_places(rig, np.array([1]), np.array([0.8]))
    turn = Rotation.from_rotvec([0, 0, np.pi / 2])
    posed = pose_joints(rig, np.array([[0, 0, 0], rig.axes[1].T @ turn.as_rotvec(), [0, 0, 0]]))
    base_m, orientation = sway_leaves(rig, skin, np.array([[0.8, 1.03, 0]]), LEAF, posed)
    assert base_m == pytest.approx(np.array([[-0.03, 1.8, 0]]))
    assert Rotation.from_quat(orientation[0]).apply([0, 1, 0]) == pytest.approx([-1, 0, 0])


def test_between_two_joints_a_leaf_turns_by_half():
    plant = fork()
    rig = build_rig(plant)
    halfway = rig.leaves_m[1] + rig.blend_m[1] / 2
    skin = skin_places(rig, np.array([1]), np.array([halfway]))
    angle_rad = 1.0
    posed = pose_joints(rig, np.array([[0, 0, 0], rig.axes[1].T @ [0, 0, angle_rad], [0, 0, 0]]))
    _, orientation = sway_leaves(rig, skin, np.array([[halfway, 1.03, 0]]), LEAF, posed)
    assert Rotation.from_quat(orientation[0]).as_rotvec() == pytest.approx([0, 0, angle_rad / 2])


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20)
def test_leaves_go_with_the_surface_and_rest_where_they_are(seed):
    plant = random_tree(seed)
    rng = np.random.default_rng(seed)
    rig = build_rig(plant, RigSettings(order=1))
    curve = rng.integers(0, len(plant), 9)
    arc_m = rng.random(9) * plant.lengths_m[curve]
    base_m = places_at(plant, curve, arc_m).between(plant.points_m) + 0.01 * rng.normal(size=(9, 3))
    still = Rotation.random(9, random_state=seed).as_quat()
    skin = skin_places(rig, curve, arc_m)
    there_m, orientation = sway_leaves(rig, skin, base_m, still, pose_joints(rig, np.zeros((len(rig), 3))))
    assert there_m == pytest.approx(base_m, abs=1e-9)
    assert np.abs(np.sum(orientation * still, axis=1)) == pytest.approx(1)
    posed = pose_joints(rig, 0.3 * rng.normal(size=(len(rig), 3)))
    there_m, orientation = sway_leaves(rig, skin, base_m, still, posed)
    assert np.array_equal(there_m, skin_points(rig, skin, base_m, posed))
    assert np.linalg.norm(orientation, axis=1) == pytest.approx(1)


def test_no_leaves_sway_as_none():
    rig = build_rig(fork())
    none = Skin(joints=np.zeros((0, 1), np.int32), weights=np.zeros((0, 1)))
    base_m, orientation = sway_leaves(rig, none, np.zeros((0, 3)), np.zeros((0, 4)), rig.bind)
    assert (base_m.shape, orientation.shape) == ((0, 3), (0, 4))


def test_a_leaf_unfolds_when_its_place_is_there_and_is_whole_at_last():
    plant = plant_of((np.linspace([0, 0, 0], [0, 2, 0], 21), 0.02, None, -1))
    stages = plan_stages(plant, 0.05, 40)
    arc_m = np.array([0.5, 1.5, 2.0])
    places = places_at(plant, np.zeros(3, int), arc_m)
    shares = np.array([unfold_leaves(stages, stage, places) for stage in range(40)])
    reach_m = np.array([stages.times.reach(at)[0] for at in stages.at])
    assert (shares[reach_m[:, None] <= arc_m] == UNBORN).all()
    assert (np.diff(shares, axis=0) >= 0).all()
    assert (shares[-1] == 1).all()
    born = np.interp(arc_m[:2], reach_m, stages.at)
    whole = stages.at[:, None] >= born + 0.15 + 0.01  # between two frames the front is no line
    assert (shares[:, :2][whole] == 1).all()
    assert (np.diff(shares, axis=0) < 1.6 / (0.15 * 39)).all()  # the last one has its time too
    half = unfold_leaves(stages, 20, places, UnfoldSettings(share=2 * (stages.at[20] - born[0])))
    assert half[0] == pytest.approx(0.5, abs=0.02)


def test_a_leaf_that_is_not_there_yet_waits_on_the_growing_tip():
    plant = plant_of((np.linspace([0, 0, 0], [0, 2, 0], 21), 0.02, None, -1))
    stages = plan_stages(plant, 0.05, 30)
    leaf = carried(plant, [0], [1.5], [[0.02, 1.5, 0]])
    for stage in range(30):
        base_m, share = carry_leaves(stages, stage, leaf)
        reach_m = stages.times.reach(stages.at[stage])[0]
        assert base_m[0, 1] == pytest.approx(min(reach_m, 1.5))
        assert 0 < base_m[0, 0] <= 0.02
        assert (share[0] > UNBORN) == (reach_m > 1.5)
    assert np.array_equal(base_m, leaf.points_m)


@pytest.mark.parametrize("plant", [fork(), small_tree()], ids=["fork", "tree"])
def test_leaves_stay_on_the_bark_of_what_grows(plant):
    grown = leaves_on(plant)
    stages = plan_stages(plant, 0.02 * float(np.ptp(plant.points_m, axis=0).max()), 8)
    places = places_at(plant, grown.places.branch, grown.places.arc_m)
    axis_m, radius_m = places.between(plant.points_m), places.between(plant.radius_m)
    base_m = grown.foliage.leaves.base_m
    assert len(base_m)
    assert np.linalg.norm(base_m - axis_m, axis=1) == pytest.approx(radius_m)  # the arc is that of the leaf
    surface = carry_points(build_branch_cage(plant), plant, base_m, places)
    for stage in range(8):
        there_m, share = carry_leaves(stages, stage, surface)
        near = find_places(plant, there_m, places.curve).between(plant.points_m)
        born = share > UNBORN
        assert (np.linalg.norm(there_m - near, axis=1)[born] <= radius_m[born] * (1 + 1e-9)).all()
    assert np.array_equal(there_m, base_m)
    assert (share == 1).all()


@pytest.mark.parametrize("share", [0.0, 1.5, np.nan])
def test_leaves_take_a_share_of_all_times(share):
    with pytest.raises(ValueError, match="share must be"):
        UnfoldSettings(share=share)
