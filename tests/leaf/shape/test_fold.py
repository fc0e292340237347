"""Leaves that fold over themselves, and those that only look wild."""

import numpy as np
import pytest
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.surface import evaluate_grid
from usdfoliage.leaf.shape.variation import default_leaf, vary_leaves

from tests.support.leaves.shapes import flat_leaf, random_leaves


def determinants(leaves):
    """dx/du dy/dv - dy/du dx/dv of each half, densely: (N, 2, ...)."""
    halves = []
    for u in (np.linspace(0, 1, 49), -np.linspace(1e-12, 1, 49)):
        grid = evaluate_grid(leaves, u, np.linspace(0, 1, 97))
        by_u, by_v = grid.tangents_u, grid.tangents_v
        halves.append((by_u[..., 0] * by_v[..., 1] - by_u[..., 1] * by_v[..., 0]).reshape(len(leaves), -1))
    return np.stack(halves, axis=1)


def test_plain_and_natural_leaves_do_not_fold():
    assert not find_folds(flat_leaf())[0]
    assert not find_folds(default_leaf()[None])[0]
    assert not find_folds(vary_leaves(500, np.random.default_rng(0))).any()


def test_heights_do_not_matter():
    leaf = flat_leaf()
    leaf[0, 2:, 2] = (3.0, -5.0, 2.0, 4.0, -4.0)
    leaf[0, :2, 2] = (7.0, -7.0)

    assert not find_folds(leaf)[0]


def test_a_leaf_turned_over_as_a_whole_does_not_fold():
    assert not find_folds(flat_leaf(width=-0.3))[0]


def test_widths_of_both_signs_fold():
    leaf = flat_leaf()
    leaf[0, 2:5, 1] = 0.4, 0.1, -0.6

    assert find_folds(leaf)[0]


def test_control_points_in_the_wrong_order_fold():
    assert find_folds(flat_leaf(feet=(0.9, 0.5, 0.1)))[0]


@pytest.mark.parametrize(("width", "bow", "folds"), [(0.3, 0.05, False), (1.5, 0.25, True), (0.1, 0.25, True)])
def test_an_axis_bent_too_much_for_the_width_folds(width, bow, folds):
    # Of a wide leaf the silhouette turns over inside the bend; of a narrow one the axis crosses the inner curve, whose
    # control points lie on it and which therefore bends less.
    leaf = flat_leaf(width=width)
    leaf[0, :2, 0] = bow

    assert find_folds(leaf)[0] == folds


def test_a_loop_of_the_axis_folds():
    leaf = flat_leaf()
    leaf[0, 0], leaf[0, 1] = (1.5, 1.4, 0), (-1.5, 1.4, 0)

    assert find_folds(leaf)[0]


@pytest.mark.parametrize("spread", [0.06, 0.1])
def test_agrees_with_dense_samples(spread):
    leaves = random_leaves(300, seed=7, spread=spread) + default_leaf()

    found, shallow = find_folds(leaves, depth=0.02), find_folds(leaves, depth=0.005)

    dense = determinants(leaves)
    largest = np.abs(dense).max(axis=2)
    # The share is one of the greatest coefficient, which lies above the greatest value by a factor below 4 here.
    deep = ((dense.min(axis=2) < -0.08 * largest) & (dense.max(axis=2) > 0.08 * largest)).any(axis=1)
    any_sign = ((dense.min(axis=2) < 0) & (dense.max(axis=2) > 0)).any(axis=1)
    assert deep.any()
    assert not deep.all()
    assert found[deep].all()
    assert shallow[found].all()
    assert not shallow[~any_sign].any()


def test_mirrored_leaves_fold_where_the_leaves_do():
    leaves = random_leaves(200, seed=8, spread=0.08) + default_leaf()
    mirrored = leaves.copy()
    mirrored[:, :2, 0] *= -1

    assert np.array_equal(find_folds(leaves), find_folds(mirrored))


def test_no_leaves_and_a_leaf_of_no_width():
    assert find_folds(np.zeros((0, 7, 3))).shape == (0,)
    assert not find_folds(flat_leaf(width=0.0))[0]


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match=r"parameters must be \(N, 7, 3\)"):
        find_folds(np.zeros((3, 7)))
