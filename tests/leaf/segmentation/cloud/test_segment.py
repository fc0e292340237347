"""Leaves out of clouds whose leaves are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.segmentation.cloud.segment import segment_cloud
from usdfoliage.leaf.segmentation.cloud.settings import CloudSegmentationSettings

from tests.support.leaves.scans import overlaps, scanned_leaves, stem_points


@pytest.mark.parametrize("points", [40, 150, 600])
def test_leaves_that_stand_apart_are_found_each(points):
    points_m, leaf = scanned_leaves(27, points)
    found = segment_cloud(points_m)
    assert (overlaps(found.leaf, leaf) > 0.8).mean() > 0.95
    assert len(found.leaves) <= 28
    assert found.loose < 0.05


def test_the_points_of_leaves_are_those_of_the_labels():
    points_m, _ = scanned_leaves(8, 100)
    found = segment_cloud(points_m)
    for number in range(len(found.leaves)):
        own = found.leaves.points_m[found.leaves.offsets[number] : found.leaves.offsets[number + 1]]
        np.testing.assert_array_equal(own, points_m[found.leaf == number])
    assert found.leaves.offsets[-1] == np.count_nonzero(found.leaf >= 0)
    assert ((found.leaves.confidence >= 0) & (found.leaves.confidence <= 1)).all()


def test_a_stem_is_no_leaf():
    points_m, leaf = scanned_leaves(27, 150)
    stem = stem_points(0.5, 0.004, 1500) - [0.2, 0, 0.2]
    found = segment_cloud(np.concatenate([points_m, stem]))
    assert (found.leaf[len(points_m) :] < 0).mean() > 0.9
    assert (overlaps(found.leaf[: len(points_m)], leaf) > 0.8).mean() > 0.95


def test_noise_is_no_leaf():
    noise = np.random.default_rng(0).uniform(0, 1, (4000, 3))
    found = segment_cloud(noise)
    assert len(found.leaves) <= 1


def test_a_third_of_noise_hides_few_leaves_and_invents_none():
    points_m, leaf = scanned_leaves(27, 150)
    noise = np.random.default_rng(0).uniform(points_m.min(axis=0), points_m.max(axis=0), (len(points_m) // 2, 3))
    found = segment_cloud(np.concatenate([points_m, noise]))
    assert len(found.leaves) <= 28
    assert (overlaps(found.leaf, np.append(leaf, np.full(len(noise), -1))) > 0.5).mean() > 0.9
    assert found.loose > 0.15


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 1000), scale=st.floats(0.1, 10))
def test_neither_place_nor_size_nor_order_matters(seed, scale):
    points_m, leaf = scanned_leaves(8, 120)
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(points_m))
    turned = Rotation.random(random_state=seed).apply(points_m)[order] * scale + rng.uniform(-5, 5, 3)
    found = segment_cloud(turned)
    assert (overlaps(found.leaf, leaf[order]) > 0.8).all()


def test_the_same_cloud_gives_the_same_leaves_with_any_number_of_threads():
    points_m, _ = scanned_leaves(8, 120)
    one, two = (segment_cloud(points_m, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.leaf, two.leaf)
    np.testing.assert_array_equal(one.leaves.confidence, two.leaves.confidence)


@pytest.mark.parametrize("count", [0, 1, 11])
def test_hardly_any_points_are_no_leaf(count):
    found = segment_cloud(np.random.default_rng(0).random((count, 3)))
    assert found.leaf.tolist() == [-1] * count
    assert len(found.leaves) == 0


def test_points_in_one_place_are_no_leaf():
    assert len(segment_cloud(np.ones((200, 3))).leaves) == 0


def test_a_cloud_of_other_shape_is_refused():
    with pytest.raises(ValueError, match="points_m must be"):
        segment_cloud(np.zeros((5, 2)))


@pytest.mark.parametrize(
    ("name", "value"),
    [("max_points", 99), ("plane_neighbours", 3), ("reach", 0.0), ("min_probability", 1.1), ("size_power", -0.1)],
)
def test_settings_that_cannot_be(name, value):
    with pytest.raises(ValueError, match=name):
        CloudSegmentationSettings(**{name: value})
