import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.segmentation.paper.icp import IcpSettings, register_points, rigid_motion
from usdfoliage.leaf.segmentation.paper.template import draw_template


def motion_of(rotvec, shift):
    return np.column_stack([Rotation.from_rotvec(rotvec).as_matrix(), shift])


def move(motion, points):
    return points @ motion[:, :3].T + motion[:, 3]


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(-3, 3), min_size=6, max_size=6))
def test_pairs_give_their_motion(numbers):
    points = np.random.default_rng(0).normal(size=(20, 3))
    motion = motion_of(numbers[:3], numbers[3:])
    np.testing.assert_allclose(rigid_motion(points, move(motion, points)), motion, atol=1e-9)


def test_flat_points_are_turned_not_mirrored():
    flat = draw_template(2.0)
    motion = motion_of([0.4, -1.2, 2.0], [1, 2, 3])
    found = rigid_motion(flat, move(motion, flat))
    assert np.linalg.det(found[:, :3]) == pytest.approx(1)
    np.testing.assert_allclose(move(found, flat), move(motion, flat), atol=1e-9)


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_a_known_motion_is_found(scale):
    source = draw_template(2.0) * scale
    motion = motion_of([0.05, -0.08, 0.1], np.array([0.03, -0.02, 0.04]) * scale)
    start = np.column_stack([np.eye(3), np.zeros(3)])
    found = register_points(source, KDTree(move(motion, source)), start, 0.2 * scale, IcpSettings(still=1e-6))
    assert found.matched == 1
    assert found.iterations < 300
    np.testing.assert_allclose(move(found.target_from_source, source), move(motion, source), atol=2e-3 * scale)


def test_out_of_reach():
    source = draw_template(2.0)
    start = np.column_stack([np.eye(3), [0, 0, 5.0]])
    found = register_points(source, KDTree(source), start, 0.1)
    assert found.matched == 0
    assert np.array_equal(found.target_from_source, start)
    with pytest.raises(ValueError, match="iterations"):
        IcpSettings(iterations=0)
