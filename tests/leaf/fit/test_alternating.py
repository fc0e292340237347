"""The alternating fit on points of leaves that are known, and against the same written plainly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.leaf.fit.alternating import AlternatingFitSettings, fit_leaves_alternating
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_normals, evaluate_points, grid_places
from usdfoliage.leaf.shape.variation import vary_leaves

from tests.support.leaves.clouds import leaf_points, moved, surface_distances, surface_points
from tests.support.leaves.fit_reference import fit_leaf
from tests.support.leaves.shapes import flat_leaf

NATURAL = vary_leaves(12, np.random.default_rng(4))
WITHOUT_ROBUSTNESS = AlternatingFitSettings(robustness="none")


def pointed_leaf(width=0.5, arch=0.0, fold=0.0):
    """A leaf (1, 7, 3) whose tips lie on the smallest ellipse around it."""
    leaf = flat_leaf()
    leaf[0, :2, 2] = arch
    leaf[0, 2:5, 1] = 0.3 * width, width, 0.3 * width
    leaf[0, 2:5, 2] = fold * leaf[0, 2:5, 1]
    leaf[0, 5], leaf[0, 6] = leaf[0, 2:5, 2] / 3, 2 * leaf[0, 2:5, 2] / 3
    return leaf


def sampled(leaves, count=1000, keep=None, noise=0.003, seed=0):
    rng = np.random.default_rng(seed)
    return leaf_points(*zip(*[surface_points(leaf, count, rng, keep, noise) for leaf in leaves], strict=True))


def world_points(leaves: Leaves, uv):
    return evaluate_points(leaves.parameters, uv, placements=leaves.asset_from_leaf())


@pytest.mark.parametrize(("arch", "fold", "width"), [(0, 0, 0.5), (0.05, 0, 0.5), (0.05, 0.2, 0.5), (0.1, 0.3, 0.25)])
def test_a_leaf_that_scanlines_can_map_is_found_again(arch, fold, width):
    leaf = pointed_leaf(width, arch, fold)
    points, normals = evaluate_normals(leaf, grid_places(np.linspace(-1, 1, 81), np.linspace(0, 1, 241)))

    fitted = fit_leaves_alternating(leaf_points(points, normals)).leaves

    assert fitted.residual_m[0] < 5e-4  # of all points of the leaf, its silhouette among them
    assert fitted.length_m[0] == pytest.approx(1, abs=2e-3)
    assert leaf_width(fitted.parameters) * fitted.length_m == pytest.approx(leaf_width(leaf), rel=0.02)
    assert fitted.confidence[0] > 0.97


def test_natural_leaves():
    fitted = fit_leaves_alternating(sampled(NATURAL)).leaves

    distances = surface_distances(NATURAL, fitted)
    assert distances.mean() < 0.010
    assert distances.max() < 0.014
    assert leaf_width(fitted.parameters) * fitted.length_m == pytest.approx(leaf_width(NATURAL), rel=0.07)


@pytest.mark.parametrize(
    ("keep", "max_distance"),
    [
        (lambda u, v: v < 0.7, 0.027),  # the apex is missing
        (lambda u, v: v > 0.3, 0.021),  # the base is
        (lambda u, v: u < 0.5, 0.024),  # a side
        (lambda u, v: (u < 0.1) | (v < 0.4), 0.017),  # a corner
        (lambda u, v: (u < 0.1) | (v < 0.25) | (v > 0.6), 0.019),  # a bay
    ],
)
def test_leaves_partly_hidden(keep, max_distance):
    whole = fit_leaves_alternating(sampled(NATURAL)).leaves
    partly = fit_leaves_alternating(sampled(NATURAL, keep=keep)).leaves

    assert surface_distances(NATURAL, partly).mean() < max_distance
    assert partly.confidence.mean() < whole.confidence.mean()


def test_where_a_corner_is_hidden_the_ellipse_guides_the_fit():
    """As in figure 5 (b): without the ellipse's weights the halves would meet in the middle of what is seen."""
    leaf = pointed_leaf()
    cloud = sampled(leaf, keep=lambda u, v: (u < 0.2) | (v < 0.45))

    fitted = fit_leaves_alternating(cloud).leaves

    assert leaf_width(fitted.parameters) * fitted.length_m == pytest.approx(leaf_width(leaf), rel=0.08)
    assert surface_distances(leaf, fitted)[0] < 0.015


