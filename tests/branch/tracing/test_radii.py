"""Radii: circles are followed where they can be believed, allometry elsewhere, and nothing becomes thicker outwards."""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.branch.allometry import AllometrySettings, carried_lengths
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.axes import Axes
from usdfoliage.branch.tracing.radii import RadiusSettings, estimate_radii
from usdfoliage.branch.tracing.stem_sections import StemSections, StemSectionSettings, fit_stem_sections

from tests.support.branch_clouds import cone, line

NODES_M = line([0, 0, 0], [0, 4, 0], 81)
PARENT = np.arange(-1, 80).astype(np.int32)


def circles_of(radius_m, seen: float = 1.0, away: float = 0.02) -> StemSections:
    """Circles as good as they come, of these radii; NaN for none."""
    radius_m = np.asarray(radius_m, float)
    count = len(radius_m)
    return StemSections(
        radius_m=radius_m,
        offset_m=np.zeros((count, 3)),
        away_m=away * radius_m,
        seen=np.full(count, seen),
        points=np.full(count, 100),
        apart_m=0.1 * radius_m,
        spread_m=radius_m.copy(),
    )


def tapering(exponent: float = 0.45, radius_m: float = 0.1) -> np.ndarray:
    carried_m = carried_lengths(RootedTree(PARENT), step_lengths(NODES_M, PARENT))
    return radius_m * (carried_m / carried_m[0]) ** exponent


@pytest.mark.parametrize(("noise_m", "within"), [(0.0, 0.03), (0.004, 0.06)])
def test_a_cone_has_its_radii(noise_m, within):
    points_m = cone([0, 0, 0], [0, 4, 0], (0.1, 0.04), 40_000, 2, noise_m)
    section = np.abs(points_m[:, 1][:, None] - NODES_M[:, 1]).argmin(axis=1).astype(np.int32)
    axes = Axes(nodes=np.arange(81), first=np.array([0, 81]), parent=np.array([-1]))
    circles = fit_stem_sections(points_m, section, NODES_M, axes, StemSectionSettings(window_m=0.08))
    radii = estimate_radii(NODES_M, PARENT, circles)
    true_m = 0.1 - 0.015 * NODES_M[:, 1]
    np.testing.assert_allclose(radii.radius_m[:70], true_m[:70], rtol=within)  # a tip carries nothing, and is thin
    assert radii.believed[:70].all()
    assert 0.4 * noise_m <= radii.noise_m <= 0.8 * noise_m + 0.001  # of a cone a window is of several radii


@pytest.mark.parametrize("exponent", [0.35, 0.45, 0.6])
def test_the_exponent_is_the_one_that_circles_show(exponent):
    radii = estimate_radii(NODES_M, PARENT, circles_of(tapering(exponent)))
    assert radii.exponent == pytest.approx(exponent, abs=0.03)
    np.testing.assert_allclose(radii.radius_m, tapering(exponent), rtol=0.05)


def test_round_clusters_of_leaves_do_not_change_the_exponent():
    radius_m = tapering(0.42)
    crown = NODES_M[:, 1] > 2.5
    circles = circles_of(np.where(crown, 0.09, radius_m))  # of one size, however thin the branch within
    seen = np.where(crown, 0.75, 1.0)
    away_m = np.where(crown, 0.13, 0.02) * circles.radius_m
    radii = estimate_radii(NODES_M, PARENT, replace(circles, seen=seen, away_m=away_m))
    assert radii.exponent == pytest.approx(0.42, abs=0.03)


def test_where_there_is_no_circle_allometry_gives_the_radius():
    circles = circles_of(np.where(NODES_M[:, 1] < 1.5, tapering(), np.nan))
    radii = estimate_radii(NODES_M, PARENT, circles)
    assert not radii.believed[NODES_M[:, 1] >= 1.5].any()
    np.testing.assert_allclose(radii.radius_m, tapering(), rtol=0.05)


@pytest.mark.parametrize("absurd", [10.0, 0.1])
def test_a_circle_seen_in_part_must_be_as_thick_as_is_expected(absurd):
    radius_m, wrong = tapering(), slice(40, 44)
    radius_m[wrong] *= absurd
    radii = estimate_radii(NODES_M, PARENT, circles_of(radius_m, seen=0.5))
    assert not radii.believed[wrong].any()
    np.testing.assert_allclose(radii.radius_m, tapering(), rtol=0.05)


