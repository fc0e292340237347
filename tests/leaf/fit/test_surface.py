"""Fits to the points of known leaves: whole, half hidden, with outliers, at any scale, anywhere."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.fit.surface import SurfaceFitSettings, fit_leaves_to_surface, fit_surfaces
from usdfoliage.leaf.model import LeafOrigin
from usdfoliage.leaf.points import FREE_EDGE, INTERIOR, LeafPoints
from usdfoliage.leaf.shape.fold import find_folds
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

from tests.support.leaves.points import known_leaves, leaf_points, world_points

PLACES = grid_places(np.linspace(-1, 1, 21), np.linspace(0, 1, 21))


def distances(fitted, leaves):
    """Mean symmetric distance between fitted and true leaves, in leaf lengths."""
    true = world_points(leaves, PLACES)[0]
    placed = fitted.leaves.asset_from_leaf()
    found = evaluate_points(fitted.leaves.parameters, PLACES, placements=placed)
    return np.array(
        [
            (cKDTree(found[i]).query(true[k])[0].mean() + cKDTree(true[k]).query(found[i])[0].mean()) / 2 / leaves[3][k]
            for i, k in enumerate(fitted.source)
        ]
    )


def residuals(fits, points):
    """Root mean square distance of the points from the fits' tangent planes, in leaf lengths."""
    return fits.quality.residual_m / fits.length_m


def test_the_points_of_known_leaves_lie_on_the_fits():
    leaves = known_leaves(12, amount=0.6)
    settings = SurfaceFitSettings(misfit=2e-4, iterations=60, start_iterations=40, rounds=2)

    fits = fit_surfaces(leaf_points(leaves), settings)

    assert len(fits.source) == 12
    assert np.median(residuals(fits, None)) < 1e-3
    assert (residuals(fits, None) < 3e-3).all()


def test_known_leaves_are_found_with_the_default_settings():
    leaves = known_leaves(30)

    fitted = fit_leaves_to_surface(leaf_points(leaves))

    assert fitted.source.tolist() == list(range(30))
    assert fitted.dropped == {}
    assert distances(fitted, leaves).max() < 0.04
    assert np.median(distances(fitted, leaves)) < 0.02  # the samples themselves are 0.01 apart
    assert fitted.leaves.length_m == pytest.approx(leaves[3], rel=0.06)
    assert not find_folds(fitted.leaves.parameters).any()
    assert (fitted.leaves.view == np.arange(30)).all()
    assert fitted.leaves.confidence.min() > 0.6
    upwards = Rotation.from_quat(fitted.leaves.orientation).as_matrix()[:, :, 2]
    assert np.einsum("ni,ni->n", upwards, leaves[1][:, :, 2]).min() > 0.8


def test_base_and_apex_are_distinguished():
    leaves = known_leaves(40, seed=3)

    fitted = fit_leaves_to_surface(leaf_points(leaves))

    along = Rotation.from_quat(fitted.leaves.orientation).as_matrix()[:, :, 1]
    base_right = np.einsum("ni,ni->n", along, leaves[1][:, :, 1]) > 0
    assert base_right.mean() >= 0.95  # these leaves are wider at the base


@pytest.mark.parametrize("width", [1.0, 2.2, 2.8, 3.6])
def test_axes_of_leaves_as_wide_as_long_and_wider(width):
    parameters, axes, bases, lengths = known_leaves(40, seed=5, amount=0.6)
    parameters = parameters.copy()
    parameters[:, 2:5, 1] *= width
    leaves = parameters, axes, bases, lengths

    fitted = fit_leaves_to_surface(leaf_points(leaves))

    along = Rotation.from_quat(fitted.leaves.orientation).as_matrix()[:, :, 1]
    cosine = np.abs(np.einsum("ni,ni->n", along, axes[fitted.source][:, :, 1]))
    assert len(fitted.source) >= 38
    assert (cosine > np.cos(np.radians(8))).mean() > 0.9
    assert np.median(distances(fitted, leaves)) < 0.03


