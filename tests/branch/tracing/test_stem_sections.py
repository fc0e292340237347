"""Circles across axes: exact on cylinders, seen in part as well, and none where points show none."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from usdfoliage.branch.tracing.axes import Axes
from usdfoliage.branch.tracing.stem_sections import StemSections, StemSectionSettings, fit_stem_sections

from tests.support.branch_clouds import cone, line, rings

HEIGHTS_M = 0.05 * np.arange(21)


def fit(points_m, nodes_m, window_m: float = 0.12, **settings) -> StemSections:
    """Circles around the nodes of one axis, each point belonging to the nearest node along it."""
    along_m = (nodes_m[-1] - nodes_m[0]) / np.linalg.norm(nodes_m[-1] - nodes_m[0])
    section = np.abs((points_m @ along_m)[:, None] - nodes_m @ along_m).argmin(axis=1).astype(np.int32)
    axes = Axes(nodes=np.arange(len(nodes_m)), first=np.array([0, len(nodes_m)]), parent=np.array([-1]))
    return fit_stem_sections(points_m, section, nodes_m, axes, StemSectionSettings(window_m=window_m, **settings))


def upright(offset=(0.0, 0.0)) -> np.ndarray:
    return np.column_stack([np.full(21, offset[0]), HEIGHTS_M, np.full(21, offset[1])])


@examples(max_examples=30)
@given(radius_m=st.floats(0.005, 1), x=st.floats(-0.02, 0.02), z=st.floats(-0.02, 0.02), far_m=st.floats(-1000, 1000))
def test_a_cylinder_has_its_radius_and_its_middle_wherever_the_axis_runs(radius_m, x, z, far_m):
    circles = fit(rings(radius_m, HEIGHTS_M) + far_m, upright((x, z)) + far_m)
    np.testing.assert_allclose(circles.radius_m, radius_m, rtol=1e-6)
    np.testing.assert_allclose(circles.offset_m, np.broadcast_to([-x, 0, -z], (21, 3)), atol=1e-6 * radius_m + 1e-9)
    np.testing.assert_allclose(circles.spread_m, radius_m, rtol=1e-6)
    assert circles.away_m.max() < 1e-6 * radius_m + 1e-9
    assert (circles.seen == 1).all()


@pytest.mark.parametrize(("share", "seen"), [(0.75, 9 / 12), (0.5, 6 / 12), (0.25, 3 / 12)])
def test_an_arc_is_enough(share, seen):
    points_m = rings(0.1, HEIGHTS_M, 240)
    turn = np.arctan2(points_m[:, 2], points_m[:, 0]) + np.pi
    circles = fit(points_m[turn < 2 * np.pi * share], upright((0.03, 0.0)))
    np.testing.assert_allclose(circles.radius_m, 0.1, rtol=1e-6)
    np.testing.assert_allclose(circles.offset_m, np.broadcast_to([-0.03, 0, 0], (21, 3)), atol=1e-7)
    assert circles.seen == pytest.approx(seen, abs=1.01 / 12)


@pytest.mark.parametrize("end_m", [[0, 1, 0], [1, 0, 0], [0.3, 0.2, -0.9]])
def test_noise_hardly_moves_the_circle_in_any_direction_of_the_branch(end_m):
    error = []
    for noise_m in (0.001, 0.01):
        circles = fit(cone([0, 0, 0], end_m, 0.1, 8000, 1, noise_m), line([0, 0, 0], end_m, 21))
        error.append(np.abs(circles.radius_m / 0.1 - 1).max())
        assert 0.4 * noise_m < np.median(circles.away_m) < 0.8 * noise_m  # the mean, 0.8, with less for what is far
    assert error[0] < 0.003
    assert error[0] < error[1] < 0.05


def test_what_is_far_from_the_circle_does_not_count():
    points_m = rings(0.1, HEIGHTS_M, 48)
    outliers_m = np.random.default_rng(0).uniform([0.12, 0, -0.1], [0.2, 1, 0.1], (len(points_m) // 8, 3))
    circles = fit(np.concatenate([points_m, outliers_m]), upright())
    np.testing.assert_allclose(circles.radius_m, 0.1, rtol=0.02)


def test_a_cone_has_at_each_node_the_radius_it_has_there():
    circles = fit(cone([0, 0, 0], [0, 1, 0], (0.1, 0.05), 20_000), upright(), 0.06)
    np.testing.assert_allclose(circles.radius_m[2:-2], (0.1 - 0.05 * HEIGHTS_M)[2:-2], rtol=0.02)


def test_the_spacing_of_points_follows_from_their_share_of_the_surface():
    circles = fit(rings(0.1, HEIGHTS_M), upright(), 0.12)
    assert circles.points[10] == 5 * 24
    assert circles.apart_m[10] == pytest.approx(np.sqrt(2 * np.pi * 0.1 * 0.2 / 120))


@pytest.mark.parametrize(
    "points_m",
    [
        line([0.1, 0, 0], [0.1, 1, 0], 400),
        np.concatenate([line([x, 0, x], [x, 1, x], 100) for x in (0.1, 0.2, 0.3)]),
        np.repeat([[0.1, 0.5, 0]], 100, axis=0),
        rings(0.1, HEIGHTS_M, 2)[::2],
        np.zeros((0, 3)),
    ],
    ids=["a line along", "a plane along", "one place", "too few", "none"],
)
def test_points_that_show_no_circle_have_none(points_m):
    circles = fit(points_m, upright())
    assert np.isnan(circles.radius_m).all()
    assert not circles.offset_m.any()


def test_nodes_on_each_other_have_no_direction_and_no_circle():
    axes = Axes(nodes=np.arange(2), first=np.array([0, 2]), parent=np.array([-1]))
    points_m = rings(0.1, np.zeros(1), 100)
    section = np.zeros(100, np.int32)
    circles = fit_stem_sections(points_m, section, np.zeros((2, 3)), axes, StemSectionSettings(window_m=0.1))
    assert np.isnan(circles.radius_m).all()


def test_a_branch_does_not_see_the_points_of_its_parent():
    trunk_m, branch_m = upright(), line([0.05, 0.5, 0], [1, 0.5, 0], 20)
    thin_m = rings(0.02, np.linspace(0.1, 1, 91))[:, [1, 0, 2]] + [0, 0.5, 0]
    points_m = np.concatenate([rings(0.1, HEIGHTS_M), thin_m])
    on_trunk = np.abs(points_m[: 21 * 24, 1][:, None] - HEIGHTS_M).argmin(axis=1)
    on_branch = 21 + np.abs(thin_m[:, 0][:, None] - branch_m[:, 0]).argmin(axis=1)
    axes = Axes(nodes=np.array([*range(21), 10, *range(21, 41)]), first=np.array([0, 21, 42]), parent=np.array([-1, 0]))
    section = np.concatenate([on_trunk, on_branch]).astype(np.int32)
    nodes_m = np.concatenate([trunk_m, branch_m])
    circles = fit_stem_sections(points_m, section, nodes_m, axes, StemSectionSettings(window_m=0.12))
    np.testing.assert_allclose(circles.radius_m[:21], 0.1, rtol=1e-6)
    np.testing.assert_allclose(circles.radius_m[21:], 0.02, rtol=1e-6)
    part = circles.take(np.arange(41) > 20)
    assert len(part.radius_m) == len(part.offset_m) == len(part.spread_m) == 20


@pytest.mark.parametrize("change", [{"window_m": 0.0}, {"window_m": np.nan}, {"window_m": 1.0, "min_points": 2}])
def test_settings_that_fit_nothing_are_refused(change):
    with pytest.raises(ValueError, match="window_m must be above 0"):
        StemSectionSettings(**change)
