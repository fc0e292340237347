"""The ground of an orthophoto without the crowns above it."""

import numpy as np
import pytest
from usdfoliage.forest.clear_ground import ClearGroundSettings, clear_crowns
from usdfoliage.forest.raster import Raster, pixel_grid

FRAME = np.array([[0.5, 0.0, 1000.0], [0.0, -0.5, 5000.0]])
GROUND, CROWN = np.array([0.3, 0.25, 0.1]), np.array([0.9, 0.2, 0.02])


def photo_with_crowns(size: int, centers_m, radius_m, noise: float = 0.0):
    """An orthophoto of even ground with round crowns, and which pixels show these."""
    rng = np.random.default_rng(3)
    raster = Raster(values=np.zeros((size, size)), ground_from_pixel=FRAME)
    away_m = np.linalg.norm(pixel_grid(raster)[:, :, None] - np.asarray(centers_m), axis=-1)
    crowns = (away_m < radius_m).any(axis=-1)
    ground = GROUND * (1 + noise * rng.standard_normal((size, size, 1)))
    return Raster(values=np.where(crowns[..., None], CROWN, ground), ground_from_pixel=FRAME), crowns


CENTERS_M = [(1020.0, 4980.0), (1050.0, 4950.0), (1048.0, 4955.0), (999.5, 4930.0)]
RADII_M = [4.0, 6.0, 3.0, 5.0]  # the last crown lies across the edge


def test_even_ground_is_even_below_crowns_and_the_rest_stays():
    photo, crowns = photo_with_crowns(160, CENTERS_M, RADII_M)
    cleared = clear_crowns(photo, np.array(CENTERS_M), np.array(RADII_M)).values
    np.testing.assert_allclose(cleared, np.broadcast_to(GROUND, cleared.shape), rtol=2e-3)
    assert crowns.mean() > 0.02


def test_ground_that_varies_varies_below_crowns_too():
    photo, crowns = photo_with_crowns(160, CENTERS_M, RADII_M, noise=0.1)
    cleared = clear_crowns(photo, np.array(CENTERS_M), np.array(RADII_M)).values
    far = ~crowns
    assert np.std(cleared[crowns, 1]) == pytest.approx(np.std(cleared[far, 1]), rel=0.35)
    np.testing.assert_allclose(cleared[crowns].mean(axis=0), GROUND, rtol=0.05)


def test_colours_follow_a_slope_of_colours():
    size = 128
    photo, _ = photo_with_crowns(size, [(1032.0, 4968.0)], [8.0])
    slope = np.linspace(0.1, 0.5, size)[None, :, None] * np.ones((size, 1, 3))
    values = np.where((photo.values == CROWN).all(axis=-1)[..., None], CROWN, slope)
    sloped = Raster(values=values, ground_from_pixel=FRAME)
    cleared = clear_crowns(sloped, np.array([(1032.0, 4968.0)]), np.array([8.0])).values
    assert np.abs(cleared - slope).max() < 0.1


def test_a_larger_picture_is_filled_from_a_smaller_copy():
    photo, _ = photo_with_crowns(160, CENTERS_M, RADII_M)
    settings = ClearGroundSettings(max_side_px=64)
    cleared = clear_crowns(photo, np.array(CENTERS_M), np.array(RADII_M), settings=settings).values
    assert cleared.shape == (160, 160, 3)
    np.testing.assert_allclose(cleared, np.broadcast_to(GROUND, cleared.shape), rtol=0.02)


def test_where_crowns_hide_all_ground_or_there_are_none_nothing_changes():
    photo, _ = photo_with_crowns(64, [(1016.0, 4984.0)], [60.0])
    assert clear_crowns(photo, np.array([(1016.0, 4984.0)]), np.array([60.0])) is photo
    assert clear_crowns(photo, np.zeros((0, 2)), np.zeros(0)) is photo


def test_the_same_seed_gives_the_same_picture():
    photo, _ = photo_with_crowns(100, CENTERS_M, RADII_M, noise=0.1)
    pictures = [clear_crowns(photo, np.array(CENTERS_M), np.array(RADII_M), seed).values for seed in (1, 1, 2)]
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])


@pytest.mark.parametrize("wrong", [{"wider": 0.0}, {"soft": -1.0}, {"max_side_px": 4}])
def test_settings_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ClearGroundSettings(**wrong)
