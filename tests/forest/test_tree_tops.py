"""Single trees from above, on crowns that are known."""

import numpy as np
import pytest
from usdfoliage.forest.raster import Raster
from usdfoliage.forest.species import crown_colors
from usdfoliage.forest.tree_tops import TreeTopSettings, find_tops_of_canopy, find_tops_of_photo

from tests.support.forests.scene import COLORS, forest_scene, match


@pytest.mark.parametrize("noise_m", [0.0, 0.5])
def test_crowns_of_a_canopy_are_found_with_heights_and_radii(noise_m):
    scene = forest_scene()
    rng = np.random.default_rng(1)
    canopy = scene.canopy.values + noise_m * rng.standard_normal(scene.canopy.values.shape)
    if noise_m:
        canopy[rng.random(canopy.shape) < 0.05] = np.nan
    tops = find_tops_of_canopy(Raster(values=canopy, ground_from_pixel=scene.canopy.ground_from_pixel))
    found, true = match(tops.ground_m, scene.trees_m, 0.5 * scene.radius_m)
    assert len(true) >= 0.97 * len(scene.trees_m)
    assert len(found) >= 0.97 * len(tops.ground_m)
    assert np.abs(tops.height_m[found] / scene.height_m[true] - 1).mean() < 0.06
    assert np.median(np.abs(tops.radius_m[found] / scene.radius_m[true] - 1)) < 0.12


def test_crowns_of_a_photograph_under_clouds_are_found_with_their_radii():
    scene = forest_scene()
    tops = find_tops_of_photo(scene.orthophoto)
    found, true = match(tops.ground_m, scene.trees_m, 0.5 * scene.radius_m)
    assert len(true) >= 0.9 * len(scene.trees_m)
    assert len(found) >= 0.9 * len(tops.ground_m)
    assert np.isnan(tops.height_m).all()
    assert np.median(np.abs(tops.radius_m[found] / scene.radius_m[true] - 1)) < 0.2


def test_bare_ground_has_no_tree():
    flat = Raster(values=np.zeros((60, 60)), ground_from_pixel=forest_scene().dem.ground_from_pixel)
    assert len(find_tops_of_canopy(flat).ground_m) == 0
    grey = Raster(values=np.full((60, 60, 3), 0.2), ground_from_pixel=flat.ground_from_pixel)
    assert len(find_tops_of_photo(grey).ground_m) == 0


def test_the_color_of_a_crown_is_its_species():
    scene = forest_scene()
    colors = crown_colors(scene.orthophoto, scene.trees_m, scene.radius_m)
    ratio = colors[:, 0] / colors[:, 1]
    for kind in (0, 1):
        np.testing.assert_allclose(ratio[scene.species == kind], COLORS[kind, 0] / COLORS[kind, 1], rtol=0.05)


@pytest.mark.parametrize("radius_m", [(0.0, 2.0), (3.0, 2.0), (1.0, float("nan")), (1.0, float("inf"))])
def test_radii_that_cannot_be_are_refused(radius_m):
    with pytest.raises(ValueError, match="radii"):
        TreeTopSettings(radius_m=radius_m)