def outlined_points(radius, width=1.0, seed=0):
    """Thirty shallow leaves whose edge is this far from their middle, by the angle from the apex, in leaf lengths.

    Then they are made so many times as wide.
    """
    rng = np.random.default_rng(seed)
    points, kind = [], []
    for _ in range(30):
        around = rng.uniform(0, 2 * np.pi, 520)
        away = radius(around) * np.where(np.arange(520) < 400, np.sqrt(rng.random(520)), 1.0)
        flat = np.column_stack([width * away * np.sin(around), away * np.cos(around), 0.1 * away**2])
        turn = Rotation.random(random_state=rng.integers(2**31)).as_matrix()
        points.append(0.1 * rng.uniform(0.85, 1.15) * flat @ turn.T + rng.normal(size=3))
        kind.append(np.where(np.arange(520) < 400, INTERIOR, FREE_EDGE))
    everything = np.concatenate(points)
    return LeafPoints(
        points_m=everything,
        normals=np.tile([0.0, 0, 1], (len(everything), 1)),
        kind=np.concatenate(kind).astype(np.uint8),
        point_view=np.zeros(len(everything), np.int32),
        offsets=np.arange(31) * 520,
        confidence=np.ones(30),
        view=np.zeros(30, np.int32),
    )


def test_lobed_leaves_are_trusted_little():
    lobed = fit_leaves_to_surface(outlined_points(lambda angle: 0.2 + 0.3 * np.abs(np.cos(2.5 * angle)) ** 0.6))
    simple = fit_leaves_to_surface(outlined_points(lambda angle: np.full(len(angle), 0.5), 0.4))
    assert len(lobed.source) == len(simple.source) == 30
    assert np.median(lobed.leaves.confidence) < 0.4 < 0.8 < np.median(simple.leaves.confidence)
    assert np.median(lobed.outlined) < 0.7 < 0.9 < np.median(simple.outlined)


def test_blades_of_grass_are_trusted_less():
    blades, leaves = (
        fit_leaves_to_surface(outlined_points(lambda angle: np.full(len(angle), 0.5), width)) for width in (0.05, 0.4)
    )
    assert np.median(leaf_width(blades.leaves.parameters)) < 0.08
    assert np.median(blades.leaves.confidence) < 0.5 < 0.8 < np.median(leaves.leaves.confidence)


def test_hidden_halves_are_as_their_siblings_have_them():
    leaves = known_leaves(40, seed=1, amount=0.5)
    v_range = np.tile([0.0, 1.0], (40, 1))
    v_range[::4, 1] = 0.5

    fitted = fit_leaves_to_surface(leaf_points(leaves, v_range=v_range))

    half = np.isin(fitted.source, np.arange(0, 40, 4))
    length_error = np.abs(fitted.leaves.length_m / leaves[3][fitted.source] - 1)
    assert half.sum() == 10
    assert np.median(length_error[half]) < 0.1
    assert np.median(distances(fitted, leaves)[half]) < 0.05
    assert fitted.leaves.confidence[half].mean() < fitted.leaves.confidence[~half].mean() - 0.1
    assert np.mean((fitted.leaves.origin == LeafOrigin.COMPLETED) == half) > 0.9


def test_noise_and_outliers_do_little():
    leaves = known_leaves(20, seed=2)

    fitted = fit_leaves_to_surface(leaf_points(leaves, noise_m=0.0015, outliers=0.1, outlier_m=0.03))

    assert len(fitted.source) == 20
    assert np.median(distances(fitted, leaves)) < 0.025
    assert distances(fitted, leaves).max() < 0.06


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_scale_turn_and_place_do_not_matter(scale):
    points = leaf_points(known_leaves(8))
    turn, shift = Rotation.from_euler("xyz", [0.4, -1.0, 2.0]).as_matrix(), np.array([5.0, -3.0, 8.0]) * scale
    moved = replace(points, points_m=scale * points.points_m @ turn.T + shift, normals=points.normals @ turn.T)

    here, there = fit_surfaces(points), fit_surfaces(moved)

    # The points are sampled along a curve that fills an upright box, so that turned ones are other samples.
    assert there.length_m / scale == pytest.approx(here.length_m, rel=0.02)
    assert there.base_m == pytest.approx(scale * here.base_m @ turn.T + shift, abs=0.004 * scale)
    only_scaled = fit_surfaces(replace(points, points_m=scale * points.points_m))
    assert only_scaled.length_m / scale == pytest.approx(here.length_m, rel=1e-4)


