"""A forest as an asset: where its plants are, what it refers to, and input that cannot be."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from pxr import Kind, Usd, UsdGeom
from rasterio.shutil import copy
from rasterio.vrt import WarpedVRT
from usdfoliage.__main__ import main
from usdfoliage.asset.packages.leaf_package import write_crown_asset
from usdfoliage.asset.packages.planted_assets import measure_planted_asset
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.errors import CaptureError
from usdfoliage.forest.raster import Raster, sample_bilinear, sample_nearest
from usdfoliage.jobs.forest.inputs import ForestFiles, read_forest, read_trunks
from usdfoliage.jobs.forest.levels import turn_and_lean
from usdfoliage.jobs.info import describe_asset, format_info
from usdfoliage.remarks import Remark

from tests.support.forests.scene import forest_scene, frame, match, write_forest_files, write_raster
from tests.support.leaves.drawn import drawn_leaf, write_leaf
from tests.support.plant_assets import round_crown

PLAIN = Provenance(capture="crown.jpg", generator="test", seed=0, input_sha256="0")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("a valley")
    paths = write_forest_files(folder, forest_scene())
    (folder / "oak").mkdir()
    write_crown_asset(folder / "oak", "oak", round_crown(), PLAIN)
    return paths


def arguments(files: dict[str, Path], *leave_out: str) -> list[str]:
    options = [f"--{name}" for name in files if name != "dem" and name not in leave_out]
    return [str(files["dem"]), *(text for option in options for text in (option, str(files[option[2:]])))]


@pytest.fixture(scope="module")
def forest(files, tmp_path_factory):
    out = tmp_path_factory.mktemp("forests") / "valley"
    assert main(["forest", *arguments(files), "-o", str(out), "--no-preview", "--reproducible"]) == 0
    return out


def planted(stage: Usd.Stage) -> UsdGeom.PointInstancer:
    return UsdGeom.PointInstancer(stage.GetPrimAtPath("/valley/plants/crown"))


def test_plants_lie_back_over_the_terrain_with_their_heights(forest):
    scene = forest_scene()
    stage = Usd.Stage.Open(str(forest / "valley.usda"))
    root = stage.GetDefaultPrim()
    assert Usd.ModelAPI(root).GetKind() == Kind.Tokens.assembly
    instancer = planted(stage)
    position = np.array(instancer.GetPositionsAttr().Get(), np.float64)
    back = np.linalg.inv(np.array(root.GetAttribute("foliage:captureToAsset").Get()))
    ground = np.column_stack([position, np.ones(len(position))]) @ back
    found, true = match(ground[:, :2], scene.trees_m, 0.5 * scene.radius_m)
    assert len(true) >= 0.97 * len(scene.trees_m)
    np.testing.assert_allclose(ground[:, 2], sample_bilinear(scene.dem, ground[:, :2]), atol=0.01)
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_, UsdGeom.Tokens.proxy])
    prototypes = [stage.GetPrimAtPath(path) for path in instancer.GetPrototypesRel().GetTargets()]
    tall = np.array([cache.ComputeLocalBound(prim).ComputeAlignedRange().GetMax()[1] for prim in prototypes])
    scales = np.array(instancer.GetScalesAttr().Get())
    height_m = tall[np.array(instancer.GetProtoIndicesAttr().Get())] * scales[:, 1]
    assert np.abs(height_m[found] / scene.height_m[true] - 1).mean() < 0.06
    species = [str(name) for name in instancer.GetPrim().GetAttribute("foliage:forest:species").Get()]
    rows = np.array(instancer.GetProtoIndicesAttr().Get())[found]
    assert species == ["oak", "maple"]
    assert (rows == scene.species[true]).mean() > 0.97


def test_bounds_hold_what_is_drawn_and_levels_have_the_same_plants(forest):
    stage = Usd.Stage.Open(str(forest / "valley.usda"))
    root = stage.GetDefaultPrim()
    hint = np.array(UsdGeom.ModelAPI(root).GetExtentsHint())[:2]
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_, UsdGeom.Tokens.proxy])
    drawn = cache.ComputeUntransformedBound(root).ComputeAlignedRange()
    assert (hint[0] <= np.array(drawn.GetMin()) + 1e-3).all()
    assert (hint[1] >= np.array(drawn.GetMax()) - 1e-3).all()
    assert (hint[1] - hint[0] < 1.2 * np.array(drawn.GetSize()) + 1).all()
    levels = root.GetVariantSets().GetVariantSet("level")
    drawn_in = {level: level for level in levels.GetVariantNames()} | {"auto": "leaves"}
    for level, name in drawn_in.items():
        levels.SetVariantSelection(level)
        instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath(f"/valley/plants/{name}"))
        extent = np.array(instancer.GetExtentAttr().Get())
        drawn = np.array(instancer.ComputeExtentAtTime(Usd.TimeCode.EarliestTime(), Usd.TimeCode.EarliestTime()))
        assert (extent[0] <= drawn[0] + 1e-3).all(), level
        assert (extent[1] >= drawn[1] - 1e-3).all(), level
    levels.SetVariantSelection("crown")
    ids = list(planted(stage).GetIdsAttr().Get())
    root.GetVariantSets().GetVariantSet("level").SetVariantSelection("relief")
    assert not planted(stage)
    relief = UsdGeom.PointInstancer(stage.GetPrimAtPath("/valley/plants/relief"))
    assert list(relief.GetIdsAttr().Get()) == ids
    crown = stage.GetPrimAtPath(f"{relief.GetPrototypesRel().GetTargets()[0]}/Place/Plant/geo/proxy/Crown")
    assert len(UsdGeom.Mesh(crown).GetFaceVertexCountsAttr().Get()) == 80


def test_it_is_valid_and_info_counts_its_plants(forest):
    report = validate_asset(forest, read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []
    info = describe_asset(forest)
    assert sum(info.forest.plants.values()) == info.forest.levels["crown"] > 80
    assert "plants" in format_info(info)


def test_the_same_seed_gives_the_same_bytes(files, forest):
    def read(folder: Path) -> dict[str, bytes]:
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        return {str(path.relative_to(folder)): path.read_bytes() for path in paths}

    before = read(forest)
    assert len(before) > 8
    assert main(["forest", *arguments(files), "-o", str(forest), "--no-preview", "--reproducible"]) == 0
    after = read(forest)
    assert after.keys() == before.keys()
    assert [name for name in before if before[name] != after[name]] == []


def test_a_dry_run_writes_nothing_and_json_has_the_figures(files, tmp_path, capsys):
    out = tmp_path / "valley"
    assert main(["forest", *arguments(files), "-o", str(out), "--dry-run"]) == 0
    assert "terrain: 160 x 160 pixels of 0.5 m" in capsys.readouterr().out
    assert not out.exists()
    assert main(["forest", *arguments(files, "canopy"), "-o", str(out), "--no-preview", "--json"]) == 0
    made = json.loads(capsys.readouterr().out)
    assert made["asset"] == str(out / "valley.usda")
    assert any(remark["code"] == "class-without-plants" for remark in made["remarks"])


@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.0], [90.0, 5.0, 0.0], [200.0, -3.0, 8.0]])
def test_plants_turn_about_the_vertical_and_lean_to_east_and_north(turn):
    from pxr import Gf

    w, x, y, z = turn_and_lean(np.array(turn[:1]), np.array([turn[1:]]))[0]
    quaternion = Gf.Rotation(Gf.Quatd(w, x, y, z))
    up = quaternion.TransformDir(Gf.Vec3d(0, 1, 0))
    lean = np.radians(np.hypot(*turn[1:]))
    np.testing.assert_allclose(up[1], np.cos(lean), atol=1e-9)
    if lean:
        np.testing.assert_allclose([up[0], -up[2]], np.sin(lean) * np.array(turn[1:]) / np.hypot(*turn[1:]), atol=1e-9)
    else:
        out = quaternion.TransformDir(Gf.Vec3d(0, 0, 1))
        np.testing.assert_allclose(out, [0, 0, 1], atol=1e-9)


def refused(files: dict[str, Path], tmp_path: Path, capsys, **given: Path) -> str:
    """The one line of an error of exit 2, and nothing written."""
    out = tmp_path / "valley"
    options = {**files, **given}
    assert main(["forest", *arguments(options), "-o", str(out), "--no-preview"]) == 2
    streams = capsys.readouterr()
    assert not out.exists()
    assert "Traceback" not in streams.err
    return streams.err.strip().splitlines()[-1]


def test_rasters_that_cannot_be_are_one_clear_line(files, tmp_path, capsys):
    scene = forest_scene()
    values = scene.dem.values.astype(np.float32)
    far = np.array([[0.5, 0, 900_000.0], [0, -0.5, 4_000_000.0]])
    degrees = np.array([[1e-5, 0, 2.45], [0, -1e-5, 42.1]])
    turned = np.array([[0.4, 0.3, frame()[0, 2]], [0.3, -0.4, frame()[1, 2]]])
    cases = {
        "no place": ("dem", _write_plain(tmp_path / "a.png", values)),
        "degrees": ("dem", write_raster(tmp_path / "b.tif", values, 4326, degrees)),
        "different places": ("canopy", write_raster(tmp_path / "c.tif", values, matrix=far)),
        "codes": ("vegetation", write_raster(tmp_path / "d.tif", np.full((160, 160), 9, np.uint8))),
        "bands": ("orthophoto", write_raster(tmp_path / "e.tif", values)),
        "no heights": ("dem", write_raster(tmp_path / "f.tif", np.full((20, 20), np.nan, np.float32))),
    }
    lines = {name: refused(files, tmp_path, capsys, **{which: path}) for name, (which, path) in cases.items()}
    assert "does not state where on the ground" in lines["no place"]
    assert "degrees" in lines["degrees"]
    assert "gdalwarp" in lines["degrees"]
    assert "covers 0% of the DEM" in lines["different places"]
    assert "has the code 9" in lines["codes"]
    assert "no three bands" in lines["bands"]
    assert "heights in 0.0%" in lines["no heights"]
    (tmp_path / "g.tif").write_bytes(files["dem"].read_bytes()[:3000])
    assert str(tmp_path / "g.tif") in refused(files, tmp_path, capsys, dem=tmp_path / "g.tif")
    (tmp_path / "h.vrt").write_text('<VRTDataset rasterXSize="2" rasterYSize="2"/>')
    assert "h.vrt" in refused(files, tmp_path, capsys, dem=tmp_path / "h.vrt")
    assert "nowhere.tif" in refused(files, tmp_path, capsys, dem=tmp_path / "nowhere.tif")
    write_raster(tmp_path / "turned.tif", values, matrix=turned)
    read = read_forest(ForestFiles(dem=tmp_path / "turned.tif", plants=files["plants"]))
    assert read.planted.terrain.heights.cell_m == pytest.approx(0.5)


def test_feet_become_metres_and_lie_back_in_feet(files, tmp_path):
    scene = forest_scene()
    foot = 0.3048
    matrix = frame() / foot
    dem = write_raster(tmp_path / "feet.tif", (scene.dem.values / foot).astype(np.float32), 2222, matrix)
    read = read_forest(ForestFiles(dem=dem, plants=files["plants"]))
    assert read.metres_per_unit == pytest.approx(foot)
    assert read.metres_per_height == pytest.approx(foot)
    np.testing.assert_allclose(read.planted.terrain.heights.values, scene.dem.values, atol=0.01)
    assert read.planted.terrain.heights.cell_m == pytest.approx(0.5)
    assert [remark.code for remark in read.remarks] == ["terrain-height-unit"]


def test_without_a_coordinate_system_metres_are_taken_and_holes_are_noted(files, tmp_path):
    values = forest_scene().dem.values.astype(np.float32)
    values[40:60, 40:60] = -9999
    dem = write_raster(tmp_path / "dem.tif", values, None, nodata=-9999)
    read = read_forest(ForestFiles(dem=dem, plants=files["plants"]))
    assert {remark.code for remark in read.remarks} == {"terrain-without-crs", "terrain-holes"}
    np.testing.assert_allclose(read.planted.terrain.heights.values, forest_scene().dem.values, atol=0.01)


def test_assets_that_cannot_be_used_are_named_with_their_row(files, tmp_path, capsys):
    text = files["plants"].read_text()
    plants = tmp_path / "plants.toml"
    plants.write_text(text.replace('asset = "oak"', 'asset = "gone"', 1))
    line = refused(files, tmp_path, capsys, plants=plants)
    assert "row 1 (oak)" in line
    assert "gone" in line
    (tmp_path / "empty.usda").write_text('#usda 1.0\n(defaultPrim = "A")\ndef Xform "A" {}\n')
    plants.write_text(text.replace('asset = "oak"', 'asset = "empty.usda"'))
    assert "draws nothing" in refused(files, tmp_path, capsys, plants=plants)


def leaf_row(files, tmp_path, leaf: str) -> Path:
    """plants.toml whose first row names a leaf."""
    text = files["plants"].read_text().replace('asset = "oak"', f'asset = "{files["plants"].parent / "oak"}"')
    first = text.index("species")
    return _write(tmp_path / "plants.toml", f'{text[:first]}leaf = "{leaf}"\n{text[first:]}')


@pytest.mark.parametrize("tile", [(), ("--tile", "60")])
def test_a_row_gives_the_crown_of_its_asset_other_leaves(files, tmp_path, tile):
    write_leaf(tmp_path / "oak_leaf.png", drawn_leaf(30, 100))
    plants = leaf_row(files, tmp_path, "oak_leaf.png")
    out = tmp_path / "valley"
    assert main(["forest", *arguments({**files, "plants": plants}), "-o", str(out), "--no-preview", *tile]) == 0
    stage = Usd.Stage.Open(str(out / "valley.usda"))
    stage.GetDefaultPrim().GetVariantSet("level").SetVariantSelection("leaves")
    level = next(
        prim for prim in stage.Traverse() if prim.IsA(UsdGeom.PointInstancer) and prim.GetParent().GetName() == "plants"
    )
    given, own = (
        stage.GetPrimAtPath(target.AppendPath("Place/Plant"))
        for target in UsdGeom.PointInstancer(level).GetPrototypesRel().GetTargets()[:2]
    )
    maps = [each.GetPrimAtPath("mtl/CrownLeaves/LeafMap").GetAttribute("inputs:file").Get() for each in (given, own)]
    assert Path(maps[0].resolvedPath) == out / "maps" / "valley_leaf_1.png"
    assert Path(maps[1].resolvedPath).name == "oak_crown_leaf.png"
    for each, width in ((given, 0.3), (own, 0.62)):
        cluster = each.GetPrimAtPath("geo/proxy/CrownLeaves/Prototypes/Cluster_1")
        corner = np.array(cluster.GetAttribute("primvars:leafCorner").Get())
        assert np.abs(corner[0, 0] / corner[0, 1]) == pytest.approx(width, abs=0.03)
    clusters = UsdGeom.PointInstancer(given.GetPrimAtPath("geo/proxy/CrownLeaves"))
    assert len(clusters.GetPositionsAttr().Get()) == 320
    # What is drawn lies in the extents, in the crown's own frame.
    low, high = np.array(clusters.GetExtentAttr().Get())
    scale = np.array(clusters.GetScalesAttr().Get())[:, :1]
    reach = max(
        np.linalg.norm(np.array(UsdGeom.Mesh(stage.GetPrimAtPath(form)).GetPointsAttr().Get()), axis=1).max()
        for form in clusters.GetPrototypesRel().GetForwardedTargets()
    )
    places = np.array(clusters.GetPositionsAttr().Get())
    assert ((places - reach * scale).min(axis=0) >= low - 1e-3).all()
    assert ((places + reach * scale).max(axis=0) <= high + 1e-3).all()
    report = validate_asset(out, read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []


def test_a_leaf_of_a_row_that_cannot_be_used_is_named_with_it(files, tmp_path, capsys):
    write_leaf(tmp_path / "clear.png", drawn_leaf() * [1, 1, 1, 0])
    for leaf in ("clear.png", "absent.png"):
        line = refused(files, tmp_path, capsys, plants=leaf_row(files, tmp_path, leaf))
        assert "row 1 (oak)" in line
        assert leaf in line
    (tmp_path / "cube.usda").write_text(
        '#usda 1.0\n(\n defaultPrim = "A"\n upAxis = "Y"\n metersPerUnit = 1\n)\n'
        'def Cube "A"\n{\n float3[] extent = [(-1, -1, -1), (1, 1, 1)]\n}\n'
    )
    write_leaf(tmp_path / "good.png", drawn_leaf())
    plants = leaf_row(files, tmp_path, "good.png")
    plants.write_text(plants.read_text().replace(str(files["plants"].parent / "oak"), "cube.usda", 1))
    assert "no crown of leaves" in refused(files, tmp_path, capsys, plants=plants)


def test_a_foreign_asset_in_other_units_and_axes_stands_upright(files, tmp_path):
    (tmp_path / "pole.usda").write_text(
        """#usda 1.0
