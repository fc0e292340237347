import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.crown.radius import front_outline
from usdfoliage.crown.relief import NEUTRAL, ReliefSettings, displace_radius, fit_relief
from usdfoliage.geometry.cubemap import face_directions, share_borders


def foliage_cubemap(size: int, seed: int = 0):
    """A sum of waves in space, so that nothing changes across the borders of faces."""
    rng = np.random.default_rng(seed)
    directions = face_directions(size)
    waves = sum(np.cos(directions @ rng.normal(0, 12, 3) + rng.uniform(0, 6)) for _ in range(60)) / 8
    return 0.15 * np.exp(0.5 * waves)[..., None] * np.array([0.7, 1.0, 0.3])


def test_an_even_colour_has_no_relief():
    height = fit_relief(np.full((6, 32, 32, 3), 0.2))

    assert height == pytest.approx(np.full((6, 32, 32), NEUTRAL))


def test_bright_places_stand_out_and_dark_ones_recede():
    size = 64
    directions = face_directions(size)
    bright = np.exp(-(((directions - [0.6, 0, 0.8]) ** 2).sum(axis=-1)) / 0.02)
    dark = np.exp(-(((directions - [-0.6, 0, 0.8]) ** 2).sum(axis=-1)) / 0.02)
    color = np.repeat((0.2 + 0.2 * bright - 0.15 * dark)[..., None], 3, axis=-1)

    height = fit_relief(color)

    assert height[bright > 0.9].mean() > 0.65
    assert height[dark > 0.9].mean() < 0.35


@pytest.mark.parametrize("band_pass", [False, True])
def test_relief_is_neutral_on_the_silhouette_and_on_average(band_pass):
    size = 64
    height = fit_relief(foliage_cubemap(size), ReliefSettings(band_pass=band_pass))

    z = face_directions(size)[..., 2]
    assert height[np.abs(z) < 0.9 / size] == pytest.approx(NEUTRAL, abs=1e-6)
    for side in (z > 0, z < 0):
        assert height[side].mean() == pytest.approx(NEUTRAL, abs=0.01)
    assert height.min() >= 0
    assert height.max() <= 1
    assert height.std() > 0.05


def test_relief_keeps_the_front_outline():
    ball = np.ones((6, 65, 65))
    displaced = displace_radius(ball, fit_relief(foliage_cubemap(65)), 0.3)

    assert front_outline(displaced).min() > 0.995


def test_relief_has_no_step_across_faces():
    size = 64
    height = fit_relief(foliage_cubemap(size))

    assert np.abs(share_borders(height) - height).max() < 1e-12
    inner_step = np.abs(np.diff(height, axis=2)).mean()
    border_step = np.abs(height[:, :, 0] - height[:, :, 1]).mean()
    assert border_step < 1.3 * inner_step


@settings(max_examples=8, deadline=None)
@given(gain=st.floats(0.1, 5.0))
def test_displacement_is_proportional_to_radius_and_weight(gain):
    rng = np.random.default_rng(1)
    radius, height = rng.uniform(1, 2, (6, 8, 8)), rng.random((6, 8, 8))

    assert displace_radius(gain * radius, height, 0.4) == pytest.approx(gain * displace_radius(radius, height, 0.4))
    assert displace_radius(radius, height, 0.0) == pytest.approx(radius)


@pytest.mark.parametrize("wrong", [{"weight": -0.1}, {"weight": 1.1}, {"levels": 0}, {"finest": 0.0}])
def test_settings_are_checked(wrong):
    with pytest.raises(ValueError, match=r"must be|finest"):
        ReliefSettings(**wrong)
