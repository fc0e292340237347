"""Where trees, shrubs and grass are, on pictures that are painted: the classes are those of the paint."""

import numpy as np
import pytest
from usdfoliage.forest.raster import Raster
from usdfoliage.forest.vegetation_classes import (
    VegetationClasses,
    are_rough,
    find_classes,
    find_covered,
    find_hidden_trees,
    green_index,
    measure_texture,
)

LAWN, ROAD, WATER, LEAVES = (0.1, 0.2, 0.04), (0.25, 0.25, 0.25), (0.02, 0.04, 0.08), (0.06, 0.12, 0.03)
CELL_M = 0.25


@pytest.fixture
def rng():
    return np.random.default_rng(4)


PARTS = {"lawn": np.s_[8:72, 8:72], "crown": np.s_[8:72, 88:152], "road": np.s_[88:152, 8:72]}


def over(values, cell_m=CELL_M):
    matrix = np.array([[cell_m, 0, 1000.0], [0, -cell_m, 2000.0]])
    return Raster(values=np.asarray(values, np.float64), ground_from_pixel=matrix)


def painted(rng, light=1.0):
    """A lawn and a crown above, a road and water below, 40 m wide."""
    picture = np.empty((160, 160, 3))
    picture[:80, :80], picture[80:, :80], picture[80:, 80:] = LAWN, ROAD, WATER
    leaves = np.exp(0.8 * rng.standard_normal((80, 80, 1)))
    picture[:80, 80:] = LEAVES * leaves
    return over(light * picture)


def shares(classes, where):
    rows = [np.repeat(np.repeat(mask, 2, axis=0), 2, axis=1) for mask in (classes.tree, classes.shrub, classes.grass)]
    return [float(mask[where].mean()) for mask in rows]


def test_an_orthophoto_alone_shows_crowns_and_lawns(rng):
    for light in (1.0, 0.3):
        classes = find_classes(painted(rng, light), None)
        assert shares(classes, PARTS["lawn"])[2] > 0.95
        assert shares(classes, PARTS["crown"])[0] > 0.9
        assert shares(classes, PARTS["road"]) == [0, 0, 0]
        assert shares(classes, np.s_[88:152, 88:152]) == [0, 0, 0]


def test_light_and_shade_do_not_change_what_is_green():
    assert green_index(over(np.full((20, 20, 3), LAWN))) == pytest.approx((0.4 - 0.14) / 0.34)
    assert green_index(over(0.1 * np.full((20, 20, 3), LAWN))) == pytest.approx((0.4 - 0.14) / 0.34)
    assert green_index(over(np.full((20, 20, 3), ROAD))) == pytest.approx(0, abs=1e-6)


def test_heights_part_trees_from_shrubs_and_grass(rng):
    row, column = np.mgrid[:80, :80]
    bumps = 8 * np.cos(row / 2) ** 2 * np.cos(column / 2) ** 2 + 4
    canopy = np.zeros((160, 160))
    canopy[:80, :80] = 1.0  # a hedge as high as a man's hip, on the lawn
    canopy[:80, 80:] = bumps
    canopy[80:, :80] = 6 + 0.1 * column  # a roof
    classes = find_classes(painted(rng), over(canopy))
    assert classes.shrub[PARTS["lawn"]].mean() > 0.95
    assert classes.tree[PARTS["crown"]].mean() > 0.95
    assert not classes.tree[PARTS["road"]].any()
    assert classes.grass.mean() < 0.01
    low = find_classes(painted(rng), over(np.zeros((160, 160))))
    assert low.grass[PARTS["lawn"]].mean() > 0.95
    assert not low.tree.any()


def test_a_canopy_alone_takes_what_is_not_flat_for_trees_and_shows_no_grass(rng):
    canopy = np.full((80, 80), 5.0)
    canopy[:, 40:] += rng.normal(0, 1, (80, 40))
    classes = find_classes(None, over(canopy))
    assert classes.tree[:, 45:].all()
    assert not classes.tree[5:-5, :35].any()
    assert not classes.grass.any()
    assert find_classes(None, None) is None


def test_no_pixel_has_two_classes_and_what_is_not_seen_has_none(rng):
    picture = painted(rng)
    picture.values[:40, :40] = np.nan
    classes = find_classes(picture, None)
    assert (classes.tree.astype(int) + classes.shrub + classes.grass).max() == 1
    assert shares(classes, np.s_[:36, :36]) == [0, 0, 0]


def test_lawns_are_smooth_and_crowns_are_rough(rng):
    places_m = np.array([[1010.0, 1990.0], [1030.0, 1990.0]])
    assert are_rough(measure_texture(painted(rng)), places_m, np.array([3.0, 3.0])).tolist() == [False, True]


def test_trees_are_hidden_where_no_crown_is_seen_and_one_has_room():
    tree = np.zeros((80, 80), bool)
    tree[:, :40] = True  # 20 m wide
    tree[:, 60:63] = True  # 1.5 m
    grid = over(np.zeros((80, 80)), 0.5)
    classes = VegetationClasses(grid=grid, tree=tree, shrub=np.zeros_like(tree), grass=np.zeros_like(tree))
    none = find_hidden_trees(classes, np.zeros((0, 2)), np.zeros(0))
    assert none[:, :40].mean() > 0.95
    assert not none[:, 40:].any()
    seen = find_hidden_trees(classes, np.array([[1010.0, 1990.0]]), np.array([6.0]))
    assert not seen[20, 20]
    assert seen[70, 20]
    assert 0 < seen.sum() < none.sum()


def test_where_an_orthophoto_shows_nothing_heights_alone_decide(rng):
    picture = painted(rng)
    picture.values[:, 80:] = np.nan
    classes = find_classes(picture, over(np.full((160, 160), 1.0)))
    assert classes.shrub[PARTS["lawn"]].mean() > 0.95
    assert classes.shrub[PARTS["crown"]].mean() > 0.95
    assert not classes.shrub[PARTS["road"]].any()


def test_no_grass_is_found_where_no_height_is_known(rng):
    canopy = np.zeros((160, 160))
    canopy[:, 40:80] = np.nan
    classes = find_classes(painted(rng), over(canopy))
    assert classes.grass[10:70, 10:34].mean() > 0.95
    assert not classes.grass[:, 45:75].any()


def test_crowns_beside_what_is_not_seen_are_rough_by_what_is(rng):
    picture = painted(rng)
    picture.values[:, 120:] = np.nan
    places_m = np.array([[1010.0, 1990.0], [1030.0, 1990.0], [1025.0, 1985.0]])
    assert are_rough(measure_texture(picture), places_m, np.full(3, 3.0)).tolist() == [False, True, True]


def test_every_pixel_under_a_crown_is_covered(rng):
    grid = over(np.zeros((80, 80)), 0.5)
    ground_m = np.array([1020.0, 1980.0]) + rng.uniform(-12, 12, (12, 2))
    radius_m = rng.uniform(1.1, 3.9, 12)
    row, column = np.mgrid[:80, :80]
    places_m = np.stack([1000 + 0.5 * (column + 0.5), 2000 - 0.5 * (row + 0.5)], axis=-1)
    away_m = np.linalg.norm(places_m[:, :, None] - ground_m, axis=-1)
    found = find_covered(grid, np.ones((80, 80), bool), ground_m, radius_m)
    np.testing.assert_array_equal(found, (away_m < radius_m).any(axis=-1))
