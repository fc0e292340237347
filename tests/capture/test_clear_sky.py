"""Sky that is left out before matching, and what only looks like it."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.capture.clear_sky import ClearSkySettings, elevations_deg, find_clear_sky
from usdfoliage.geometry.pinhole import Pinhole

SIZE = (120, 160)


def photo(noise: float, top: tuple[int, int, int] = (150, 190, 235)):
    """A tree of one trunk and a disc before a smooth backdrop over textured ground; and where the backdrop is seen."""
    rng = np.random.default_rng(0)
    picture = np.empty((*SIZE, 3), np.float32)
    picture[:] = top
    picture += np.linspace(0, 15, SIZE[0])[:, None, None]
    backdrop = np.ones(SIZE, np.uint8)
    cv2.circle(backdrop, (80, 50), 25, 0, -1)
    cv2.line(backdrop, (80, 50), (80, 110), 0, 3)
    backdrop[90:] = 0
    coarse = cv2.resize(rng.normal(size=(60, 80)).astype(np.float32), SIZE[::-1])
    green = np.array([60, 110, 50]) + 40 * coarse[..., None] + rng.normal(scale=12, size=(*SIZE, 3))
    picture[backdrop == 0] = green[backdrop == 0]
    picture[backdrop > 0] += rng.normal(scale=noise, size=(*SIZE, 3))[backdrop > 0]
    return np.clip(picture, 0, 255).astype(np.uint8), backdrop > 0


@pytest.mark.parametrize("top", [(150, 190, 235), (235, 235, 235), (90, 130, 200)])
def test_sky_is_found_and_the_tree_kept(top):
    picture, backdrop = photo(0.5, top)
    sky = find_clear_sky(picture)
    edge = cv2.dilate(1 - backdrop.astype(np.uint8), np.ones((7, 7))) > 0
    assert np.mean(sky[backdrop & ~edge]) > 0.95
    assert not sky[~backdrop].mean() > 0.01


def test_a_wall_is_no_sky():
    picture, _ = photo(14, (165, 165, 165))
    assert find_clear_sky(picture) is None


def test_pictures_without_sky_have_none():
    rng = np.random.default_rng(0)
    assert find_clear_sky(rng.integers(0, 256, (*SIZE, 3), dtype=np.uint8)) is None
    assert find_clear_sky(np.zeros((*SIZE, 3), np.uint8)) is None


def test_the_same_photograph_has_the_same_sky():
    picture, _ = photo(0.5)
    np.testing.assert_array_equal(find_clear_sky(picture), find_clear_sky(picture))


def test_settings_that_cannot_be():
    with pytest.raises(ValueError, match="max_texture"):
        ClearSkySettings(max_texture=-1)
    assert find_clear_sky(photo(0.5)[0], ClearSkySettings(max_texture=0)) is None


def pitched(degrees):
    """A camera in a world with Z up, that looks so far over the horizon."""
    level = np.array([(1, 0, 0), (0, 0, -1), (0, 1, 0)])  # right, down and ahead in the world
    turn = Rotation.from_euler("x", -degrees, degrees=True).as_matrix() @ level
    pose = np.column_stack([turn, np.zeros(3)])
    height, width = SIZE
    center_px = (width / 2, height / 2)
    return Pinhole(width_px=width, height_px=height, focal_px=(100, 100), center_px=center_px, cam_from_world=pose)


def test_elevations_are_those_of_the_lines_of_sight():
    up = np.array([0, 0, 1])
    at = elevations_deg(pitched(0), up)
    assert at[0, 80] == pytest.approx(np.degrees(np.arctan2(59.5, 100)), abs=0.01)
    assert at[-1, 80] == pytest.approx(-at[0, 80])
    assert elevations_deg(pitched(30), up)[59:61, 79:81].mean() == pytest.approx(30, abs=0.1)


def test_what_lies_below_the_horizon_is_no_sky():
    picture, _ = photo(0.5)
    everywhere = find_clear_sky(picture)
    up = np.array([0, 0, 1])
    assert find_clear_sky(picture, elevation_deg=elevations_deg(pitched(-75), up)) is None  # a road seen by a drone
    level = elevations_deg(pitched(0), up)
    settings = ClearSkySettings(below_horizon_deg=0)
    np.testing.assert_array_equal(
        find_clear_sky(picture, settings, elevation_deg=level), everywhere & (np.arange(SIZE[0]) < 60)[:, None]
    )
    np.testing.assert_array_equal(find_clear_sky(picture, elevation_deg=elevations_deg(pitched(60), up)), everywhere)
    with pytest.raises(ValueError, match="below_horizon_deg"):
        ClearSkySettings(below_horizon_deg=-1)
