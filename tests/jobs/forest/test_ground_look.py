"""The ground of a forest: its pictures, and which renderer gets which."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdLux, UsdShade
from usdfoliage.__main__ import main
from usdfoliage.asset.packages.leaf_package import write_crown_asset
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.forest.raster import Raster, pixel_grid, sample_bilinear, sample_nearest, to_ground
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.jobs.forest.ground import CONTACT_SIDE_PX, contact_grid, lay_photo

from tests.support.forests.scene import forest_scene, frame, write_forest_files, write_raster
from tests.support.plant_assets import round_crown


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("a valley")
    paths = write_forest_files(folder, forest_scene())
    (folder / "oak").mkdir()
    provenance = Provenance(capture="crown.jpg", generator="test", seed=0, input_sha256="0")
    write_crown_asset(folder / "oak", "oak", round_crown(), provenance)
    return paths


def make(files, out, *more: str) -> Usd.Stage:
    given = [text for name in files if name != "dem" for text in (f"--{name}", str(files[name]))]
    assert main(["forest", str(files["dem"]), *given, *more, "-o", str(out), "--no-preview", "--reproducible"]) == 0
    return Usd.Stage.Open(str(out / f"{out.name}.usda"))


def file_of(stage: Usd.Stage, path: str) -> str:
    """The file that a texture names, as it is found."""
    return stage.GetPrimAtPath(path).GetAttribute("inputs:file").Get().resolvedPath


@pytest.mark.parametrize("tiles", [(), ("--tile", "40")])
def test_storm_alone_is_given_the_dark_under_plants(files, tmp_path, tiles):
    stage = make(files, tmp_path / "valley", *tiles)
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh) and prim.GetName() == "terrain"]
    assert len(meshes) == (4 if tiles else 1)
    for mesh in meshes:
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        read = {}
        for context in ("glslfx", "mtlx", ""):
            surface = material.ComputeSurfaceSource(context)[0]
            read[context] = {
                source.source.GetPrim().GetName()
                for given in surface.GetInputs()
                for source in given.GetConnectedSources()[0]
            }
        assert read == {"glslfx": {"Texture", "ContactMap", "GrassMap"}, "mtlx": {"MtlxImage"}, "": {"Texture"}}
        for texture in ("Texture", "ContactMap", "GrassMap", "MtlxImage"):
            assert file_of(stage, f"{material.GetPath()}/{texture}")
        storm = material.ComputeSurfaceSource("glslfx")[0]
        assert storm.GetSourceAsset("glslfx").resolvedPath
        assert storm.GetInput("photoPixel").Get() == pytest.approx(0.5)
    report = validate_asset(tmp_path / "valley", read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []


def test_the_map_is_dark_where_plants_stand(files, tmp_path):
    stage = make(files, tmp_path / "valley")
    scene = forest_scene()
    sky = cv2.imread(file_of(stage, "/valley/mtl/Ground/ContactMap"), cv2.IMREAD_UNCHANGED) / 255
    assert sky.shape == (320, 320)
    grid = contact_grid(scene.dem, scene.radius_m)
    assert grid.values.shape == sky.shape
    row, column = np.mgrid[:320, :320] + 0.5
    ground_m = to_ground(grid, np.stack([column, row], axis=-1).reshape(-1, 2))
    away = np.linalg.norm(ground_m[:, None] - scene.trees_m, axis=2) / scene.radius_m
    nearest = away.min(axis=1).reshape(sky.shape)
    under, between = sky[nearest < 0.3], sky[nearest > 1.5]
    assert under.max() < between.mean() < 1
    assert under.mean() < 0.8


def test_no_plants_and_no_orthophoto_are_a_plain_ground(files, tmp_path):
    only = {name: files[name] for name in ("dem", "plants")}
    stage = make(only, tmp_path / "valley")
    ground = stage.GetPrimAtPath("/valley/mtl/Ground")
    assert {child.GetName() for child in ground.GetChildren()} == {
        "PreviewSurface",
        "MtlxColor",
        "MtlxSurface",
        "StormSurface",
    }
    assert not (tmp_path / "valley" / "maps").exists()


def test_many_crowns_have_coarser_pixels_but_none_wider_than_two_of_them():
    dem = Raster(values=np.zeros((2000, 2000)), ground_from_pixel=np.array([[1.0, 0, 0], [0, -1.0, 2000]]))
    few, many, more = (contact_grid(dem, np.full(count, 2.0)).cell_m for count in (100, 100_000, 4_000_000))
    assert few == pytest.approx(2000 / CONTACT_SIDE_PX, rel=0.01)
    assert few < many < more
    assert more == pytest.approx(4, rel=0.01)


def test_pixels_of_the_pictures_lie_where_those_of_the_dem_do():
    matrix = np.array([[3.0, 0.5, 100.0], [0.4, -2.0, 900.0]])
    onto = Raster(values=np.zeros((30, 50)), ground_from_pixel=matrix)
    large = Raster(values=np.zeros((300, 3000)), ground_from_pixel=matrix)
    for dem in (onto, large):
        grid = contact_grid(dem, np.zeros(0))
        assert max(grid.values.shape) <= CONTACT_SIDE_PX
        for corner in ((0, 0), (1, 0), (1, 1)):
            places = [np.array([corner]) * np.array(each.values.shape[::-1]) for each in (dem, grid)]
            np.testing.assert_allclose(to_ground(grid, places[1]), to_ground(dem, places[0]))
    photo = lay_photo(Raster(values=np.full((4, 4, 3), 0.3), ground_from_pixel=matrix), onto)
    np.testing.assert_allclose(photo.values, 0.3, atol=1e-6)


@pytest.mark.parametrize("tiles", [(), ("--tile", "40")])
def test_a_sky_is_an_option_and_stands_at_the_root(files, tmp_path, tiles, capsys):
    stage = make(files, tmp_path / "valley", "--sky", "90", "30", *tiles)
    lights = [prim for prim in stage.Traverse() if prim.HasAPI(UsdLux.LightAPI)]
    assert [str(prim.GetPath()) for prim in lights] == ["/valley/sky/Dome", "/valley/sky/Sun"]
    picture = UsdLux.DomeLight(lights[0]).GetTextureFileAttr().Get().resolvedPath
    assert Path(picture).name == "valley_sky.exr"
    assert UsdLux.DomeLight(lights[0]).GetTextureFormatAttr().Get() == "latlong"
    shines = UsdGeom.Xformable(lights[1]).ComputeLocalToWorldTransform(0).TransformDir((0, 0, -1))
    np.testing.assert_allclose(shines, [-np.cos(np.pi / 6), -0.5, 0], atol=1e-6)  # from the east
    report = validate_asset(tmp_path / "valley", read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []
    capsys.readouterr()
    assert main(["forest", str(files["dem"]), "--plants", str(files["plants"]), "--sky", "0", "95", "-o", "x"]) == 2
    assert "elevation must be 1 to 90 degrees" in capsys.readouterr().err


def test_without_that_option_it_has_no_lights(files, tmp_path):
    stage = make(files, tmp_path / "valley")
    assert not [prim for prim in stage.Traverse() if prim.HasAPI(UsdLux.LightAPI)]
    assert not (tmp_path / "valley" / "maps" / "valley_sky.exr").exists()


def test_on_a_turned_dem_the_orthophoto_lies_where_it_was_taken(files, tmp_path):
    scene = forest_scene()
    size = scene.dem.values.shape[0]
    middle_m = frame() @ [size / 2, size / 2, 1.0]
    turned = np.array([[0.4, 0.3], [0.3, -0.4]])
    matrix = np.column_stack([turned, middle_m - turned @ [30, 30]])
    grid_m = pixel_grid(Raster(values=np.zeros((60, 60)), ground_from_pixel=matrix))
    heights = sample_bilinear(scene.dem, grid_m.reshape(-1, 2)).reshape(60, 60).astype(np.float32)
    changed = files | {"dem": write_raster(tmp_path / "turned.tif", heights, matrix=matrix)}
    out = tmp_path / "valley"
    stage = make(changed, out)
    terrain = UsdGeom.Mesh(stage.GetPrimAtPath("/valley/terrain"))
    points = np.array(terrain.GetPointsAttr().Get())
    st = np.array(UsdGeom.PrimvarsAPI(terrain).GetPrimvar("st").Get())
    picture = cv2.imread(str(out / "maps" / "valley_orthophoto.png"))[..., ::-1].astype(float)
    height, width = picture.shape[:2]
    seen = picture[((1 - st[:, 1]) * height).astype(int), (st[:, 0] * width).astype(int)]
    back = np.linalg.inv(np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get()))
    ground_m = (np.column_stack([points, np.ones(len(points))]) @ back)[:, :2]
    true = encode_srgb(np.asarray(sample_nearest(scene.orthophoto, ground_m))) * 255
    assert np.median(np.abs(seen - true)) < 6  # pixels of half a metre at other places
    bounds = stage.GetPrimAtPath("/valley/plants/crown").GetAttribute("foliage:forest:orthophotoBounds").Get()
    low = np.array(bounds)[:2]
    east, south = (points[:, [0, 2]] - low).T / (np.array(bounds)[2:] - low)[:, None]
    np.testing.assert_allclose(np.column_stack([east, 1 - south]), st, atol=1e-4)
