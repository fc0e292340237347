"""The leaf as a NURBS patch, against an independent evaluation, and read back from one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation
from usdfoliage.errors import FitError
from usdfoliage.leaf.shape.nurbs import U_KNOTS, U_ORDER, V_KNOTS, V_ORDER, fit_leaf, net_weights
from usdfoliage.leaf.shape.surface import evaluate_grid, evaluate_points, grid_places, leaf_nets
from usdfoliage.leaf.shape.variation import VariationSettings, default_leaf, vary_leaves

U, V = np.linspace(-1, 1, 21), np.linspace(0, 1, 17)


def random_leaves(count, seed, amount):
    return vary_leaves(count, np.random.default_rng(seed), VariationSettings(amount=amount))


def as_patch(net, u, v):
    """Points (V, U, 3) of a patch by its knots and orders alone."""
    along = BSpline(np.array(V_KNOTS), net, V_ORDER - 1)(v)
    return BSpline(np.array(U_KNOTS), along.transpose(1, 0, 2), U_ORDER - 1)(u).transpose(1, 0, 2)


def in_frame(fitted, points):
    turned = points @ Rotation.from_quat(fitted.orientation).as_matrix().T
    return fitted.length_m * turned + fitted.base_m


def test_knots_fit_orders_and_nets():
    assert len(U_KNOTS) == 7 + U_ORDER
    assert len(V_KNOTS) == 5 + V_ORDER


@pytest.mark.parametrize("amount", [0, 1, 3, 10])
def test_the_patch_is_the_leaf(amount):
    leaves = random_leaves(20, 1, amount)
    surface = evaluate_grid(leaves, U, V).points
    weights = net_weights(grid_places(U, V))
    for net, points in zip(leaf_nets(leaves), surface, strict=True):
        np.testing.assert_allclose(as_patch(net, U, V), points, atol=1e-13)
        np.testing.assert_allclose((weights @ net.reshape(-1, 3)).reshape(points.shape), points, atol=1e-13)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    amount=st.floats(0, 3),
    length_m=st.floats(0.01, 10),
    far_m=st.floats(0, 100),
)
def test_a_leafs_patch_gives_the_leaf_and_its_place(seed, amount, length_m, far_m):
    rng = np.random.default_rng(seed)
    leaf = vary_leaves(1, rng, VariationSettings(amount=amount))[0]
    turn, base_m = Rotation.random(rng=rng), far_m * rng.normal(size=3)
    fitted = fit_leaf(length_m * turn.apply(leaf_nets(leaf[None])[0].reshape(-1, 3)).reshape(5, 7, 3) + base_m)
    digits_m = 1e-15 * (far_m + length_m)  # what adding the place leaves of the net
    atol = 1e-9 + 1e4 * digits_m / length_m
    np.testing.assert_allclose(fitted.parameters, leaf, atol=atol)
    np.testing.assert_allclose(Rotation.from_quat(fitted.orientation).as_matrix(), turn.as_matrix(), atol=atol)
    np.testing.assert_allclose(fitted.base_m, base_m, atol=1e-9 + 10 * digits_m)
    assert fitted.length_m == pytest.approx(length_m, rel=atol)
    assert fitted.residual_m < atol * length_m


def test_a_patch_where_it_was_stays_where_it_was():
    fitted = fit_leaf(leaf_nets(default_leaf()[None])[0].astype(np.float32))
    np.testing.assert_allclose(fitted.parameters, default_leaf(), atol=1e-6)
    np.testing.assert_allclose(fitted.orientation, (0, 0, 0, 1), atol=1e-6)
    np.testing.assert_allclose(fitted.base_m, 0, atol=1e-7)
    assert fitted.length_m == pytest.approx(1, abs=1e-7)


def test_an_edit_that_is_no_leaf_gives_the_nearest_leaf_and_how_near():
    net = leaf_nets(default_leaf()[None])[0]
    net[2, 6] += 0.1, 0.0, 0.1  # the right half alone
    fitted = fit_leaf(net)
    places = grid_places(U, V)
    patch = as_patch(net, U, V).reshape(-1, 3)

    def away_m(parameters):
        leaf = in_frame(fitted, evaluate_points(parameters[None], places)[0])
        return np.sqrt(np.mean(np.sum((leaf - patch) ** 2, axis=1)))

    assert away_m(fitted.parameters) == pytest.approx(fitted.residual_m, rel=0.2)
    assert 0.001 < fitted.residual_m < 0.02
    rng = np.random.default_rng(0)
    for _ in range(20):
        other = fitted.parameters + 0.01 * rng.normal(size=(7, 3))
        assert away_m(other) > away_m(fitted.parameters)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.floats(1e-4, 0.05))
def test_the_residual_is_no_larger_than_the_edit(seed, size):
    rng = np.random.default_rng(seed)
    net = leaf_nets(vary_leaves(1, rng))[0]
    edit = np.zeros(net.shape)
    edit[1:-1] = size * rng.normal(size=(3, 7, 3))
    fitted = fit_leaf(net + edit)
    moved = net_weights(grid_places(U, V)) @ edit.reshape(-1, 3)
    assert fitted.residual_m <= 1.1 * np.sqrt(np.mean(np.sum(moved**2, axis=1)))
    again = fit_leaf(leaf_nets(fitted.parameters[None])[0])
    np.testing.assert_allclose(again.parameters, fitted.parameters, atol=1e-8)


def test_a_patch_seen_from_behind_is_a_leaf_too():
    net = leaf_nets(default_leaf()[None])[0]
    fitted = fit_leaf(net * (-1, 1, 1))  # mirrored: the right half lies left
    assert fitted.residual_m < 1e-12
    mirrored = in_frame(fitted, evaluate_points(fitted.parameters[None], grid_places(U, V))[0])
    np.testing.assert_allclose(mirrored, as_patch(net * (-1, 1, 1), U, V).reshape(-1, 3), atol=1e-12)


def test_a_leaf_that_folds_over_itself_is_still_that_leaf():
    leaf = default_leaf()
    leaf[2:5, 0] = leaf[4:1:-1, 0].copy()
    fitted = fit_leaf(leaf_nets(leaf[None])[0])
    np.testing.assert_allclose(fitted.parameters, leaf, atol=1e-9)


def spoiled(change):
    net = leaf_nets(default_leaf()[None])[0]
    change(net)
    return net


def not_a_number(net):
    net[2, 3, 1] = np.nan


def collapsed(net):
    net[-1] = net[0]


def a_point(net):
    net[:] = 1.0


def a_line(net):
    net[..., (0, 2)] = 0


def right_half_reversed(net):
    net[1:4, 4:] = net[3:0:-1, 4:].copy()


def halves_on_each_other(net):
    net[:, 4:] = net[:, 2::-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (not_a_number, "1 coordinates of the patch are not finite"),
        (collapsed, "base and apex of the patch are 0 apart"),
        (a_point, "base and apex of the patch are 0 apart"),
        (a_line, "the patch is 0 wide"),
        (halves_on_each_other, "the patch is 0 wide"),
        (right_half_reversed, "the patch folds over itself"),
    ],
)
def test_what_is_no_leaf_is_refused(change, message):
    with pytest.raises(FitError, match=message):
        fit_leaf(spoiled(change))


def test_another_shape_is_refused():
    with pytest.raises(ValueError, match="net must be"):
        fit_leaf(np.zeros((7, 5, 3)))
