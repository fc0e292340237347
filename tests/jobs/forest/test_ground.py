"""A forest on a mesh or a cloud of the ground: the same as on the raster, and files that cannot be."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr
from pxr import Usd, UsdGeom
from rasterio.crs import CRS
from usdfoliage.__main__ import main
from usdfoliage.asset.packages.leaf_package import write_crown_asset
from usdfoliage.asset.provenance import Provenance
from usdfoliage.forest.ground_settings import GroundSettings
from usdfoliage.forest.raster import pixel_grid
from usdfoliage.forest.tree_tops import find_tops_of_canopy
from usdfoliage.jobs.forest.inputs import ForestFiles, ReadForest, read_forest

from tests.support.cloud_files import write_las, write_ply
from tests.support.forests.ground import grid_quads, write_obj
from tests.support.forests.scene import EPSG, SIZE_PX, forest_scene, frame, match, write_forest_files, write_raster
from tests.support.plant_assets import round_crown

PLAIN = Provenance(capture="crown.jpg", generator="test", seed=0, input_sha256="0")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("a valley")
    paths = write_forest_files(folder, forest_scene())
    (folder / "oak").mkdir()
    write_crown_asset(folder / "oak", "oak", round_crown(), PLAIN)
    return paths


@pytest.fixture(scope="module")
def points():
    scene = forest_scene()
    return np.concatenate([pixel_grid(scene.dem), scene.dem.values[..., None]], axis=-1).reshape(-1, 3)


def system(epsg: int | str = EPSG) -> WktCoordinateSystemVlr:
    return WktCoordinateSystemVlr(CRS.from_user_input(f"EPSG:{epsg}").to_wkt())


def write_cloud(path: Path, points, classes=None, *vlrs) -> Path:
    codes = np.full(len(points), 2) if classes is None else classes
    return write_las(path, points, offset=np.floor(points.min(axis=0)), classification=codes, vlrs=vlrs)


def words(files: dict[str, Path], dem: Path, *more: str) -> list[str]:
    options = ["--plants", "--canopy", "--orthophoto", "--vegetation"]
    given = [text for option in options for text in (option, str(files[option[2:]]))]
    return ["forest", str(dem), *given, "--no-preview", "--reproducible", *more]


def plants_of(asset: Path) -> np.ndarray:
    """(N, 3) easting, northing and height of the plants, by their places: heights may differ by millimetres."""
    stage = Usd.Stage.Open(str(asset))
    root = stage.GetDefaultPrim()
    places = UsdGeom.PointInstancer(stage.GetPrimAtPath("/valley/plants/crown")).GetPositionsAttr().Get()
    back = np.linalg.inv(np.array(root.GetAttribute("foliage:captureToAsset").Get()))
    ground = (np.column_stack([np.array(places, np.float64), np.ones(len(places))]) @ back)[:, :3]
    return ground[np.lexsort(ground[:, 1::-1].T)]


def test_mesh_and_cloud_give_the_forest_of_the_raster(files, points, tmp_path, capsys):
    dems = {
        "raster": files["dem"],
        "mesh": write_obj(tmp_path / "ground.obj", points, grid_quads(SIZE_PX, SIZE_PX)),
        "cloud": write_cloud(tmp_path / "ground.laz", points, None, system()),
    }
    forests = {}
    for name, dem in dems.items():
        spacing = [] if name == "raster" else ["--ground-spacing", "0.5"]
        assert main(words(files, dem, *spacing, "-o", str(tmp_path / name), "--name", "valley")) == 0
        forests[name] = plants_of(tmp_path / name / "valley.usda")
    assert len(forests["raster"]) > 80
    for name in ("mesh", "cloud"):
        assert len(forests[name]) == len(forests["raster"])
        np.testing.assert_allclose(forests[name], forests["raster"], atol=0.01)
    assert "points of the class ground" in capsys.readouterr().out


def test_only_points_of_the_class_ground_are_taken(files, points, tmp_path):
    rng = np.random.default_rng(0)
    above = points[rng.random(len(points)) < 0.4] + [0.1, 0.1, 6.0]
    below = points[:50] - [0, 0, 900.0]
    cloud = np.concatenate([points, above, below])
    classes = np.repeat([2, 5, 7], [len(points), len(above), len(below)])
    dem = write_cloud(tmp_path / "ground.las", cloud, classes, system("25831+5773"))
    read = read_forest(ForestFiles(dem=dem, plants=files["plants"]))
    heights = read.planted.terrain.heights
    np.testing.assert_allclose(heights.values, forest_scene().dem.values, atol=0.002)
    np.testing.assert_allclose(heights.ground_from_pixel, frame(), atol=1e-6)
    assert CRS.from_wkt(heights.crs).to_epsg() == EPSG  # without its system of heights
    assert [remark.code for remark in read.remarks] == ["terrain-gridded", "canopy-of-cloud"]


def scan_of_scene(seed: int = 0) -> np.ndarray:
    """(N, 3) the scene as a scan sees it: its canopy, and a fifth of the ground below."""
    scene = forest_scene()
    rng = np.random.default_rng(seed)
    place = rng.uniform(0, SIZE_PX, (60_000, 2))
    column, row = place.astype(int).T
    ground_m = scene.dem.values[row, column] + (place % 1 - 0.5) @ np.array([0.05, -0.025])
    up = np.where(rng.random(len(place)) < 0.2, 0, scene.canopy.values[row, column])
    plan = place @ frame()[:, :2].T + frame()[:, 2]
    return np.column_stack([plan, ground_m + up + rng.normal(0, 0.02, len(place))])


def found_trees(read: ReadForest) -> int:
    """How many trees of the scene are found in the canopy."""
    assert read.planted.canopy is not None
    scene, tops = forest_scene(), find_tops_of_canopy(read.planted.canopy)
    assert len(tops.ground_m) < 1.1 * len(scene.trees_m)
    found, true = match(tops.ground_m, scene.trees_m, 0.5 * scene.radius_m)
    assert np.median(np.abs(tops.height_m[found] - scene.height_m[true])) < 0.5
    return len(found)


def test_in_a_scan_without_classes_the_ground_and_the_trees_are_found(files, tmp_path):
    scan = scan_of_scene()
    outliers = scan[:20] - [0, 0, 15.0]
    dem = write_cloud(tmp_path / "scan.las", np.concatenate([scan, outliers]), np.ones(len(scan) + 20))
    read = read_forest(ForestFiles(dem=dem, plants=files["plants"]))
    assert {remark.code for remark in read.remarks} - {"terrain-holes"} == {
        "terrain-gridded",
        "terrain-unclassified",
        "terrain-without-crs",
        "canopy-of-cloud",
    }
    assert read.planted.terrain.hole_share < 0.01  # along the edge
    heights = read.planted.terrain.heights
    east, north = np.moveaxis(pixel_grid(heights) - frame()[:, 2], -1, 0)
    error_m = heights.values - (300 - 0.0375 + 0.1 * east + 0.05 * north)
    assert np.sqrt(np.mean(error_m**2)) < 0.1
    assert found_trees(read) > 0.9 * len(forest_scene().trees_m)


def test_a_scan_in_ply_or_in_feet_gives_the_same_trees(files, tmp_path):
    scan = scan_of_scene()
    dem = write_ply(tmp_path / "scan.ply", np.concatenate([scan, np.full((5, 3), np.nan)]))
    read = read_forest(ForestFiles(dem=dem, plants=files["plants"]))
    foot = 1200 / 3937
    feet = write_cloud(tmp_path / "feet.las", scan / foot, np.ones(len(scan)), system("2263+6360"))
    in_feet = read_forest(ForestFiles(dem=feet, plants=files["plants"]))
    assert found_trees(read) == pytest.approx(found_trees(in_feet), abs=2)


def test_a_cloud_with_classes_has_a_canopy_without_its_houses(files, points, tmp_path):
    scene = forest_scene()
    canopy = scene.canopy.values.reshape(-1)
    above = (points + np.column_stack([np.zeros((len(points), 2)), canopy]))[canopy > 0]
    house = points[:400] + np.array([0, 0, 40.0])
    cloud = np.concatenate([points, above, house])
    classes = np.repeat([2, 5, 6], [len(points), len(above), len(house)])
    dem = write_cloud(tmp_path / "scan.laz", cloud, classes)
    read = read_forest(ForestFiles(dem=dem, plants=files["plants"]))
    assert found_trees(read) > 0.9 * len(scene.trees_m)
    assert np.nanmax(read.planted.canopy.values) < 20
    given = read_forest(ForestFiles(dem=dem, plants=files["plants"], canopy=files["canopy"]))
    assert "canopy-of-cloud" not in {remark.code for remark in given.remarks}


def test_ground_alone_has_no_canopy(files, points, tmp_path):
    dem = write_cloud(tmp_path / "ground.las", points)
    assert read_forest(ForestFiles(dem=dem, plants=files["plants"])).planted.canopy is None


def test_scans_without_ground_are_one_line_that_names_the_file(files, tmp_path, capsys):
    rng = np.random.default_rng(0)
    along, up = rng.uniform(0, 60, 5000), rng.uniform(0, 8, 5000)
    wall = np.column_stack([0.8 * along, 0.6 * along, up]) + rng.normal(0, 0.02, (5000, 3))
    text = refused(files, write_cloud(tmp_path / "wall.las", wall, np.ones(5000)), tmp_path, capsys)
    assert "wall.las: the lowest points lie on a line" in text
    three = np.array([[0.0, 0, 0], [9, 0, 1], [0, 9, 1]])
    text = refused(files, write_cloud(tmp_path / "three.las", three, np.ones(3)), tmp_path, capsys)
    assert "and 25 needed" in text
    assert "--canopy" in text
    nothing = write_ply(tmp_path / "nan.ply", np.full((50, 3), np.nan))
    assert "none of its 50 points can be used" in refused(files, nothing, tmp_path, capsys)


def test_a_cloud_in_feet_becomes_metres_and_the_spacing_stays_in_metres(files, points, tmp_path):
    foot = 1200 / 3937
    dem = write_cloud(tmp_path / "ground.las", points / foot, None, system("2263+6360"))
    settings = GroundSettings(spacing_m=0.5)
    read = read_forest(ForestFiles(dem=dem, plants=files["plants"], ground=settings))
    assert read.metres_per_unit == pytest.approx(foot)
    assert read.metres_per_height == pytest.approx(foot)
    assert read.planted.terrain.heights.cell_m == pytest.approx(0.5)
    np.testing.assert_allclose(read.planted.terrain.heights.values, forest_scene().dem.values, atol=0.01)


def refused(files, dem: Path, tmp_path: Path, capsys, *more: str) -> str:
    """The one line of an error of exit 2, and nothing written."""
    out = tmp_path / "none"
    assert main([*words(files, dem, *more), "-o", str(out)]) == 2
    streams = capsys.readouterr()
    assert not out.exists()
    assert "Traceback" not in streams.err
    (line,) = streams.err.strip().splitlines()
    assert dem.name in line
    return line


def test_clouds_that_cannot_be_are_one_line_that_names_the_file(files, points, tmp_path, capsys):
    whole = write_cloud(tmp_path / "whole.las", points)
    packed = write_cloud(tmp_path / "packed.laz", points)
    for source in (whole, packed):
        cut = tmp_path / f"cut_{source.name}"
        cut.write_bytes(source.read_bytes()[: source.stat().st_size // 2])
        assert "truncated" in refused(files, cut, tmp_path, capsys)
    (tmp_path / "empty.las").write_bytes(b"")
    assert "0 bytes" in refused(files, tmp_path / "empty.las", tmp_path, capsys)
    (tmp_path / "noise.laz").write_bytes(b"LASF" + bytes(range(256)) * 40)
    refused(files, tmp_path / "noise.laz", tmp_path, capsys)
    assert "does not exist" in refused(files, tmp_path / "gone.las", tmp_path, capsys)
    laspy.LasData(laspy.LasHeader(point_format=6, version="1.4")).write(tmp_path / "none.las")
    assert "no points" in refused(files, tmp_path / "none.las", tmp_path, capsys)
    withheld = write_cloud(tmp_path / "noise_alone.las", points[:100], np.full(100, 7))
    assert "none of its 100 points" in refused(files, withheld, tmp_path, capsys)
    one = write_cloud(tmp_path / "one.las", np.repeat(points[:1], 60, axis=0))
    refused(files, one, tmp_path, capsys)
    line = write_cloud(tmp_path / "line.las", points[:SIZE_PX])
    refused(files, line, tmp_path, capsys)
    degrees = write_las(tmp_path / "degrees.las", (points - points[0]) * 0.1, vlrs=[system(4326)])
    assert "is in degrees" in refused(files, degrees, tmp_path, capsys)
    wide = write_cloud(tmp_path / "wide.las", np.concatenate([points, [[2e6, 4e6, 0]]]))
    text = refused(files, wide, tmp_path, capsys, "--ground-spacing", "0.5")
    assert "400,000,000" in text
    assert "--ground-spacing" in text
    assert "heights in 0.0%" in refused(files, wide, tmp_path, capsys, "--ground-spacing", "1000")


def test_meshes_that_cannot_be_are_one_line_that_names_the_file(files, points, tmp_path, capsys):
    quads = grid_quads(SIZE_PX, SIZE_PX)
    assert "and no faces" in refused(files, write_obj(tmp_path / "points.obj", points, []), tmp_path, capsys)
    broken = points.copy()
    broken[7, 2] = np.nan
    assert "line 11" in refused(files, write_obj(tmp_path / "nan.obj", broken, quads), tmp_path, capsys)
    wall = write_obj(tmp_path / "wall.obj", points[:, [0, 2, 1]] * [1, 0, 1], quads)
    assert "covers ground" in refused(files, wall, tmp_path, capsys)
    standing = write_obj(tmp_path / "y_up.obj", points[:, [0, 2, 1]], quads)
    assert "stands upright" in refused(files, standing, tmp_path, capsys)
    far = write_obj(tmp_path / "far.obj", np.concatenate([points, [[1e9, 1e9, 0]]]), [*quads, [0, 1, 2, len(points)]])
    assert "400,000,000" in refused(files, far, tmp_path, capsys)
    square = [[0, 0, 0], [100, 0, 0], [0, 100, 0]]
    piled = write_obj(tmp_path / "piled.obj", square, [[0, 1, 2]] * 900)
    text = refused(files, piled, tmp_path, capsys, "--ground-spacing", "0.01")
    assert "over each other" in text
    assert "not there" in refused(files, tmp_path / "gone.obj", tmp_path, capsys)


@pytest.mark.parametrize("spacing", ["0", "-1", "nan"])
def test_a_spacing_that_cannot_be_is_refused(files, tmp_path, capsys, spacing):
    assert main([*words(files, files["dem"], "--ground-spacing", spacing), "-o", str(tmp_path / "none")]) == 2
    assert "ground_spacing" in capsys.readouterr().err


@pytest.mark.parametrize("width", ["0", "3", "nan"])
def test_a_widest_object_that_cannot_be_is_refused(files, tmp_path, capsys, width):
    assert main([*words(files, files["dem"], "--widest-object", width), "-o", str(tmp_path / "none")]) == 2
    assert "widest_object" in capsys.readouterr().err


def test_a_raster_takes_no_spacing(files, tmp_path, capsys):
    assert "leave out --ground-spacing" in refused(files, files["dem"], tmp_path, capsys, "--ground-spacing", "1")


def test_a_strip_of_a_mesh_and_a_dry_run(files, tmp_path, capsys):
    strip = np.array([[0, 0, 5], [100, 0, 6], [100, 1, 6], [0, 1, 5.0]])
    dem = write_obj(tmp_path / "strip.obj", strip, [[0, 1, 2, 3]])
    out = tmp_path / "none"
    assert main(["forest", str(dem), "--plants", str(files["plants"]), "-o", str(out), "--dry-run"]) == 0
    assert "terrain: 201 x 3 pixels of 0.5 m" in capsys.readouterr().out
    assert not out.exists()


def test_the_suffix_does_not_decide_what_is_a_cloud(files, points, tmp_path):
    cloud = write_cloud(tmp_path / "ground.las", points)
    other = cloud.rename(tmp_path / "ground.bin")
    assert read_forest(ForestFiles(dem=other, plants=files["plants"])).planted.terrain.hole_share == 0
    raster = write_raster(tmp_path / "ground.tif", forest_scene().dem.values.astype(np.float32))
    assert read_forest(ForestFiles(dem=raster, plants=files["plants"])).planted.terrain.hole_share == 0
