"""The rims of leaves in a cloud."""

import numpy as np
from usdfoliage.leaf.points import FREE_EDGE, INTERIOR
from usdfoliage.leaf.segmentation.cloud.rims import find_rims
from usdfoliage.leaf.segmentation.cloud.working_cloud import prepare_cloud


def square():
    x, y = np.meshgrid(np.arange(12.0), np.arange(12.0), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(144)])


def test_the_rim_of_a_square_of_points():
    points_m = square()
    kind = find_rims(prepare_cloud(points_m), np.zeros(144, np.int32))
    outside = ((points_m[:, :2] == 0) | (points_m[:, :2] == 11)).any(axis=1)
    np.testing.assert_array_equal(kind == FREE_EDGE, outside)


def test_where_another_leaf_begins_is_a_rim_and_no_leaf_has_none():
    points_m = square()
    leaf = np.where(points_m[:, 0] < 6, 0, -1).astype(np.int32)
    kind = find_rims(prepare_cloud(points_m), leaf)
    assert (kind[points_m[:, 0] == 5] == FREE_EDGE).all()
    assert (kind[leaf < 0] == INTERIOR).all()
    assert (find_rims(prepare_cloud(points_m), np.full(144, -1, np.int32)) == INTERIOR).all()