@pytest.mark.parametrize("width", [0.05, 0.15, 0.3])
def test_narrow_leaves_do_not_swell_to_their_ellipse(width):
    leaf = pointed_leaf(width)
    cloud = sampled(leaf, noise=0.0)

    fitted = fit_leaves_alternating(cloud).leaves

    near_tip = grid_places((-1.0, 1.0), [0.12, 0.88])
    ours, truth = (
        np.linalg.norm(sides[:, ::2] - sides[:, 1::2], axis=-1)
        for sides in (world_points(fitted, near_tip), evaluate_points(leaf, near_tip))
    )
    ellipse = leaf_width(leaf)[0] * 1.4 * np.sqrt(0.12 * 0.88) * 2 / 2**0.5
    assert ours == pytest.approx(truth, rel=0.35)
    assert (ours < 0.75 * ellipse).all()


@pytest.mark.parametrize("robustness", ["huber", "tukey"])
def test_a_tenth_of_outliers(robustness):
    rng = np.random.default_rng(8)
    clean, dirty = [], []
    for leaf in NATURAL:
        points, _ = surface_points(leaf, 900, rng, noise=0.002)
        off_surface, _ = surface_points(leaf, 50, rng)
        off_surface[:, 2] += rng.uniform(0.1, 0.5, 50) * rng.choice((-1, 1), 50)
        beside = rng.uniform((-0.5, -0.2, -0.1), (0.5, 1.2, 0.2), (50, 3))
        clean.append(points)
        dirty.append(np.concatenate([points, off_surface, beside]))
    chosen = AlternatingFitSettings(robustness=robustness)

    of_clean, of_dirty, plainly = (
        surface_distances(NATURAL, fit_leaves_alternating(leaf_points(each), how).leaves)
        for each, how in ((clean, chosen), (dirty, chosen), (dirty, WITHOUT_ROBUSTNESS))
    )

    assert of_dirty.mean() < 1.4 * of_clean.mean()
    assert of_dirty.mean() < 0.4 * plainly.mean()


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), decade=st.floats(-3, 3), leaf=st.integers(0, len(NATURAL) - 1))
def test_moving_turning_and_scaling_the_points_does_the_same_to_the_leaf(seed, decade, leaf):
    points, normals = surface_points(NATURAL[leaf], 400, np.random.default_rng(leaf), noise=0.003)
    scale = 10**decade
    other_points, other_normals, turn, shift = moved(points, normals, seed, scale)

    one = fit_leaves_alternating(leaf_points([points], [normals])).leaves
    other = fit_leaves_alternating(leaf_points([other_points], [other_normals])).leaves

    assert other.parameters == pytest.approx(one.parameters, abs=1e-6)
    assert other.length_m == pytest.approx(scale * one.length_m, rel=1e-9)
    assert other.residual_m == pytest.approx(scale * one.residual_m, rel=1e-6)
    places = grid_places((-1.0, 0.0, 1.0), (0.0, 0.5, 1.0))
    expected = scale * world_points(one, places) @ turn.T + shift
    assert world_points(other, places) == pytest.approx(expected, abs=1e-6 * scale)


def test_z_looks_towards_the_cameras():
    points, normals = surface_points(NATURAL[0], 500, np.random.default_rng(0))

    for sign in (1, -1):
        fitted = fit_leaves_alternating(leaf_points([points], [sign * normals])).leaves
        assert sign * fitted.asset_from_leaf()[0, 2, 2] > 0.9


