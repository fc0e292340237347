import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.segmentation.paper.planes import PlaneSettings, fit_planes

CAMERA = np.zeros(3)


def patch(normal, count: int = 200, seed: int = 0, at=(0, 0, 1.0), size: float = 0.02) -> np.ndarray:
    """Points of a square of a plane."""
    normal = np.asarray(normal, np.float64) / np.linalg.norm(normal)
    one = np.cross(normal, [0, 1, 0] if abs(normal[1]) < 0.9 else [1, 0, 0])
    one /= np.linalg.norm(one)
    places = np.random.default_rng(seed).uniform(-size / 2, size / 2, (count, 2))
    return np.asarray(at) + places @ np.array([one, np.cross(normal, one)])


def fit(points, labels, threshold=0.005, **kwargs):
    return fit_planes(points, labels, CAMERA, threshold, PlaneSettings(**kwargs), rng=np.random.default_rng(3))


@settings(max_examples=25, deadline=None)
@given(x=st.floats(-1, 1), y=st.floats(-1, 1), far=st.floats(0, 300), scale=st.sampled_from([0.1, 1.0, 10.0, 1000.0]))
def test_tilted_patches(x, y, far, scale):
    normals = np.array([[x, y, -1], [y, -x, -1], [0, 0, -1]], np.float64)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = np.concatenate([patch(n, seed=k, at=(0, 0, 1 + far)) for k, n in enumerate(normals)]) * scale
    planes = fit(points, np.repeat(np.arange(3), 200).astype(np.int32), 0.005 * scale)
    assert planes.valid.all()
    facing = normals * np.where(normals @ (0, 0, 1) > 0, -1, 1)[:, None]  # they are seen from z = 0
    np.testing.assert_allclose(planes.normals, facing, atol=1e-8)
    assert planes.inliers.mean() > 0.95  # the corners of a square are far from its mean
    assert (planes.rms_m < 1e-9 * scale * (1 + far)).all()


def test_a_plane_holds_against_points_of_another_leaf():
    points = np.concatenate([patch((0.3, 0, -1), 140), patch((0, 0, -1), 60, at=(0, 0, 1.02))])
    points += np.random.default_rng(5).normal(0, 1e-4, points.shape)
    planes = fit(points, np.zeros(200, np.int32), threshold=0.016)
    expected = np.array([0.3, 0, -1]) / np.hypot(0.3, 1)
    assert np.degrees(np.arccos(planes.normals[0] @ expected)) < 1
    assert planes.inliers[:140].mean() > 0.9
    assert not planes.inliers[140:].any()


def test_points_far_from_the_mean_are_dropped():
    points = patch((0, 0, -1))
    points[:4] += (0.2, 0, 0)  # on the plane, but on another leaf
    planes = fit(points, np.zeros(200, np.int32))
    assert not planes.inliers[:4].any()
    assert planes.inliers[4:].mean() > 0.95


def test_what_has_no_plane():
    rng = np.random.default_rng(2)
    line = np.linspace(0, 0.02, 50)[:, None] * (1, 1, 0) + (0, 0, 1)
    ball = rng.uniform(-0.02, 0.02, (50, 3)) + np.array([0, 0, 1])
    place = np.tile([0.0, 0, 1], (50, 1))
    few = patch((0, 0, -1), 5)
    missing = np.full((50, 3), np.nan)
    sets = [line, ball, place, few, missing, patch((0, 0, -1), 50)]
    labels = np.repeat(np.arange(6), [len(points) for points in sets]).astype(np.int32)
    planes = fit(np.concatenate(sets), labels, threshold=0.002)
    assert planes.valid.tolist() == [False, False, False, False, False, True]
    assert planes.dropped == {"superpixels with too few points": 2, "superpixels without a plane": 3}
    assert np.isnan(planes.normals[:5]).all()
    assert not planes.inliers[labels < 5].any()


def test_points_of_no_superpixel_are_left_alone():
    points = np.concatenate([patch((0, 0, -1)), patch((0, 0, -1))]).reshape(20, 20, 3)
    labels = np.repeat([0, -1], 200).reshape(20, 20).astype(np.int32)
    planes = fit(points, labels)
    assert planes.inliers.shape == (20, 20)
    assert not planes.inliers[10:].any()
    assert fit(points, np.full((20, 20), -1, np.int32)).valid.shape == (0,)


def test_refusals():
    with pytest.raises(ValueError, match="points_m"):
        fit(np.zeros((4, 2)), np.zeros(4, np.int32))
    with pytest.raises(ValueError, match="plane_threshold_m"):
        fit(np.zeros((4, 3)), np.zeros(4, np.int32), threshold=0.0)
    with pytest.raises(ValueError, match="min_inliers"):
        PlaneSettings(min_inliers=0)
