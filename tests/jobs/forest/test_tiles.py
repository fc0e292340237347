"""A forest in tiles: the plants and the ground of one in one piece, each in one tile, opened one by one."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdLod
from usdfoliage.__main__ import main
from usdfoliage.asset.packages.forest_contents import read_forest
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset

from tests.support.forests.shots import FRAMES, PATH_M, drawn_at, forest_words, write_shot


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("in tiles")
    write_shot(folder / "shot010.usda", [(0, 40, z) for z in PATH_M])
    return folder


@pytest.fixture(scope="module")
def words(folder):
    return [*forest_words(folder), "--camera", str(folder / "shot010.usda"), "--lod-distance", "30", "70"]


@pytest.fixture(scope="module")
def whole(folder, words):
    assert main([*words, "-o", str(folder / "whole" / "valley")]) == 0
    return folder / "whole" / "valley" / "valley.usda"


@pytest.fixture(scope="module")
def tiled(folder, words):
    assert main([*words, "-o", str(folder / "tiled" / "valley"), "--tile", "30"]) == 0
    return folder / "tiled" / "valley" / "valley.usda"


def plants_of(stage, level):
    stage.GetDefaultPrim().GetVariantSet("level").SetVariantSelection(level)
    found = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.PointInstancer) and prim.GetParent().GetName() == "plants":
            instancer = UsdGeom.PointInstancer(prim)
            places = np.array(instancer.GetPositionsAttr().Get()).reshape(-1, 3)
            for plant, place in zip(instancer.GetIdsAttr().Get(), places, strict=True):
                found.setdefault(plant, []).append((str(prim.GetPath()), place))
    return found


def test_every_plant_stands_in_one_tile_at_its_place(whole, tiled):
    one, many = Usd.Stage.Open(str(whole)), Usd.Stage.Open(str(tiled))
    for level in ("crown", "relief", "leaves"):
        true, found = plants_of(one, level), plants_of(many, level)
        assert sorted(true) == sorted(found)
        for plant, ((_, place),) in true.items():
            ((path, own),) = found[plant]
            np.testing.assert_array_equal(own, place)
            assert path.endswith(f"/plants/{level}")
    back = np.linalg.inv(np.array(many.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get()))
    corners = {}
    for ((path, place),) in plants_of(many, "crown").values():
        corners.setdefault(path.split("/")[3], set()).add(tuple((np.append(place, 1.0) @ back)[:2] // 30))
    assert len(corners) >= 4
    assert all(len(squares) == 1 for squares in corners.values())  # each tile is one square of 30 m


def test_the_ground_of_tiles_is_that_of_the_whole(whole, tiled):
    def faces_of(stage):
        faces = []
        for prim in stage.Traverse():
            if prim.IsA(UsdGeom.Mesh) and prim.GetName() == "terrain":
                points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get())
                faces.append(points[np.array(UsdGeom.Mesh(prim).GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)])
        corners = np.concatenate(faces).reshape(-1, 12)
        return corners[np.lexsort(corners.T)]

    np.testing.assert_array_equal(faces_of(Usd.Stage.Open(str(whole))), faces_of(Usd.Stage.Open(str(tiled))))


def test_tiles_open_one_by_one(tiled):
    stage = Usd.Stage.Open(str(tiled), Usd.Stage.LoadNone)
    tiles = stage.GetPrimAtPath("/valley/tiles").GetAllChildren()
    assert len(tiles) >= 4
    assert not [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.PointInstancer)]
    assert all(UsdGeom.ModelAPI(tile).GetExtentsHint() for tile in tiles)
    stage.Load(tiles[1].GetPath())
    opened = [prim for prim in stage.Traverse() if prim.HasAPI("FoliageForestAPI")]
    assert [str(prim.GetPath()) for prim in opened] == [f"{tiles[1].GetPath()}/plants/crown"]


def test_a_shot_of_tiles_is_that_of_the_whole(whole, tiled):
    def forms_of(stage):
        stage.GetDefaultPrim().GetVariantSet("level").SetVariantSelection("shot010")
        forms = {}
        for prim in stage.Traverse():
            if prim.HasAPI("FoliageForestAPI"):
                for frame in range(1001, 1001 + FRAMES):
                    for plant in drawn_at(UsdGeom.PointInstancer(prim), frame):
                        assert (plant, frame) not in forms
                        forms[plant, frame] = prim.GetName()
        return forms

    assert forms_of(Usd.Stage.Open(str(whole))) == forms_of(Usd.Stage.Open(str(tiled)))


def test_info_of_tiles_is_short(tiled, capsys):
    assert main(["info", str(tiled)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 80
    assert any(line.startswith("tiles ") for line in lines)


def test_a_forest_in_tiles_is_valid(tiled):
    findings = validate_asset(tiled, read_profile(default_profile())).findings
    assert not [each for each in findings if each.severity == "error"]


@pytest.mark.parametrize(("tile", "about"), [("5", "hardly a face"), ("0.001", "are allowed"), ("-5", "above 0")])
def test_tiles_that_cannot_be_are_refused(folder, words, capsys, tile, about):
    out = folder / "none"
    assert main([*words, "-o", str(out), "--tile", tile, "--max-terrain-quads", "100"]) == 2
    assert about in capsys.readouterr().err
    assert not out.exists()


def test_in_auto_usdlod_draws_tiles_near_the_camera_in_their_near_form(tiled):
    stage = Usd.Stage.Open(str(tiled))
    stage.GetDefaultPrim().GetVariantSet("level").SetVariantSelection("auto")
    transforms = UsdGeom.XformCache()
    chosen = {0: set(), 1: set()}
    eye = np.array([0.0, 5.0, -40.0])
    roots = [prim for prim in stage.Traverse() if prim.HasAPI(UsdLod.RootAPI)]
    assert len(roots) == len(stage.GetPrimAtPath("/valley/tiles").GetChildren())
    for plants in roots:
        near, far = plants.GetChildren()
        assert [near.GetName(), far.GetName()] == ["leaves", "relief"]
        assert UsdLod.RootAPI(plants).GetLodDefaultIndexAttr().Get() == 0
        assert UsdGeom.Imageable(near).ComputeVisibility() == "inherited"  # what a renderer draws that does not know it
        assert UsdGeom.Imageable(far).ComputeVisibility() == "invisible"
        (target,) = UsdLod.RootAPI(plants).GetLodHeuristicsRel().GetTargets()
        heuristic = UsdLod.DistanceHeuristic(stage.GetPrimAtPath(target))
        assert heuristic.GetLodDomainAttr().Get() == "imaging"
        extent_m = UsdGeom.PointInstancer(near).GetExtentAttr().Get()
        if extent_m is None:  # a tile without a plant
            continue
        distance_m = np.linalg.norm(eye - np.clip(eye, *np.array(extent_m)))
        lod = heuristic.ComputeLOD(Gf.Vec3d(*eye), transforms.GetLocalToWorldTransform(plants))
        assert lod == pytest.approx(np.clip((distance_m - 30) / (70 - 30), 0, 1), abs=1e-4)
        chosen[round(lod)].add(plants.GetPath())
    assert chosen[0]
    assert chosen[1]


def test_auto_has_each_plant_once_for_a_reader(tiled):
    stage = Usd.Stage.Open(str(tiled))
    plants = read_forest(stage.GetDefaultPrim()).plants
    stage.GetDefaultPrim().GetVariantSet("level").SetVariantSelection("auto")
    assert read_forest(stage.GetDefaultPrim()).plants == plants