@pytest.mark.parametrize("keep", [None, lambda u, v: (u < 0.2) | (v < 0.5)])
def test_is_the_same_as_written_plainly(keep):
    cloud = sampled(NATURAL[:3], count=300, keep=keep)

    fitted = fit_leaves_alternating(cloud, WITHOUT_ROBUSTNESS).leaves

    for leaf in range(3):
        chosen = slice(*cloud.offsets[leaf : leaf + 2])
        plain = fit_leaf(cloud.points_m[chosen], cloud.normals[chosen])
        assert fitted.parameters[leaf] == pytest.approx(plain.parameters, abs=2e-4)
        assert fitted.base_m[leaf] == pytest.approx(plain.base, abs=1e-8)
        assert fitted.length_m[leaf] == pytest.approx(plain.length, abs=1e-8)


def test_any_number_of_threads_and_any_company_give_the_same():
    cloud = sampled(NATURAL, count=200)
    one = fit_leaves_alternating(cloud, threads=1).leaves

    three = fit_leaves_alternating(cloud, threads=3).leaves
    last = slice(cloud.offsets[-2], None)
    alone = fit_leaves_alternating(leaf_points([cloud.points_m[last]], [cloud.normals[last]])).leaves

    for name in ("parameters", "base_m", "orientation", "length_m", "residual_m", "confidence"):
        assert np.array_equal(getattr(one, name), getattr(three, name)), name
        assert np.array_equal(getattr(one, name)[-1:], getattr(alone, name)), name


def test_the_residual_is_the_distance_of_the_points_from_the_surface():
    leaf = pointed_leaf(arch=0.05, fold=0.2)
    points, _ = surface_points(leaf[0], 2000, np.random.default_rng(1))
    lifted = points + (0, 0, 0.02) * np.random.default_rng(2).choice((-1, 1), (2000, 1))

    fitted = fit_leaves_alternating(leaf_points([lifted])).leaves

    assert fitted.residual_m[0] == pytest.approx(0.02, rel=0.05)


def test_leaves_that_cannot_be_fitted_are_counted():
    good, _ = surface_points(NATURAL[0], 100, np.random.default_rng(0))
    torn = good.copy()
    torn[3, 1] = np.nan
    line = np.linspace(0, 1, 50)[:, None] * (1, 2, 3)
    cloud = leaf_points([good[:5], torn, good, line, np.ones((30, 3)), np.empty((0, 3))])

    fitted = fit_leaves_alternating(cloud)

    assert fitted.source.tolist() == [2]
    assert fitted.leaves.view.tolist() == [2]
    assert fitted.dropped == {"too few points": 2, "points that are not finite": 1, "points on a line": 2}


def test_no_leaf_at_all():
    fitted = fit_leaves_alternating(leaf_points([]))

    assert len(fitted.leaves) == 0
    assert not fitted.dropped


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 100_000), count=st.integers(20, 120), kind=st.integers(0, 4), decade=st.integers(-6, 6))
def test_no_points_make_a_leaf_that_folds_or_is_not_finite(seed, count, kind, decade):
    rng = np.random.default_rng(seed)
    turns = rng.uniform(0, 6.3, count)
    points = (
        rng.normal(size=(count, 3)),
        rng.normal(size=(count, 3)) * (1, 0.1, 0.01),
        rng.standard_cauchy((count, 3)),
        np.column_stack([np.cos(turns), np.sin(turns), 0.05 * rng.normal(size=count)]),
        rng.integers(0, 3, (count, 3)).astype(float),
    )[kind] * 10.0**decade

    fitted = fit_leaves_alternating(leaf_points([points]))

    leaves = fitted.leaves
    assert len(leaves) + sum(fitted.dropped.values()) == 1
    for name in ("parameters", "base_m", "orientation", "length_m", "residual_m", "confidence"):
        assert np.isfinite(getattr(leaves, name)).all(), name
    assert not find_folds(leaves.parameters).any()
    assert ((leaves.confidence >= 0) & (leaves.confidence <= 1)).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"min_points": 2},
        {"scanlines": 3},
        {"max_iterations": 0},
        {"robustness": "median"},
        {"tolerance": 0.0},
        {"isolation": float("nan")},
        {"prior": -1.0},
    ],
)
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        AlternatingFitSettings(**wrong)
