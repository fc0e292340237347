"""Blades of grass of a shot: where they lie in an asset, what counts them, and what does not."""

import json

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade
from usdfoliage.__main__ import main
from usdfoliage.asset.packages.forest_contents import read_forest
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.forest.raster import sample_nearest

from tests.support.forests.scene import forest_scene
from tests.support.forests.shots import forest_words, write_shot


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("grass")


@pytest.fixture(scope="module")
def words(folder):
    """Of a forest whose camera is a few metres above the middle of its ground."""
    words = [*forest_words(folder), "--lod-distance", "30", "70"]
    bare = folder / "bare"
    assert main([*words, "-o", str(bare)]) == 0
    stage = Usd.Stage.Open(str(bare / "bare.usda"))
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/bare/terrain")).GetPointsAttr().Get())
    middle = points[np.argmin(np.hypot(points[:, 0], points[:, 2]))]
    write_shot(folder / "shot010.usda", [(0, middle[1] + 2, z) for z in (6.0, 3.0, 0.0)])
    write_shot(folder / "high.usda", [(0, middle[1] + 90, 0)], towards=(0.0, -1.0, -1.0))
    return words


def make(folder, words, name, *more, shot="shot010"):
    out = folder / name / "valley"
    assert main([*words, "--camera", str(folder / f"{shot}.usda"), *more, "-o", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def forest(folder, words):
    return make(folder, words, "one")


def clumps(out, level="shot010"):
    """The instancers of grass in a level, by their paths."""
    stage = Usd.Stage.Open(str(out / "valley.usda"))
    stage.GetDefaultPrim().GetVariantSet("level").SetVariantSelection(level)
    found = [UsdGeom.PointInstancer(prim) for prim in stage.Traverse() if prim.GetName() == "grass"]
    return stage, found


def test_clumps_stand_on_the_ground_in_the_variant_of_the_shot_alone(forest):
    for level in ("crown", "leaves"):
        assert not clumps(forest, level)[1]
    stage, (grass,) = clumps(forest)
    position = np.array(grass.GetPositionsAttr().Get(), float)
    assert 1000 < len(position) <= 100_000
    back = np.linalg.inv(np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get()))
    ground = (np.column_stack([position, np.ones(len(position))]) @ back)[:, :3]
    scene = forest_scene()
    assert np.isin(sample_nearest(scene.vegetation, ground[:, :2]), (1, 3)).all()
    dem = 300 + 0.1 * (ground[:, 0] - 455_000) + 0.05 * (ground[:, 1] - 4_660_000)
    np.testing.assert_allclose(ground[:, 2], dem, atol=2e-3)
    extent = np.array(grass.GetExtentAttr().Get())
    exact = np.array(grass.ComputeExtentAtTime(0, 0))
    assert (extent[0] <= exact[0] + 1e-4).all()
    assert (extent[1] >= exact[1] - 1e-4).all()
    hint = np.array(stage.GetDefaultPrim().GetAttribute("extentsHint").Get())[:2]
    assert (hint[0] <= extent[0]).all()
    assert (hint[1] >= extent[1]).all()


def test_their_colour_is_that_of_the_orthophoto_and_every_renderer_has_a_material(forest):
    stage, (grass,) = clumps(forest)
    primvars = UsdGeom.PrimvarsAPI(grass)
    tint = np.array(primvars.GetPrimvar("tint").Get())
    count = len(grass.GetPositionsAttr().Get())
    assert tint.shape == (count, 3)
    position = np.array(grass.GetPositionsAttr().Get(), float)
    back = np.linalg.inv(np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get()))
    ground = (np.column_stack([position, np.ones(count)]) @ back)[:, :2]
    photo = sample_nearest(forest_scene().orthophoto, ground)
    assert np.median(np.abs(tint / photo - 1)) < 0.2
    open_sky = np.array(primvars.GetPrimvar("openSky").ComputeFlattened())
    assert len(open_sky) == count
    assert 0 < open_sky.min() < 0.8 < open_sky.max() <= 1
    for path in grass.GetPrototypesRel().GetTargets():
        mesh = stage.GetPrimAtPath(path)
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        for context, name in (("glslfx", "StormSurface"), ("mtlx", "MtlxSurface"), ("", "PreviewSurface")):
            assert material.ComputeSurfaceSource(context)[0].GetPrim().GetName() == name
    storm = material.ComputeSurfaceSource("glslfx")[0]
    assert storm.GetSourceAsset("glslfx").resolvedPath


