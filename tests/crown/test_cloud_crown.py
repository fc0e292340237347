"""Crowns of clouds alone: sparse ones that are right, dense ones that are wrong, planes and few directions."""

import numpy as np
import pytest
from usdfoliage.crown.captured_measures import point_spacing
from usdfoliage.crown.crown_points import CrownPointSettings
from usdfoliage.crown.reconstruct import CapturedCrownSettings, reconstruct_cloud_crown
from usdfoliage.errors import FitError
from usdfoliage.remarks import warnings_of

from tests.support.captured_crowns import CENTER_M, lumpy, sphere, surface_points, true_radius

SETTINGS = CapturedCrownSettings(size=32)
UNLIKE = 0.3  # IoU of silhouettes, below which a build leaves a crown out


def crown_of(points_m):
    return reconstruct_cloud_crown(points_m, SETTINGS, plain=(0.1, 0.3, 0.05))


def filled(count, scale=1.0):
    """Points of a lumpy crown, most of them outside."""
    away = 0.5 + 0.5 * np.random.default_rng(1).random((count, 1)) ** (1 / 3)
    return CENTER_M + scale * away * (surface_points(lumpy, count) - CENTER_M)


def wall(count, thick_m, tilt=0.0):
    rng = np.random.default_rng(2)
    across, up = rng.uniform(0, 2, count), rng.uniform(0, 3, count)
    return np.column_stack([across, up, tilt * up + rng.normal(0, thick_m / 2, count)])


@pytest.mark.parametrize("count", [500, 800, 1500, 3000])
@pytest.mark.parametrize("scale", [0.3, 1.0, 8.0])
def test_sparse_crowns_are_measured_by_their_own_spacing(count, scale):
    model, measures = crown_of(filled(count, scale))

    assert np.abs(model.radius_m / scale - true_radius(lumpy, CENTER_M, 32)).mean() < 0.1
    assert min(view.cloud_iou for view in measures.views) > 0.75
    assert measures.known > 0.8
    assert warnings_of(measures.remarks) == ()


@pytest.mark.parametrize("count", [1000, 20_000])
def test_wrong_crowns_are_still_found(count):
    rng = np.random.default_rng(3)
    spikes = rng.normal(size=(12, 3))
    spikes /= np.linalg.norm(spikes, axis=1, keepdims=True)
    along = spikes[rng.integers(0, 12, count)] * rng.uniform(0, 2, (count, 1))
    angle = rng.uniform(0, np.pi, count)
    arch = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.zeros(count)])
    for points in (along, arch + rng.normal(0, 0.1, (count, 3))):
        _, measures = crown_of(points + np.array([0.0, 3.0, 0.0]))
        assert np.median([view.cloud_iou for view in measures.views]) <= UNLIKE + 0.01


def test_spacing_is_that_of_the_points():
    grid = np.stack(np.meshgrid(*[np.arange(12.0)] * 3), axis=-1).reshape(-1, 3)

    assert point_spacing(0.2 * grid) == pytest.approx(0.2)
    assert point_spacing(grid[:5]) == 0


@pytest.mark.parametrize("count", [300, 20_000])
@pytest.mark.parametrize(("thick_m", "tilt"), [(0.0, 0.0), (0.01, 0.0), (0.01, 0.5)])
def test_a_plane_is_no_crown(count, thick_m, tilt):
    with pytest.raises(FitError, match=r"lie in a plane: they spread .* m across it, and .* m are needed"):
        crown_of(wall(count, thick_m, tilt))


def test_a_flat_crown_is_one():
    model, measures = crown_of(CENTER_M + np.array([1.0, 0.15, 1.0]) * (filled(20_000) - CENTER_M))

    assert warnings_of(measures.remarks) == ()
    assert np.median([view.cloud_iou for view in measures.views]) > 0.5
    assert np.ptp(model.radius_m) > 0.6


def test_few_directions_are_refused_or_a_warning():
    ball = 0.4 * (filled(6000) - CENTER_M)
    with pytest.raises(FitError, match=r"points in \d% of the directions, 10% needed; give a cloud from all sides"):
        crown_of(np.concatenate([ball, ball + np.array([3.0, 0, 0])]))
    _, thin = crown_of(wall(20_000, 0.1))
    assert "its surface is a guess" in warnings_of(thin.remarks)[0].text
    shell = surface_points(sphere, 20_000)
    _, half = crown_of(shell[shell[:, 2] > CENTER_M[2]])
    assert 0.5 < half.known < 0.9
    assert warnings_of(half.remarks) == ()


def test_how_flat_is_a_setting():
    with pytest.raises(ValueError, match="flat"):
        CrownPointSettings(flat=1.0)
    settings = CapturedCrownSettings(size=32, points=CrownPointSettings(flat=0.2))
    with pytest.raises(FitError, match="in a plane"):
        reconstruct_cloud_crown(wall(5000, 0.2), settings, plain=(0.1, 0.3, 0.05))