def test_a_few_thin_circles_near_the_ground_do_not_thin_all_above():
    radius_m = tapering()
    radius_m[10:13] *= 0.75
    radii = estimate_radii(NODES_M, PARENT, circles_of(radius_m))
    np.testing.assert_allclose(radii.radius_m[20:], tapering()[20:], rtol=0.05)
    assert (np.diff(radii.radius_m) <= 0).all()


@pytest.mark.parametrize(
    "circles",
    [
        circles_of(tapering(), seen=0.2),
        circles_of(tapering(), away=0.5),
        circles_of(np.full(81, np.nan)),
    ],
    ids=["a fifth of a circle", "points far from it", "none"],
)
def test_circles_that_are_none_are_not_believed(circles):
    radii = estimate_radii(NODES_M, PARENT, circles)
    assert not radii.believed.any()
    assert radii.noise_m == 0
    assert radii.exponent == AllometrySettings().exponent
    # A trunk that cannot be measured is about a hundredth of its height thick, and allometry holds from there.
    guess_m = radii.radius_m[10]
    assert 0.005 * 4 <= guess_m <= 0.03 * 4
    np.testing.assert_allclose(radii.radius_m, guess_m * tapering() / tapering()[10], rtol=1e-6)


@examples(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_radii_never_grow_outwards_whatever_the_circles_are(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 80))
    parent = np.array([rng.integers(max(-1, node - 4), node) for node in range(count)], np.int32)
    radius_m = np.where(rng.random(count) < 0.3, np.nan, rng.uniform(0.001, 0.3, count))
    circles = circles_of(radius_m, float(rng.uniform(0.3, 1)), float(rng.uniform(0, 0.3)))
    radii = estimate_radii(rng.normal(size=(count, 3)), parent, circles)
    has = parent >= 0
    assert (radii.radius_m[has] <= radii.radius_m[parent[has]]).all()
    assert (radii.radius_m >= RadiusSettings().min_radius_m).all()
    assert RadiusSettings().exponents[0] <= radii.exponent <= RadiusSettings().exponents[1]
    assert not radii.believed[np.isnan(radius_m)].any()


def test_one_node_has_a_radius():
    assert estimate_radii(np.zeros((1, 3)), np.array([-1], np.int32), circles_of([np.nan])).radius_m[0] > 0


@pytest.mark.parametrize(
    ("change", "about"),
    [
        ({"min_seen": 0.8, "all_round": 0.7}, "min_seen <= all_round"),
        ({"all_round": 1.1}, "min_seen <= all_round"),
        ({"max_away": 0.0}, "must be above 0"),
        ({"tolerance": 0.0}, "must be above 0"),
        ({"exponents": (0.6, 0.4)}, "exponents must rise"),
        ({"exponent_tolerance": 0.0}, "exponent_tolerance must be above 0"),
        ({"factor": 0.9}, "factor at least 1"),
    ],
)
def test_settings_that_believe_nothing_or_all_are_refused(change, about):
    with pytest.raises(ValueError, match=about):
        RadiusSettings(**change)


@pytest.mark.parametrize("rising", [(0.005, 0.05), (0.02, 0.049), (0.03, 0.04)])
def test_a_twig_of_two_nodes_of_which_the_farther_seems_thicker_has_one_radius(rising):
    trunk_m = line([0, 0, 0], [0, 3, 0], 30)
    nodes_m = np.concatenate([trunk_m, trunk_m[15] + np.outer([1, 2], [0.3, 0, 0])])
    parent = np.array([*range(-1, 29), 15, 30], np.int32)
    radii = estimate_radii(nodes_m, parent, circles_of([*np.full(30, 0.05), *rising]))
    assert radii.radius_m[30] >= radii.radius_m[31] > 0


def test_where_circles_contradict_each_other_there_is_no_step():
    radius_m = np.where(NODES_M[:, 1] < 2, 0.06, 0.08)  # rises, so that one level takes the place of both
    radius_m[NODES_M[:, 1] < 0.5] = 0.1
    radii = estimate_radii(NODES_M, PARENT, circles_of(radius_m))
    change = np.abs(np.diff(np.log(radii.radius_m)))
    assert change[:70].max() < 0.25 * np.log(0.1 / 0.07)