def test_the_asset_is_valid_and_grass_is_no_plant(forest, capsys):
    report = validate_asset(forest, read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []
    capsys.readouterr()
    _stage, (grass,) = clumps(forest)
    look = forest.parent / "shot.usda"
    shot = Usd.Stage.CreateNew(str(look))
    over = shot.DefinePrim("/valley")
    over.GetReferences().AddReference("./valley/valley.usda")
    over.GetVariantSet("level").SetVariantSelection("shot010")
    shot.SetDefaultPrim(over)
    UsdGeom.SetStageMetersPerUnit(shot, 1.0)
    UsdGeom.SetStageUpAxis(shot, UsdGeom.Tokens.y)
    shot.Save()
    plain_stage = Usd.Stage.Open(str(forest / "valley.usda"))
    chosen, plain = (read_forest(each.GetDefaultPrim()) for each in (shot, plain_stage))
    assert chosen.terrain_faces == plain.terrain_faces
    assert set(chosen.plants) == set(plain.plants)
    assert sum(chosen.plants.values()) <= sum(plain.plants.values())
    assert not grass.GetPrim().HasAttribute("foliage:forest:species")


def test_it_is_counted_and_the_same_again(forest, folder, words, capsys):
    capsys.readouterr()
    again = make(folder, words, "again", "--json")
    made = json.loads(capsys.readouterr().out)
    _stage, (grass,) = clumps(forest)
    count = len(grass.GetPositionsAttr().Get())
    text = json.dumps(made)
    assert f"{count:,}" in text
    assert "clumps of grass, shot010" in text
    assert f"{count:,}" in (forest / "report" / "index.html").read_text("utf-8")
    one, two = (each / "payload" / "grass_shot010.usdc" for each in (forest, again))
    assert one.read_bytes() == two.read_bytes()


def test_tiles_have_the_clumps_that_stand_in_them(forest, folder, words):
    tiled = make(folder, words, "tiled", "--tile", "40")
    _stage, (whole,) = clumps(forest)
    _kept, parts = clumps(tiled)
    assert len(parts) > 1
    together = np.concatenate([np.array(each.GetPositionsAttr().Get()) for each in parts])
    order = [np.lexsort(each.T) for each in (np.array(whole.GetPositionsAttr().Get()), together)]
    np.testing.assert_array_equal(np.array(whole.GetPositionsAttr().Get())[order[0]], together[order[1]])
    for each in parts:
        ground = UsdGeom.Mesh(each.GetPrim().GetParent().GetChild("terrain"))
        low, high = np.array(ground.GetExtentAttr().Get())
        place = np.array(each.GetPositionsAttr().Get())
        assert (place[:, [0, 2]] >= low[[0, 2]] - 0.5).all()
        assert (place[:, [0, 2]] <= high[[0, 2]] + 0.5).all()
    report = validate_asset(tiled, read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []


def test_an_option_leaves_it_out(folder, words):
    out = make(folder, words, "without", "--no-grass")
    assert not clumps(out)[1]
    assert not list(out.rglob("*grass*"))
    assert "grassMap" not in (out / "payload" / "materials.usda").read_text("utf-8")


def test_bounds_of_the_command_are_kept(folder, words, forest, capsys):
    near = make(folder, words, "near", "--grass-distance", "8", "--max-grass-clumps", "1500")
    _stage, (grass,) = clumps(near)
    count = len(grass.GetPositionsAttr().Get())
    assert 1200 < count <= 1500
    for wrong in (("--grass-distance", "0"), ("--max-grass-clumps", "5"), ("--grass-distance", "nan")):
        capsys.readouterr()
        out = folder / "wrong"
        assert main([*words, "--camera", str(folder / "shot010.usda"), *wrong, "-o", str(out)]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
        assert not out.exists()


def test_a_camera_high_above_has_none_and_the_reason_is_given(folder, words, capsys):
    capsys.readouterr()
    out = make(folder, words, "high", shot="high")
    assert "clumps of grass, shot_high: 0 (the camera sees no vegetated ground within 30 m)" in capsys.readouterr().out
    assert not clumps(out, "shot_high")[1]
