"""A clear sky: where its light comes from, and how much of it there is."""

import numpy as np
import pytest
from usdfoliage.forest.sky import LUMINANCE, ROWS, SkySettings, make_sky, sky_directions, solid_angles


@pytest.mark.parametrize(
    ("azimuth_deg", "elevation_deg", "to_sun"),
    [(0, 0.0, [0, 0, -1]), (90, 0.0, [1, 0, 0]), (180, 30.0, [0, 0.5, 0.75**0.5]), (45, 90.0, [0, 1, 0])],
)
def test_the_sun_is_clockwise_from_north(azimuth_deg, elevation_deg, to_sun):
    sky = SkySettings(azimuth_deg=azimuth_deg, elevation_deg=max(elevation_deg, 1.0))
    np.testing.assert_allclose(sky.to_sun, to_sun, atol=0.02)


def test_texels_look_at_directions_that_cover_the_sphere():
    direction = sky_directions(ROWS)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1)
    assert float(solid_angles(ROWS).sum() * 2 * ROWS) == pytest.approx(4 * np.pi)
    assert direction[0, :, 1].min() > 0.99
    assert direction[ROWS // 2, ROWS] @ [0, 0, 1] > 0.99  # the middle
    assert direction[ROWS // 2, ROWS // 2] @ [1, 0, 0] > 0.99  # a quarter from the left


@pytest.mark.parametrize("elevation_deg", [2.0, 20.0, 60.0, 90.0])
def test_level_ground_gets_pi_whatever_the_sun(elevation_deg):
    sky = make_sky(SkySettings(azimuth_deg=30.0, elevation_deg=elevation_deg))
    weight = solid_angles(ROWS) * np.maximum(sky_directions(ROWS)[..., 1], 0)
    on_ground = (sky.radiance * weight[..., None]).sum(axis=(0, 1)) + sky.sun_irradiance * sky.to_sun[1]
    assert on_ground @ LUMINANCE == pytest.approx(np.pi, rel=1e-5)
    assert (sky.radiance > 0).all()
    assert np.isfinite(sky.radiance).all()


def test_the_sky_is_bright_about_the_sun_and_blue_above():
    settings = SkySettings(azimuth_deg=120.0, elevation_deg=35.0)
    sky = make_sky(settings)
    luminance = sky.radiance @ LUMINANCE
    brightest = sky_directions(ROWS).reshape(-1, 3)[np.argmax(luminance)]
    assert brightest @ settings.to_sun > np.cos(np.radians(6))
    red, _, blue = sky.radiance[0, 0]
    assert blue > 1.8 * red
    low = make_sky(SkySettings(elevation_deg=5.0)).sun_irradiance
    assert low[2] / low[0] < 0.5 * sky.sun_irradiance[2] / sky.sun_irradiance[0]


@pytest.mark.parametrize("wrong", [{"azimuth_deg": 400.0}, {"elevation_deg": 0.0}, {"elevation_deg": float("nan")}])
def test_a_sun_that_cannot_be(wrong):
    with pytest.raises(ValueError, match="the sun's"):
        SkySettings(**wrong)