(
    defaultPrim = "P"
    metersPerUnit = 0.01
    upAxis = "Z"
)
def Xform "P"
{
    def Cube "c"
    {
        double size = 2
        float3[] extent = [(-1, -1, -1), (1, 1, 1)]
        double3 xformOp:translate = (0, 0, 100)
        float3 xformOp:scale = (20, 10, 100)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
}
"""
    )
    plants = tmp_path / "plants.toml"
    plants.write_text(files["plants"].read_text().replace('asset = "oak"', 'asset = "pole.usda"'))
    out = tmp_path / "valley"
    assert main(["forest", *arguments({**files, "plants": plants}), "-o", str(out), "--no-preview"]) == 0
    stage = Usd.Stage.Open(str(out / "valley.usda"))
    prototype = stage.GetPrimAtPath(planted(stage).GetPrototypesRel().GetTargets()[0])
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    box = cache.ComputeLocalBound(prototype).ComputeAlignedRange()
    np.testing.assert_allclose([*box.GetMin(), *box.GetMax()], [-0.2, 0, -0.1, 0.2, 2, 0.1], atol=1e-6)


def test_trunks_are_read_from_any_table_of_numbers(tmp_path):
    with pytest.raises(CaptureError, match="no line of two numbers"):
        read_trunks(_write(tmp_path / "none.csv", "a,b\n"), [])
    remarks: list[Remark] = []
    trunks = read_trunks(_write(tmp_path / "t.csv", "e,n\n# two trees\n1.5,2.5,oak\n3;4\n\n"), remarks)
    assert trunks.tolist() == [[1.5, 2.5], [3.0, 4.0]]
    assert remarks == []
    trunks = read_trunks(_write(tmp_path / "u.csv", "e,n\n1.5,2.5,oak\n3;4\nnan,1\noak,7,8\n"), remarks)
    assert [(each.code, "2 lines" in each.text, "line 4" in each.text) for each in remarks] == [
        ("trunks-unread", True, True)
    ]
    assert trunks.tolist() == [[1.5, 2.5], [3.0, 4.0]]


def _write_plain(path: Path, values: np.ndarray) -> Path:
    """A picture without a place."""
    cv2.imwrite(str(path), np.clip(values - 290, 0, 255).astype(np.uint8))
    return path


def _write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_an_orthophoto_of_another_resolution_is_laid_over_the_terrain(files, tmp_path):
    scene = forest_scene()
    fine = np.repeat(np.repeat(scene.orthophoto.values, 2, axis=0), 2, axis=1).astype(np.float32)
    photo = write_raster(tmp_path / "fine.tif", fine, matrix=frame(0.25))
    read = read_forest(ForestFiles(dem=files["dem"], plants=files["plants"], orthophoto=photo))
    places = scene.trees_m
    expected = sample_bilinear(replace_values(scene.orthophoto), places)
    np.testing.assert_allclose(sample_bilinear(read.planted.orthophoto, places), expected, atol=0.03)


def replace_values(raster: Raster) -> Raster:
    return replace(raster, values=np.asarray(raster.values, np.float64))


def test_an_asset_in_the_output_is_refused_and_stays(files, tmp_path, capsys):
    out = tmp_path / "valley"
    write_crown_asset(_folder(out), "valley", round_crown(), PLAIN)
    plants = _write(tmp_path / "plants.toml", files["plants"].read_text().replace('asset = "oak"', 'asset = "valley"'))
    before = (out / "valley.usda").read_bytes()
    options = arguments({**files, "plants": plants})
    assert main(["forest", *options, "-o", str(out), "--no-preview", "--force"]) == 2
    assert "lies in the output" in capsys.readouterr().err
    assert (out / "valley.usda").read_bytes() == before


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


def test_a_forest_without_plants_is_valid(files, tmp_path):
    out = tmp_path / "bare"
    assert main(["forest", str(files["dem"]), "--plants", str(files["plants"]), "-o", str(out), "--no-preview"]) == 0
    report = validate_asset(out, read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []


@pytest.mark.parametrize(
    "option",
    [
        ["--max-terrain-quads", "0"],
        ["--seed", "-1"],
        ["--seed", "4294967296"],
        ["--lod-distance", "200", "5"],
        ["--lod-distance", "nan", "nan"],
        ["--max-ground-cover", "-1"],
        ["--trees-per-ha", "inf"],
        ["--crown-radius", "3", "1"],
    ],
)
def test_settings_that_cannot_be_are_named(files, tmp_path, capsys, option):
    assert main(["forest", *arguments(files), "-o", str(tmp_path / "x"), "--dry-run", *option]) == 2
    name = option[0].removeprefix("--").replace("-", "_")
    words = {"crown_radius": "radii", "seed": "seed"}.get(name, name)
    assert words in capsys.readouterr().err


def test_canopies_that_are_no_heights_above_the_ground_are_refused(files, tmp_path, capsys):
    scene = forest_scene()
    spoiled = scene.canopy.values.astype(np.float32)
    spoiled[:9, :9] = 3.4e38
    above_sea = (scene.canopy.values + scene.dem.values).astype(np.float32)
    for name, values in (("a", spoiled), ("b", above_sea)):
        canopy = write_raster(tmp_path / f"{name}.tif", values)
        assert "no plant is taller" in refused(files, tmp_path, capsys, canopy=canopy)


def test_classes_of_another_coordinate_system_stay_codes(files, tmp_path):
    scene = forest_scene()
    codes = write_raster(tmp_path / "codes.tif", scene.vegetation.values.astype(np.uint8))
    other = tmp_path / "other.tif"
    with rasterio.open(codes) as file, WarpedVRT(file, crs="EPSG:32632", nodata=0) as warped:
        copy(warped, other, driver="GTiff")
    read = read_forest(ForestFiles(dem=files["dem"], plants=files["plants"], vegetation=other))
    values = read.planted.vegetation.values
    assert set(np.unique(values[np.isfinite(values)]).tolist()) <= {0.0, 1.0, 3.0}
    places = scene.trees_m
    assert (sample_nearest(read.planted.vegetation, places) == 1).mean() > 0.9


def test_a_foreign_set_of_levels_is_drawn_as_it_is_selected(files, tmp_path):
    (tmp_path / "box.usda").write_text(
        """#usda 1.0
(
    defaultPrim = "B"
    metersPerUnit = 1
    upAxis = "Y"
)
def Xform "B" (
    variants = {
        string lod = "high"
    }
    prepend variantSets = "lod"
)
{
    variantSet "lod" = {
        "high" {
            def Cube "c"
            {
                double size = 2
                float3[] extent = [(-1, -1, -1), (1, 1, 1)]
            }
        }
        "low" {
        }
    }
}
"""
    )
    measured = measure_planted_asset(tmp_path / "box.usda")
    assert measured.crown.height_m == 1
    assert measured.full is None


@pytest.mark.parametrize(
    "command",
    [
        ["export", "--profile", "usdz", "-o", "x.usdz"],
        ["export", "--profile", "standalone", "-o", "x"],
        ["edit", "--width", "1.2", "-o", "x.usda"],
        ["bake", "-o", "x"],
    ],
)
def test_what_is_for_one_plant_refuses_a_forest(forest, tmp_path, capsys, command):
    name, *options = command
    options[-1] = str(tmp_path / options[-1])
    assert main([name, str(forest), *options]) == 2
    assert "is a forest, and not one plant; name the asset of one of its plants" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
