"""The natural leaf and random leaves around it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_grid
from usdfoliage.leaf.shape.variation import VariationSettings, default_leaf, leaf_of_width, vary_colors, vary_leaves

FEW = settings(max_examples=20, deadline=None)

seeds = st.integers(0, 2**32 - 1)


def silhouette(leaf):
    return evaluate_grid(leaf[None], np.array([1.0]), np.linspace(0, 1, 201)).points[0, :, 0]


def test_the_natural_leaf_has_the_proportions_of_a_beech():
    leaf = default_leaf()
    right = silhouette(leaf)
    widest = right[:, 0].argmax()
    assert 0.45 <= 2 * right[widest, 0] <= 0.5
    assert 0.35 <= right[widest, 1] <= 0.5  # a little below the middle
    narrowing = right[160:200, 0] / (1 - right[160:200, 1])
    assert (np.diff(narrowing) < 0).all()  # a drawn-out tip: the silhouettes run in towards each other
    assert not leaf[:2, 0].any()  # its halves are equal
    assert not find_folds(leaf[None], 1e-9)[0]


def test_the_natural_leaf_is_a_flat_v_and_arches():
    across = evaluate_grid(default_leaf()[None], np.array([-1.0, 0.0, 1.0]), np.array([0.5])).points[0, 0]
    assert 0.04 < across[1, 2] < 0.1  # the axis stands above the chord
    assert 0.02 < across[0, 2] - across[1, 2] < 0.08  # the silhouettes above the axis
    assert across[0, 2] == across[2, 2]


@FEW
@given(width=st.floats(0.02, 1.5))
def test_a_leaf_of_a_width_has_it_and_keeps_the_slope_of_its_halves(width):
    leaf, default = leaf_of_width(width), default_leaf()
    assert leaf_width(leaf[None])[0] == pytest.approx(width, rel=1e-6)
    assert leaf[2:5, 2] / leaf[2:5, 1] == pytest.approx(default[2:5, 2] / default[2:5, 1])
    np.testing.assert_array_equal(leaf[:2], default[:2])
    assert not find_folds(leaf[None])[0]


@pytest.mark.parametrize("width", [0.0, -1.0, np.nan])
def test_a_width_that_cannot_be_is_refused(width):
    with pytest.raises(ValueError, match="width must be above 0"):
        leaf_of_width(width)


def test_the_natural_leaf_is_the_callers_own():
    default_leaf()[:] = 0
    assert default_leaf().any()


@pytest.mark.parametrize("mean", [None, default_leaf() * 1.1])
def test_without_variation_all_leaves_are_the_mean(mean):
    leaves = vary_leaves(5, np.random.default_rng(0), VariationSettings(amount=0), mean)
    expected = default_leaf() if mean is None else mean
    np.testing.assert_array_equal(leaves, np.broadcast_to(expected, (5, 7, 3)))


def test_no_leaves():
    assert vary_leaves(0, np.random.default_rng(0)).shape == (0, 7, 3)


def test_the_same_seed_gives_the_same_leaves():
    one, other, third = (vary_leaves(50, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one.tobytes() == other.tobytes()
    assert (one != third).any()


def test_leaves_vary_around_the_mean():
    leaves = vary_leaves(20_000, np.random.default_rng(0))
    np.testing.assert_allclose(leaves.mean(axis=0), default_leaf(), atol=0.006)
    varied = leaves.std(axis=0) > 1e-4
    assert varied[2:].all()
    np.testing.assert_array_equal(varied[:2], [[True, False, True]] * 2)  # the axis is not stretched along the leaf


def test_what_varies_together_is_correlated():
    leaves = vary_leaves(20_000, np.random.default_rng(0))
    width, height, arch = leaves[:, 3, 1], leaves[:, 3, 2] / leaves[:, 3, 1], leaves[:, 1, 2]
    assert np.corrcoef(arch, height)[0, 1] > 0.2
    assert np.corrcoef(width, height)[0, 1] < -0.2
    assert np.corrcoef(leaves[:, 0, 0], leaves[:, 1, 0])[0, 1] > 0.3  # more bent than swayed


def test_the_default_variation_folds_no_leaf():
    """Also by less than anyone sees: so it need not be looked for, which takes longer than the leaves themselves."""
    assert not find_folds(vary_leaves(20_000, np.random.default_rng(5)), 1e-9).any()


@FEW
@given(seed=seeds, amount=st.floats(0, 12))
def test_no_leaf_is_out_of_order_or_folds(seed, amount):
    leaves = vary_leaves(60, np.random.default_rng(seed), VariationSettings(amount=amount))
    assert np.isfinite(leaves).all()
    v = leaves[:, 2:5, 0]
    assert (np.diff(v, axis=1) > 0).all()
    assert (v > 0).all()
    assert (v < 1).all()
    assert (leaves[:, 2:5, 1] > 0).all()
    assert not find_folds(leaves).any()


@FEW
@given(
    seed=seeds,
    v=st.tuples(st.floats(0.05, 0.3), st.floats(0.35, 0.6), st.floats(0.65, 0.95)),
    x=st.tuples(*[st.floats(0.05, 0.5)] * 3),
)
def test_nor_around_another_mean(seed, v, x):
    mean = default_leaf()
    mean[2:5, 0], mean[2:5, 1] = v, x
    leaves = vary_leaves(40, np.random.default_rng(seed), mean=mean)
    assert (np.diff(leaves[:, 2:5, 0], axis=1) > 0).all()
    assert (leaves[:, 2:5, 1] > 0).all()
    assert find_folds(mean[None])[0] or not find_folds(leaves).any()


def test_around_a_mean_that_folds_leaves_vary_all_the_same():
    mean = default_leaf()
    mean[0, 0], mean[1, 0] = 2.0, -2.0
    assert find_folds(mean[None])[0]
    assert vary_leaves(40, np.random.default_rng(0), mean=mean).std(axis=0).max() > 0.01


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: VariationSettings(amount=-1), "amount must be 0 or more, not -1"),
        (lambda: VariationSettings(arch=float("nan")), "arch must be 0 or more, not nan"),
        (lambda: vary_leaves(-1, np.random.default_rng(0)), "number of leaves must be 0 or more, not -1"),
        (lambda: vary_leaves(1, np.random.default_rng(0), mean=np.zeros((3, 7))), "must be \\(7, 3\\)"),
        (lambda: vary_leaves(1, np.random.default_rng(0), mean=np.full((7, 3), np.nan)), "finite"),
    ],
)
def test_what_cannot_be_is_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_colors_vary_around_the_one_given():
    colors = vary_colors((0.06, 0.14, 0.03), 2000, np.random.default_rng(0))
    assert colors.shape == (2000, 3)
    np.testing.assert_allclose(np.median(colors, axis=0), [0.06, 0.14, 0.03], rtol=0.05)
    assert (colors > 0).all()
    assert (colors <= 1).all()
    assert colors[:, 1].std() / colors[:, 1].mean() > 0.1
    np.testing.assert_array_equal(vary_colors((0.1, 0.2, 0.3), 3, np.random.default_rng(0), 0.0), [[0.1, 0.2, 0.3]] * 3)
