"""A clear sky and its sun, as light on a forest."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROWS = 32  # of the picture; nothing in it is finer, and Storm filters it in time that grows with the fourth power
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec.709
# The CIE's sky 12, clear with little haze (ISO 15469).
GRADATION = (-1.0, -0.32)
INDICATRIX = (10.0, -3.0, 0.45)
ZENITH, HORIZON = np.array([0.32, 0.55, 1.0]), np.array([0.75, 0.88, 1.0])  # linear, of which luminance is taken off
SCATTERED = np.array([0.06, 0.12, 0.26])  # of red, green and blue sunlight, by one depth of the air
DIFFUSE = 0.15  # light of the sky on level ground, in that of the sun on a surface that faces it
EARTH = 0.2  # what the ground scatters back
SUN_WIDTH_DEG = 0.53


@dataclass(frozen=True, kw_only=True)
class SkySettings:
    """Where the sun is."""

    azimuth_deg: float = 150.0  # clockwise from north, -360 to 360
    elevation_deg: float = 40.0  # above the horizon, 1 to 90

    def __post_init__(self) -> None:
        if not -360 <= self.azimuth_deg <= 360:
            raise ValueError(f"the sun's azimuth must be -360 to 360 degrees, not {self.azimuth_deg:g}")
        if not 1 <= self.elevation_deg <= 90:
            raise ValueError(f"the sun's elevation must be 1 to 90 degrees, not {self.elevation_deg:g}")

    @property
    def to_sun(self) -> Floats:
        """(3,) unit vector in the frame of a forest: Y up, north to -Z, east to X."""
        turn, up = np.radians([self.azimuth_deg, self.elevation_deg])
        return np.array([np.sin(turn) * np.cos(up), np.sin(up), -np.cos(turn) * np.cos(up)])


@dataclass(frozen=True, kw_only=True, eq=False)
class Sky:
    """Light by direction; together it gives level ground pi, so that a white one is drawn as 1."""

    radiance: NDArray[np.float32]  # (ROWS, 2 ROWS, 3) linear Rec.709, latitude by longitude, without the sun
    to_sun: Floats  # (3,)
    sun_irradiance: Floats  # (3,) on a surface that faces the sun


def make_sky(settings: SkySettings = SkySettings()) -> Sky:
    """A clear sky about a sun, in a picture of latitude by longitude.

    The thesis' section 6.4.5 has a photograph on a dome, and wishes for a model. Our own: the CIE's clear sky, with a
    colour from zenith to horizon, and a sun that is redder the more air it shines through (Kasten and Young 1989).

    Args:
        settings: Where the sun is.
    """
    direction = sky_directions(ROWS)
    to_sun = settings.to_sun
    up = direction[..., 1]
    above = np.maximum(up, 0.01)
    apart = np.arccos(np.clip(direction @ to_sun, -1, 1))
    (a, b), (c, d, e) = GRADATION, INDICATRIX
    relative = (1 + a * np.exp(b / above)) * (
        1 + c * (np.exp(d * apart) - np.exp(d * np.pi / 2)) + e * np.cos(apart) ** 2
    )
    color = HORIZON + (ZENITH - HORIZON) * (above**0.5)[..., None]
    color = color / (color @ LUMINANCE)[..., None]
    sky = relative[..., None] * color * (up > 0)[..., None]
    on_ground = _on_level_ground(sky, direction)
    sun = np.exp(-SCATTERED * _air_mass(settings.elevation_deg))
    total = DIFFUSE + to_sun[1]  # in the sun's luminance
    sun_irradiance = sun / (sun @ LUMINANCE) * np.pi / total
    sky *= DIFFUSE * np.pi / total / (on_ground @ LUMINANCE)
    level = _on_level_ground(sky, direction) + sun_irradiance * to_sun[1]
    low = np.broadcast_to(EARTH * level / np.pi, sky.shape)
    return Sky(
        radiance=np.where((up > 0)[..., None], sky, low).astype(np.float32),
        to_sun=to_sun,
        sun_irradiance=sun_irradiance,
    )


def sky_directions(rows: int) -> Floats:
    """(rows, 2 rows, 3) unit vectors that the middles of a picture's texels look at: +Y on top, +Z in the middle.

    Longitude falls to the right, so that +X is a quarter from the left, as OpenEXR and UsdLux have it.
    """
    height = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)
    turn = 2 * np.pi * (np.arange(2 * rows) + 0.5) / (2 * rows) - np.pi / 2
    flat, level = np.cos(height)[:, None], np.ones(2 * rows)
    return np.stack([flat * np.cos(turn), np.sin(height)[:, None] * level, flat * np.sin(turn)], axis=-1)


def solid_angles(rows: int) -> Floats:
    """(rows, 1) of a texel of each row."""
    bounds = np.sin(np.pi * (0.5 - np.arange(rows + 1) / rows))
    return (-np.diff(bounds) * np.pi / rows)[:, None]


def _on_level_ground(radiance: Floats, direction: Floats) -> Floats:
    weight = solid_angles(len(radiance)) * np.maximum(direction[..., 1], 0)
    return np.asarray((radiance * weight[..., None]).sum(axis=(0, 1)))


def _air_mass(elevation_deg: float) -> float:
    """Depths of the air that the sun shines through."""
    return float(1 / (np.sin(np.radians(elevation_deg)) + 0.50572 * (elevation_deg + 6.07995) ** -1.6364))
