"""Joints for an asset's wood and leaves."""

import numpy as np
from pxr import Sdf, Usd
from usdfoliage.asset.export.polygons import polygonize_meshes
from usdfoliage.asset.parts.branches import author_branches
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.jobs.export.joints import nearest_branches, rig_assembly

from tests.support.branch_shapes import fork


def wood():
    stage = Usd.Stage.CreateInMemory()
    mesh = author_branches(stage, Sdf.Path("/b"), build_branch_cage(fork()), (0.2, 0.2, 0.1))
    polygonize_meshes(stage, 10_000)
    return stage, mesh.GetPrim()


def test_a_leaf_is_on_the_branch_whose_bark_is_nearest():
    skeleton = fork()
    # On the trunk's bark, on the branch's, on the twig's; and 4 cm from the axis of the trunk, inside its bark.
    at_m = np.array([[0.05, 0.4, 0], [0.6, 1.03, 0], [1.3, 1.0, 0.3], [0, 1.8, 0.04]])
    np.testing.assert_array_equal(nearest_branches(skeleton, at_m), [0, 1, 2, 0])
    assert len(nearest_branches(skeleton, np.zeros((0, 3)))) == 0


def test_wood_and_leaves_follow_the_joints_of_their_branches():
    _, prim = wood()
    at_m = np.array([[0.05, 0.4, 0], [0.9, 1.03, 0], [1.4, 1.0, 0.4]])
    rigged = rig_assembly(fork(), prim, at_m)
    np.testing.assert_array_equal(rigged.order, [0, 1, 2])
    np.testing.assert_array_equal(rigged.rig.parent, [-1, 0, 1])
    np.testing.assert_array_equal(rigged.leaves.joints[:, 0], [0, 1, 2])
    np.testing.assert_allclose(rigged.wood.weights.sum(axis=1), 1)
    points_m = np.array(prim.GetAttribute("points").Get())
    for inside, joint in ((points_m[:, 1] < 0.8, 0), ((points_m[:, 0] > 0.7) & (points_m[:, 0] < 0.9), 1)):
        assert inside.any()
        assert (rigged.wood.joints[inside, 0] == joint).all()
        np.testing.assert_array_equal(rigged.wood.weights[inside, 0], 1)


def test_branches_beyond_the_order_follow_those_below():
    _, prim = wood()
    rigged = rig_assembly(fork(), prim, np.array([[1.4, 1.0, 0.4]]), RigSettings(order=1))
    assert len(rigged.rig) == 2
    np.testing.assert_array_equal(rigged.leaves.joints[:, 0], [1])
