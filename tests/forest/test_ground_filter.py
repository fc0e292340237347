"""The ground below scans of houses and trees, whose heights a formula has."""

import numpy as np
import pytest
from usdfoliage.errors import FitError
from usdfoliage.forest.ground_filter import GroundSurface, are_on_ground, find_ground_surface
from usdfoliage.forest.ground_settings import GroundFilterSettings

from tests.support.forests.scans import GROUNDS, HOUSES, SIDE_M, scan_of, trees


def places_of(surface: GroundSurface) -> np.ndarray:
    """(rows, columns, 2) easting and northing of the middles of cells."""
    row, column = np.mgrid[: surface.frame.rows, : surface.frame.columns]
    offset = np.stack([column, surface.frame.rows - 1 - row], axis=-1)
    return surface.frame.low + surface.frame.cell * offset


def errors_of(surface: GroundSurface, ground: str) -> np.ndarray:
    return surface.heights_m - GROUNDS[ground](*np.moveaxis(places_of(surface), -1, 0))


def under_crowns(places: np.ndarray) -> np.ndarray:
    off = [np.hypot(*np.moveaxis(places - [x, y], -1, 0)) < radius for x, y, radius, _ in trees()]
    return np.any(off, axis=0)


def under_houses(places: np.ndarray) -> np.ndarray:
    inside = [(np.abs(places - [x, y]) < np.array([width, depth]) / 2).all(axis=-1) for x, y, width, depth, _ in HOUSES]
    return np.any(inside, axis=0)


@pytest.mark.parametrize("ground", sorted(GROUNDS))
def test_houses_trees_and_outliers_are_taken_off_and_slopes_stay(ground):
    surface = find_ground_surface(scan_of(ground))
    places = places_of(surface)
    error_m = errors_of(surface, ground)
    crowns, houses = under_crowns(places), under_houses(places)
    assert np.sqrt(np.mean(error_m[crowns & ~houses] ** 2)) <= 0.15
    assert np.sqrt(np.mean(error_m[~crowns & ~houses] ** 2)) <= 0.15
    assert not (surface.is_ground & houses & (error_m > 1)).any()


def test_the_order_of_points_does_not_matter_nor_where_the_scan_lies():
    scan = scan_of("hill")
    surface = find_ground_surface(scan)
    again = find_ground_surface(np.random.default_rng(1).permutation(scan))
    assert (again.heights_m == surface.heights_m).all()
    moved = find_ground_surface(scan + np.array([4096.0, 8192.0, 256.0]))
    assert (moved.is_ground == surface.is_ground).mean() > 0.999
    np.testing.assert_allclose(np.median(moved.heights_m - surface.heights_m), 256, atol=1e-6)


def test_points_near_the_surface_are_on_the_ground_at_right_angles_to_it():
    plan = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), axis=-1).reshape(-1, 2)
    surface = find_ground_surface(np.column_stack([plan, plan[:, 0]]))
    for above_m, expected in ((0.0, True), (0.45, True), (0.55, False), (-0.45, True), (-0.55, False)):
        points = np.column_stack([plan, plan[:, 0] + above_m])
        inner = ((plan > 2) & (plan < 37)).all(axis=1)
        assert (are_on_ground(surface, points, 0.35)[inner] == expected).all()


def test_a_house_that_is_wider_stays():
    x, y = np.meshgrid(np.arange(0.0, SIDE_M), np.arange(0.0, SIDE_M))
    z = np.where((np.abs(x - 80) < 15) & (np.abs(y - 80) < 15), 8.0, 0.0)
    scan = np.column_stack([x.reshape(-1), y.reshape(-1), z.reshape(-1)])
    assert np.abs(find_ground_surface(scan).heights_m).max() < 0.1
    kept = find_ground_surface(scan, GroundFilterSettings(widest_object_m=12.0))
    assert kept.heights_m.max() > 7


def test_scans_without_ground_are_refused():
    rng = np.random.default_rng(0)
    along, up = rng.uniform(0, 60, 5000), rng.uniform(0, 8, 5000)
    wall = np.column_stack([0.8 * along, 0.6 * along, up]) + rng.normal(0, 0.02, (5000, 3))
    with pytest.raises(FitError, match="line"):
        find_ground_surface(wall)
    with pytest.raises(FitError, match="with points: 3, and 25"):
        find_ground_surface(np.array([[0.0, 0, 0], [5, 0, 0], [0, 5, 0]]))
    with pytest.raises(FitError, match="no points"):
        find_ground_surface(np.zeros((0, 3)))
    with pytest.raises(ValueError, match="finite"):
        find_ground_surface(np.full((100, 3), np.nan))
    with pytest.raises(ValueError, match=r"\(N, 3\)"):
        find_ground_surface(np.zeros((5, 2)))


@pytest.mark.parametrize(
    "change",
    [
        {"cell_m": 0.0},
        {"widest_object_m": 3.0},
        {"widest_object_m": np.nan},
        {"slope": -1.0},
        {"near_m": np.inf},
        {"step_m": -0.1},
    ],
)
def test_settings_that_cannot_be_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        GroundFilterSettings(**change)
