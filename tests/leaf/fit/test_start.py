"""Samples of leaves' points and first poses."""

import numpy as np
import pytest
from usdfoliage.leaf.fit.start import sample_points, start_poses, thin_samples, turn_across
from usdfoliage.leaf.points import FREE_EDGE

from tests.support.leaves.points import known_leaves, leaf_points


def test_samples_are_few_even_and_keep_the_edge():
    points = leaf_points(known_leaves(3), interior=3000, edge=500)

    samples = sample_points(points, 200, 100, 150.0)

    assert np.diff(samples.offsets).tolist() == [300] * 3
    for i in range(3):
        part = slice(samples.offsets[i], samples.offsets[i + 1])
        assert samples.edge[part].sum() == 100
        assert samples.weights[part].sum() == pytest.approx(150)
        mine = points.points_m[points.offsets[i] : points.offsets[i + 1]]
        farthest = np.linalg.norm(mine[:, None] - samples.points_m[part], axis=-1).min(axis=1).max()
        assert farthest < 0.15 * np.ptp(mine, axis=0).max()


def test_few_points_are_all_taken_and_count_as_many_as_they_are():
    points = leaf_points(known_leaves(2), interior=30, edge=20)

    samples = sample_points(points, 200, 100, 150.0)

    assert len(samples.points_m) == 100
    assert samples.weights[: samples.offsets[1]].sum() <= 50
    assert samples.edge.sum() == (points.kind == FREE_EDGE).sum()


def test_points_that_lie_apart_do_not_count_and_those_that_are_no_numbers_are_left_out():
    points = leaf_points(known_leaves(1))
    points.points_m[7] += 1.0
    points.points_m[8] = np.nan

    samples = sample_points(points, 500, 500, 100.0)

    assert len(samples.points_m) == len(points.points_m) - 1
    assert not samples.weights[np.abs(samples.points_m - points.points_m[7]).max(axis=1) == 0].any()


def test_thinned_samples_weigh_as_much():
    samples = sample_points(leaf_points(known_leaves(4)), 200, 100, 100.0)

    thin = thin_samples(samples, 4)

    assert np.diff(thin.offsets) == pytest.approx(75, abs=2)
    assert thin.weights.sum() == pytest.approx(samples.weights.sum(), rel=0.05)


@pytest.mark.parametrize("outliers", [0.0, 0.1])
def test_poses_lie_along_the_leaves(outliers):
    leaves = known_leaves(40)
    points = leaf_points(leaves, outliers=outliers, outlier_m=0.05)
    samples = sample_points(points, 200, 100, 100.0)

    poses = start_poses(samples, leaves[1][:, :, 2])

    assert np.linalg.det(poses.axes) == pytest.approx(1)
    along = np.abs(np.einsum("ni,ni->n", poses.axes[:, :, 1], leaves[1][:, :, 1]))
    assert (along > 0.9).mean() > 0.9
    assert np.einsum("ni,ni->n", poses.axes[:, :, 2], leaves[1][:, :, 2]).min() > 0
    assert np.median(np.abs(poses.length_m / leaves[3] - 1)) < 0.1


def test_no_leaves_and_leaves_without_points():
    none = sample_points(leaf_points(known_leaves(0)), 200, 100, 100.0)
    assert none.offsets.tolist() == [0]

    empty = sample_points(leaf_points(known_leaves(3), v_range=[(0, 1), (2, 3), (0, 1)]), 20, 10, 100.0)
    assert np.diff(empty.offsets).tolist() == [30, 0, 30]


def test_poses_turned_across_span_the_same():
    leaves = known_leaves(10)
    poses = start_poses(sample_points(leaf_points(leaves), 200, 100, 100.0), leaves[1][:, :, 2])

    turned = turn_across(poses)

    assert np.linalg.det(turned.axes) == pytest.approx(1)
    assert np.array_equal(turned.axes[:, :, 1], poses.axes[:, :, 0])
    middle, its_middle = (each.base_m + each.length_m[:, None] / 2 * each.axes[:, :, 1] for each in (poses, turned))
    assert its_middle == pytest.approx(middle)
    again = turn_across(turned)
    assert again.axes[:, :, :2] == pytest.approx(-poses.axes[:, :, :2])
    assert again.length_m == pytest.approx(poses.length_m)
