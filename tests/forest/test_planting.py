"""A whole planting of a terrain whose trees are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from usdfoliage.forest.kinds import PlantKind
from usdfoliage.forest.planting import ForestInput, PlantingSettings, plant_forest
from usdfoliage.forest.plants_file import PlantRow, PlantsFile
from usdfoliage.forest.raster import Raster
from usdfoliage.forest.terrain import ground_height, make_terrain

from tests.support.forests.scene import COLORS, ORIGIN_M, forest_scene, match


def plants(*more: PlantRow) -> PlantsFile:
    rows = [
        PlantRow(
            species=name,
            kind=PlantKind.TREE,
            asset=Path("x"),
            share=share,
            height_m=(5.0, 14.0),
            color=tuple(color),
            form=0.28,
        )
        for name, share, color in zip(("oak", "maple"), (0.75, 0.25), COLORS.tolist(), strict=True)
    ]
    classes = {0: None, 1: PlantKind.TREE, 2: PlantKind.SHRUB, 3: PlantKind.GRASS}
    return PlantsFile(path=Path("plants.toml"), rows=(*rows, *more), classes=classes)


def scene_input(**leave_out) -> ForestInput:
    scene = forest_scene()
    given = ForestInput(
        terrain=make_terrain(scene.dem),
        plants=plants(),
        orthophoto=scene.orthophoto,
        canopy=scene.canopy,
        vegetation=scene.vegetation,
    )
    return replace(given, **leave_out)


def test_trees_stand_where_they_are_seen_with_species_heights_and_tints():
    scene, given = forest_scene(), scene_input()
    planted = plant_forest(given)
    found, true = match(planted.ground_m, scene.trees_m, 0.5 * scene.radius_m)
    assert len(true) >= 0.97 * len(scene.trees_m)
    assert (planted.row[found] == scene.species[true]).mean() > 0.97
    assert np.abs(planted.height_m[found] / scene.height_m[true] - 1).mean() < 0.06
    np.testing.assert_allclose(planted.elevation_m, ground_height(given.terrain, planted.ground_m))
    assert np.corrcoef(planted.tint[found, 0], scene.species[true])[0, 1] > 0.9
    assert planted.seen.all()
    assert planted.empty_kinds == (PlantKind.GRASS,)


def test_the_orthophoto_alone_gives_trees_and_their_heights_by_their_form():
    scene = forest_scene()
    planted = plant_forest(scene_input(canopy=None, vegetation=None))
    _found, true = match(planted.ground_m, scene.trees_m, 0.5 * scene.radius_m)
    assert len(true) >= 0.85 * len(scene.trees_m)
    assert ((planted.height_m >= 5) & (planted.height_m <= 14)).all()


def test_grass_is_found_where_no_raster_of_classes_is_given():
    scene = forest_scene()
    color = scene.orthophoto.values.copy()
    color[scene.canopy.values == 0] = (0.1, 0.2, 0.04)
    road = (scene.canopy.values == 0) & (np.arange(len(color)) < 40)
    color[road] = 0.25
    grass = PlantRow(
        species="fescue", kind=PlantKind.GRASS, asset=Path("x"), share=1.0, height_m=(0.3, 0.6), color=None, form=None
    )
    given = scene_input(vegetation=None, plants=plants(grass), orthophoto=replace(scene.orthophoto, values=color))
    found, without = (plant_forest(given, PlantingSettings(find_classes=each)) for each in (True, False))
    assert found.found_shares[PlantKind.TREE] == pytest.approx((scene.canopy.values >= 2).mean(), abs=0.02)
    assert found.found_shares[PlantKind.GRASS] > 0.3
    assert not without.found_shares
    kinds = np.array([row.kind for row in given.plants.rows])
    is_grass = kinds[found.row] == PlantKind.GRASS
    assert is_grass.sum() > 100
    assert (found.ground_m[is_grass, 0] > ORIGIN_M[0] + 19).all()  # none on the road
    assert not (kinds[without.row] == PlantKind.GRASS).any()
    np.testing.assert_allclose(found.ground_m[~is_grass], without.ground_m)


def test_what_is_found_in_the_pictures_needs_no_code_of_the_user():
    given = scene_input(vegetation=None)
    renamed = replace(given.plants, classes={1: None, 7: PlantKind.TREE})
    np.testing.assert_allclose(plant_forest(replace(given, plants=renamed)).ground_m, plant_forest(given).ground_m)


def test_a_class_alone_is_planted_by_its_density():
    given = scene_input(canopy=None, orthophoto=None)
    planted = plant_forest(given, PlantingSettings(trees_per_ha=400))
    area_ha = (given.vegetation.values == 1).sum() * given.vegetation.cell_m**2 / 1e4
    assert len(planted) == pytest.approx(400 * area_ha, rel=0.25)
    assert not planted.seen.any()
    columns = np.floor((planted.ground_m[:, 0] - ORIGIN_M[0]) / 0.5).astype(int)
    rows = np.floor((ORIGIN_M[1] - planted.ground_m[:, 1]) / 0.5).astype(int)
    assert (given.vegetation.values[rows, columns] == 1).all()


def test_trunks_that_are_given_stand_where_they_are_given():
    scene = forest_scene()
    planted = plant_forest(scene_input(trunks_m=scene.trees_m[:9], vegetation=None))
    np.testing.assert_allclose(planted.ground_m, scene.trees_m[:9])
    assert np.abs(planted.height_m / scene.height_m[:9] - 1).max() < 0.15


def test_rules_of_the_ground_and_holes_leave_plants_out():
    low = replace(plants(), rows=tuple(replace(row, elevation_m=(0.0, 302.0)) for row in plants().rows))
    planted = plant_forest(scene_input(plants=low))
    assert len(planted) > 0
    assert (planted.elevation_m <= 302.0).all()
    assert planted.not_planted["no row of plants.toml may stand there"] > 0
    scene = forest_scene()
    heights = scene.dem.values.copy()
    heights[:, :60] = np.nan
    terrain = make_terrain(Raster(values=heights, ground_from_pixel=scene.dem.ground_from_pixel))
    planted = plant_forest(scene_input(terrain=terrain))
    assert (planted.ground_m[:, 0] > ORIGIN_M[0] + 30).all()
    assert planted.not_planted["no height of the ground"] > 0


def test_plants_keep_the_distance_from_water_that_their_rows_ask_for():
    scene = forest_scene()
    codes = scene.vegetation.values.copy()
    codes[:, :4] = 9.0  # 2 m of water along the western side
    near = replace(plants(), rows=tuple(replace(row, water_m=(3.0, 20.0)) for row in plants().rows))
    near = replace(near, classes={**near.classes, 9: None}, water=frozenset({9}))
    planted = plant_forest(scene_input(plants=near, vegetation=replace(scene.vegetation, values=codes)))
    from_water_m = planted.ground_m[:, 0] - ORIGIN_M[0] - 2.0
    assert len(planted) > 5
    assert from_water_m.min() > 2.4
    assert from_water_m.max() < 20.6


def test_grass_is_drawn_in_its_class_up_to_the_number_that_may_be():
    grass = PlantRow(species="sedge", kind=PlantKind.GRASS, asset=Path("x"), share=1.0, height_m=(0.3, 0.5))
    planted = plant_forest(scene_input(plants=plants(grass)), PlantingSettings(max_ground_cover=500))
    assert 300 < (planted.row == 2).sum() <= 500
    assert planted.empty_kinds == ()


def test_one_seed_is_one_forest_and_another_turns_its_trees():
    one, again, other = (plant_forest(scene_input(), PlantingSettings(seed=seed)) for seed in (1, 1, 2))
    for name in ("ground_m", "row", "height_m", "turn_deg", "lean_deg", "tint", "jitter"):
        np.testing.assert_array_equal(getattr(one, name), getattr(again, name))
    np.testing.assert_array_equal(one.ground_m, other.ground_m)
    assert (one.turn_deg != other.turn_deg).any()


def test_without_anything_that_shows_plants_there_are_none():
    planted = plant_forest(scene_input(canopy=None, orthophoto=None, vegetation=None))
    assert len(planted) == 0
    assert planted.ground_m.shape == (0, 2)


def test_with_coarse_classes_trees_stay_apart_where_they_are_seen():
    scene, given = forest_scene(), scene_input()
    fine = given.vegetation.values == 1
    coarse = fine.reshape(16, 10, 16, 10).any(axis=(1, 3)).astype(float)
    matrix = given.vegetation.ground_from_pixel.copy()
    matrix[:, :2] *= 10
    planted = plant_forest(replace(given, vegetation=Raster(values=coarse, ground_from_pixel=matrix)))
    assert len(planted) >= 0.97 * len(scene.trees_m)
    assert len(np.unique(planted.ground_m, axis=0)) == len(planted)


def test_a_canopy_alone_keeps_the_shares_where_forms_do_not_differ():
    rows = plants().rows
    wide = replace(plants(), rows=tuple(replace(row, share=share) for row, share in zip(rows, (0.7, 0.3), strict=True)))
    shares = []
    for seed in range(10):
        planted = plant_forest(scene_input(plants=wide, orthophoto=None), PlantingSettings(seed=seed, patch_m=8))
        shares.append((planted.row == 1).mean())
    assert np.mean(shares) == pytest.approx(0.3, abs=0.1)
