"""Crowns of an orthophoto alone, that a sun lights."""

import numpy as np
import pytest
from scipy import ndimage
from usdfoliage.forest.crown_search import crown_radii, find_crowns, find_sun
from usdfoliage.forest.raster import Raster, pixel_grid
from usdfoliage.forest.species import are_of_leaves

from tests.support.forests.scene import match

SIDE_PX, CELL_M = 240, 0.25


def lit_crowns(sun_deg: float) -> tuple[Raster, np.ndarray, np.ndarray]:
    """Half balls of leaves, darker than the lawn around them, with the light of a sun 45 degrees high and shadows."""
    frame = np.array([[CELL_M, 0, 1000.0], [0, -CELL_M, 2000.0]])
    ground_m = pixel_grid(Raster(values=np.zeros((SIDE_PX, SIDE_PX)), ground_from_pixel=frame))
    places_m = np.array([[1000.0 + x, 2000.0 - y] for x in (10, 25, 40, 52) for y in (10, 25, 40, 52)])
    radius_m = np.linspace(1.5, 3.5, len(places_m))
    to_sun = np.array([np.sin(np.radians(sun_deg)), np.cos(np.radians(sun_deg))])
    light, crown = np.full((SIDE_PX, SIDE_PX), 0.9), np.zeros((SIDE_PX, SIDE_PX), bool)
    for place, radius in zip(places_m, radius_m, strict=True):
        off = ground_m - place
        along, across = off @ to_sun, off @ np.array([to_sun[1], -to_sun[0]])
        light[(np.abs(across) < radius) & (along < 0) & (along > -3 * radius)] = 0.3
    for place, radius in zip(places_m, radius_m, strict=True):
        off = (ground_m - place) / radius
        up = np.sqrt(np.clip(1 - (off**2).sum(axis=-1), 0, 1))
        inside = up > 0
        light[inside] = (0.3 + np.clip(off @ to_sun + up, 0, None) * np.sqrt(0.5))[inside]
        crown |= inside
    leaves = ndimage.gaussian_filter(np.random.default_rng(0).standard_normal(crown.shape), 0.7)
    light *= np.exp(np.where(crown, 0.4, 0.05) * leaves)
    colors = light[..., None] * np.where(crown[..., None], (0.08, 0.13, 0.05), (0.16, 0.18, 0.08))
    return Raster(values=colors, ground_from_pixel=frame), places_m, radius_m


@pytest.mark.parametrize("sun_deg", [40.0, 160.0, 290.0])
def test_crowns_are_found_with_the_sun_that_lights_them(sun_deg):
    photo, places_m, radius_m = lit_crowns(sun_deg)
    off_deg = (find_sun(photo, (1.0, 5.0)) - sun_deg + 180) % 360 - 180
    assert abs(off_deg) < 25
    crowns = find_crowns(photo, (1.0, 5.0))
    found, true = match(crowns.ground_m, places_m, 0.5 * radius_m)
    assert len(true) >= 0.85 * len(places_m)
    assert len(found) >= 0.75 * len(crowns.ground_m)
    assert np.median(crowns.radius_m[found] / radius_m[true]) == pytest.approx(1, abs=0.15)


def test_nothing_is_found_where_nothing_is_seen():
    photo, _places_m, _radius_m = lit_crowns(0.0)
    blank = Raster(values=np.full_like(photo.values, np.nan), ground_from_pixel=photo.ground_from_pixel)
    assert len(find_crowns(blank, (1.0, 5.0)).ground_m) == 0


def test_radii_are_no_finer_than_pixels():
    radii = np.array(crown_radii((0.9, 7.0), 0.25))
    assert radii[0] == pytest.approx(0.9)
    assert radii[-1] == pytest.approx(7.0, rel=0.1)
    assert crown_radii((0.9, 7.0), 2.0)[0] == pytest.approx(3.0)
    assert len(crown_radii((0.9, 1.5), 2.0)) == 1


def test_roads_and_shadows_are_of_no_leaves():
    colors = np.array([[0.11, 0.155, 0.047], [0.22, 0.13, 0.033], [0.17, 0.165, 0.16], [0.03, 0.04, 0.06]])
    assert are_of_leaves(colors).tolist() == [True, True, False, False]
