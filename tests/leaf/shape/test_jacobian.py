"""Derivatives by the 21 parameters, against a step along the imaginary axis and against differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from usdfoliage.leaf.model import PARAMETERS
from usdfoliage.leaf.shape.surface import evaluate_jacobian, evaluate_points

from tests.support.leaves.reference import evaluate_jacobian as reference_jacobian
from tests.support.leaves.shapes import flat_leaf, random_leaves, wild_leaves

PLACES = np.random.default_rng(5).uniform((-1, 0), (1, 1), (40, 2))


def relative_error(jacobian, expected):
    return np.abs(jacobian - expected).max() / np.abs(expected).max()


@pytest.mark.parametrize("spread", [0.1, 1.0])
def test_is_the_complex_step(spread):
    leaves = random_leaves(12, spread=spread) + flat_leaf()
    uv = np.random.default_rng(6).uniform((-1, 0), (1, 1), (12, 30, 2))

    points, jacobian = evaluate_jacobian(leaves, uv)

    expected_points, expected = reference_jacobian(leaves, uv)
    assert np.abs(points - expected_points).max() <= 1e-12 * max(1.0, np.abs(expected_points).max())
    for leaf in range(12):
        assert relative_error(jacobian[leaf], expected[leaf]) <= 1e-11


def test_is_the_central_difference():
    leaves, step = random_leaves(6, spread=0.2) + flat_leaf(), 1e-5

    _, jacobian = evaluate_jacobian(leaves, PLACES)

    for number in range(21):
        moved = np.repeat(leaves[None], 2, axis=0)
        moved.reshape(2, 6, 21)[:, :, number] += np.array([[-step], [step]])
        low, high = (evaluate_points(each, PLACES) for each in moved)
        assert (high - low) / (2 * step) == pytest.approx(jacobian[..., number], rel=1e-6, abs=1e-6), number


@settings(max_examples=25, deadline=None)
@given(leaves=wild_leaves())
def test_wild_leaves_have_finite_derivatives_that_vanish_at_the_ends(leaves):
    _, jacobian = evaluate_jacobian(leaves, np.array([[0.3, 0.0], [-0.7, 1.0], [0.4, 0.6]]))

    assert np.isfinite(jacobian).all()
    assert (jacobian[:, :2] == 0).all()


def test_the_columns_are_the_parameters_row_after_row():
    leaf = flat_leaf()
    _, jacobian = evaluate_jacobian(leaf, np.array([[1.0, 0.5]]))

    column = {name: jacobian[0, 0, :, 3 * row : 3 * row + 3] for row, name in enumerate(PARAMETERS)}
    assert column["silhouette2"][:, 1] == pytest.approx([6 / 16, 0, 0])  # x moves with x
    assert column["silhouette2"][:, 2] == pytest.approx([0, 0, 6 / 16])
    assert column["silhouette2"][:, 0] == pytest.approx([0, 6 / 16, 0])  # the foot moves along the axis
    assert not column["inner"].any()
    assert not column["outer"].any()


def test_shared_places_with_any_number_of_threads_and_without_places():
    leaves = random_leaves(300)
    one = evaluate_jacobian(leaves, PLACES, threads=1)

    for other in (
        evaluate_jacobian(leaves, PLACES, threads=3),
        evaluate_jacobian(leaves, np.tile(PLACES, (300, 1, 1))),
    ):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    assert np.array_equal(one[0], evaluate_points(leaves, PLACES))
    assert evaluate_jacobian(leaves[:0], PLACES)[1].shape == (0, 40, 3, 21)
    assert evaluate_jacobian(leaves, PLACES[:0])[1].shape == (300, 0, 3, 21)


def test_an_axis_that_stands_upright_holds_its_normal():
    leaf = flat_leaf(feet=(0.0, 0.5, 1.0))
    leaf[0, :2] = (0, 0, 0.4), (0, 1, 0.4)

    assert np.isfinite(evaluate_jacobian(leaf, PLACES)[1]).all()
    assert np.abs(evaluate_jacobian(leaf, PLACES)[1]).max() < 10


def test_a_fit_finds_the_leaf_again():
    truth = random_leaves(1, seed=9, spread=0.03) + flat_leaf(width=0.3)
    target, leaf = evaluate_points(truth, PLACES), flat_leaf(width=0.2)

    for _ in range(12):
        points, jacobian = evaluate_jacobian(leaf, PLACES)
        step = np.linalg.lstsq(jacobian[0].reshape(-1, 21), (target - points).ravel(), rcond=None)[0]
        leaf = leaf + step.reshape(1, 7, 3)

    assert leaf == pytest.approx(truth, abs=1e-9)
