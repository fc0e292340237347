"""From the points of a cloud to leaves."""

import numpy as np
import pytest
from usdfoliage.leaf.reconstruct_cloud import median_colors, reconstruct_cloud_leaves

from tests.support.leaves.scans import LENGTH_M, WIDTH, overlaps, scanned_leaves


def test_leaves_of_a_cloud_have_the_sizes_and_colors_of_its_leaves():
    points_m, leaf = scanned_leaves(27, 200)
    palette = np.random.default_rng(0).uniform(0.05, 0.5, (27, 3))
    found = reconstruct_cloud_leaves(points_m, palette[leaf])
    leaves = found.leaves
    assert (overlaps(found.leaf, leaf) > 0.8).mean() > 0.95
    assert np.median(leaves.length_m) == pytest.approx(LENGTH_M, rel=0.06)
    half = leaves.parameters[:, 3, 1]
    assert np.median(half) == pytest.approx(WIDTH / 2, rel=0.35)
    assert (leaves.residual_m < 0.02).all()
    for number in range(len(leaves)):
        own = leaf[found.leaf == number]
        np.testing.assert_allclose(leaves.color[number], palette[np.bincount(own).argmax()])
    assert found.steps[-1].count == len(leaves) == len(found.certainty)
    assert [each.code for each in found.remarks] == []


def test_no_leaf_is_a_result():
    found = reconstruct_cloud_leaves(np.random.default_rng(0).random((11, 3)))
    assert len(found.leaves) == 0
    assert {each.code for each in found.remarks} == {"no-leaf-in-cloud", "cloud-noisy"}


def test_sparse_leaves_are_remarked():
    found = reconstruct_cloud_leaves(scanned_leaves(27, 22)[0])
    assert "leaves-sparse-in-cloud" in {each.code for each in found.remarks}


def test_leaves_of_less_confidence_are_dropped_from_the_labels_too():
    points_m, _ = scanned_leaves(27, 40)
    everything = reconstruct_cloud_leaves(points_m)
    median = float(np.median(everything.leaves.confidence))
    surer = reconstruct_cloud_leaves(points_m, min_confidence=median)
    assert len(surer.leaves) < len(everything.leaves)
    assert surer.leaf.max() == len(surer.leaves) - 1
    assert np.count_nonzero(surer.leaf >= 0) < np.count_nonzero(everything.leaf >= 0)


def test_the_median_color_of_points_that_have_one():
    nan = [np.nan] * 3
    colors = np.array([[0.1, 0.2, 0.3], [0.3, 0.2, 0.1], [0.2, 0.2, 0.2], nan, nan, [1.0, 1.0, 1.0]])
    leaf = np.array([0, 0, 0, 0, 1, -1], np.int32)
    median = median_colors(colors, leaf, 2)
    np.testing.assert_allclose(median, [[0.2, 0.2, 0.2]] * 2)  # the second has none of its own
    assert median_colors(colors[3:5], leaf[3:5], 2) is None


def test_colors_of_other_points_are_refused():
    with pytest.raises(ValueError, match="colors must be"):
        reconstruct_cloud_leaves(np.zeros((20, 3)), np.zeros((19, 3)))
