"""How dark the ground is under plants, against the closed form of a disc overhead."""

import numpy as np
import pytest
from usdfoliage.forest.contact import ContactSettings, disc_share, open_sky
from usdfoliage.forest.raster import Raster, pixel_grid, sample_nearest

ORIGIN_M = np.array([455_000.0, 4_660_000.0])


def grid(across_m: float = 0.1, down_m: float = 0.1, size: tuple[int, int] = (301, 301)) -> Raster:
    """Pixels about the origin: the middle of the middle one is at it."""
    rows, columns = size
    west_north = ORIGIN_M + np.array([-across_m * columns, down_m * rows]) / 2
    matrix = np.array([[across_m, 0, west_north[0]], [0, -down_m, west_north[1]]])
    return Raster(values=np.zeros(size), ground_from_pixel=matrix)


def darkened(onto: Raster, places_m, radius_m, height_m, settings=ContactSettings()) -> np.ndarray:
    places = ORIGIN_M + np.array(places_m, float).reshape(-1, 2)
    return open_sky(onto, places, np.full(len(places), radius_m), np.full(len(places), height_m), settings)


@pytest.mark.parametrize("height", [0.2, 1.0, 3.0])
def test_a_disc_overhead_takes_the_share_of_a_cone(height):
    assert disc_share(np.zeros(1), np.full(1, height**2))[0] == pytest.approx(1 / (1 + height**2))
    # By the sky's own directions: those that meet the disc, each by the cosine from the vertical.
    across, turn = np.meshgrid(np.sqrt((np.arange(400) + 0.5) / 400), 2 * np.pi * (np.arange(400) + 0.5) / 400)
    reach = height * across / np.sqrt(1 - across**2)
    for away in (0.5, 1.0, 2.0):
        meets = (reach * np.cos(turn) - away) ** 2 + (reach * np.sin(turn)) ** 2 < 1
        assert disc_share(np.full(1, away**2), np.full(1, height**2))[0] == pytest.approx(meets.mean(), abs=2e-3)


def test_one_plant_darkens_its_middle_and_its_edge_as_a_disc_does():
    settings = ContactSettings(opacity=0.8, base_share=0.25, reach=3.0)
    onto = grid()
    sky = darkened(onto, [[0, 0]], 2.0, 8.0, settings)  # a disc of 2 m, 2 m above the ground
    assert sky[150, 150] == pytest.approx(1 - 0.8 * 0.5, abs=1e-6)
    at_edge = 0.8 * 0.5 * (1 - 1 / np.sqrt(5)) * (1 - 1 / 9) ** 2
    for pixel in ((150, 170), (150, 130), (130, 150), (170, 150)):
        assert sky[pixel] == pytest.approx(1 - at_edge, abs=1e-6)
    away_m = np.linalg.norm(pixel_grid(onto) - ORIGIN_M, axis=-1)
    assert (sky[away_m >= 6.0] == 1).all()
    assert (sky[away_m < 5.5] < 1).all()
    along = sky[150, 150:]
    assert (np.diff(along) >= 0).all()
    assert np.abs(np.diff(along)).max() < 0.03  # no edge


def test_crowns_multiply_and_the_order_does_not_matter():
    places = [[0.0, 0.0], [1.3, 0.4], [-2.0, 1.0]]
    onto = grid()
    alone = [darkened(onto, [place], 1.5, 6.0) for place in places]
    both = darkened(onto, places, 1.5, 6.0)
    np.testing.assert_allclose(both, np.prod(alone, axis=0), atol=1e-6)
    np.testing.assert_allclose(darkened(onto, places[::-1], 1.5, 6.0), both, atol=1e-6)


def test_pixels_that_are_no_squares_show_the_same_ground():
    fine = darkened(grid(), [[0.7, -0.3]], 2.0, 8.0)
    onto = grid(0.3, 0.1, (301, 101))
    np.testing.assert_allclose(darkened(onto, [[0.7, -0.3]], 2.0, 8.0)[150], fine[150, ::3], atol=1e-6)
    turned = grid()
    matrix = np.array([[0.06, 0.08, 0], [0.08, -0.06, 0]])
    matrix[:, 2] = ORIGIN_M - matrix[:, :2] @ [150.5, 150.5]
    turned = Raster(values=turned.values, ground_from_pixel=matrix)
    sky = darkened(turned, [[0.7, -0.3]], 2.0, 8.0)
    away_m = np.linalg.norm(pixel_grid(turned) - ORIGIN_M - [0.7, -0.3], axis=-1)
    near = np.unravel_index(np.argmin(away_m), away_m.shape)
    assert sky.min() == pytest.approx(sky[near], abs=1e-3)
    assert (sky[away_m >= 6.0] == 1).all()


def test_plants_smaller_than_a_pixel_darken_as_much_in_all():
    coarse, fine = grid(1.0, 1.0, (31, 31)), grid(0.05, 0.05, (620, 620))
    lost = [float(np.log(darkened(each, [[0.2, 0.1]], 0.2, 0.5)).sum() * each.cell_m**2) for each in (coarse, fine)]
    assert lost[0] == pytest.approx(lost[1], rel=0.35)
    assert darkened(coarse, [[0, 0]], 0.2, 0.5).min() > 0.9


def test_plants_at_the_border_and_beyond_and_none_at_all():
    onto = grid(0.5, 0.5, (21, 21))
    assert (darkened(onto, [], 1.0, 5.0) == 1).all()
    sky = darkened(onto, [[5.2, 0], [40, 0]], 1.5, 5.0)
    assert sky.min() < 1
    assert sample_nearest(Raster(values=sky, ground_from_pixel=onto.ground_from_pixel), ORIGIN_M[None])[0] == 1


@pytest.mark.parametrize("wrong", [{"opacity": 1.2}, {"base_share": 0.0}, {"reach": 1.0}])
def test_settings_that_cannot_be(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ContactSettings(**wrong)