def test_threads_do_not_matter():
    points = leaf_points(known_leaves(9), noise_m=0.001)

    one, many = (fit_surfaces(points, threads=threads) for threads in (1, 5))

    for name in ("parameters", "axes", "base_m", "length_m"):
        assert np.array_equal(getattr(one, name), getattr(many, name))


def test_one_leaf_alone():
    leaves = known_leaves(1)

    fitted = fit_leaves_to_surface(leaf_points(leaves))

    assert distances(fitted, leaves)[0] < 0.03


def test_no_leaves_and_leaves_without_points():
    assert len(fit_leaves_to_surface(leaf_points(known_leaves(0))).leaves) == 0

    v_range = [(0.0, 1.0), (2.0, 3.0), (0.0, 1.0)]
    fitted = fit_leaves_to_surface(leaf_points(known_leaves(3), v_range=v_range))

    assert fitted.source.tolist() == [0, 2]
    assert fitted.dropped == {"too few points": 1}


def test_points_of_no_surface_are_given_up_or_not_trusted():
    points = leaf_points(known_leaves(6))
    last = slice(points.offsets[5], points.offsets[6])
    cloud = points.points_m.copy()
    cloud[last] = np.random.default_rng(0).uniform(-0.05, 0.05, cloud[last].shape)

    fitted = fit_leaves_to_surface(replace(points, points_m=cloud))

    if 5 in fitted.source:
        assert fitted.leaves.confidence[-1] < 0.4 * fitted.leaves.confidence[:-1].min()
    else:
        assert fitted.dropped == {"no surface close to the points": 1}


def test_points_that_are_no_numbers_are_left_out():
    points = leaf_points(known_leaves(2))
    points.points_m[:20] = np.nan

    assert np.isfinite(fit_leaves_to_surface(points).leaves.parameters).all()


@pytest.mark.parametrize("bad", [{"evidence": 0.0}, {"min_points": 3}, {"iterations": 0}, {"fold_weight": -1.0}])
def test_wrong_settings_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        SurfaceFitSettings(**bad)


def test_progress_rises_to_all():
    calls = []

    fit_leaves_to_surface(leaf_points(known_leaves(2)), progress=lambda done, total: calls.append((done, total)))

    assert calls[-1][0] == calls[-1][1]
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)


def test_points_on_a_line_do_not_stop_the_others():
    points = leaf_points(known_leaves(3))
    line = slice(points.offsets[1], points.offsets[2])
    placed = points.points_m.copy()
    placed[line] = np.linspace(0, 0.1, 520)[:, None] * [1.0, 0.0, 0.0]

    fitted = fit_leaves_to_surface(replace(points, points_m=placed))

    assert {0, 2} <= set(fitted.source.tolist())
    assert isinstance(points, LeafPoints)


def test_no_leaf_has_a_silhouette_beyond_its_axis():
    leaves = known_leaves(12)
    points = leaf_points(leaves)
    rng = np.random.default_rng(3)
    crooked = replace(points, points_m=points.points_m + rng.normal(0, 0.12, points.points_m.shape) * leaves[3][0])

    crossing = fit_surfaces(crooked).parameters[:, 2:5, 1]
    fitted = fit_leaves_to_surface(crooked, SurfaceFitSettings(max_residual=1.0))

    assert (crossing < 0).any()
    assert len(fitted.leaves)
    assert (fitted.leaves.parameters[:, 2:5, 1] >= 0).all()
