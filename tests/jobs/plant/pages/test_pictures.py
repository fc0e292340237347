import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.parts.leaf_part import LeafAssetSettings
from usdfoliage.capture.folder.read import read_capture
from usdfoliage.capture.lens import Lens
from usdfoliage.errors import AssetError
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.plant.pages.cards import draw_asset_pictures
from usdfoliage.jobs.plant.pages.pictures import (
    DrawnComparisons,
    PictureSettings,
    compare_silhouettes,
    draw_comparisons,
    draw_turntable,
    draw_variants,
    shrink_to_stage,
)
from usdfoliage.jobs.report.page_pictures import read_picture
from usdfoliage.leaf.shape.mesh import build_leaf_mesh

from tests.support.asset_shapes import read_shape
from tests.support.captures import look_at, write_photo, write_text_model
from tests.support.leaves.assets import PROVENANCE, random_leaves

SMALL = PictureSettings(
    turntable_frames=2, turntable_px=96, thumbnail_px=96, comparisons=2, comparison_px=320, variant_px=96, samples=1
)
CM = 0.01  # of the capture's files
LENS = Lens(model="PINHOLE", width_px=640, height_px=480, parameters=(600.0, 610.0, 330.0, 235.0))
# The capture's world has Z up; the plant stands beside its origin.
ASSET_FROM_WORLD = np.array([[1.0, 0, 0, -3], [0, 0, 1, -1], [0, -1, 0, 2], [0, 0, 0, 1]])


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    """An asset of 40 leaves and a capture of it in centimetres, with exact masks in the photographs' size."""
    folder = tmp_path_factory.mktemp("plant")
    leaves = random_leaves(40)
    leaves = replace(leaves, base_m=0.25 * leaves.base_m, length_m=np.linspace(0.3, 0.9, 40))
    (folder / "asset").mkdir()
    write_leaf_asset(
        folder / "asset",
        "spray",
        leaves,
        PROVENANCE,
        LeafAssetSettings(representations=("bezier", "mesh")),
        asset_from_capture=ASSET_FROM_WORLD @ np.diag([CM, CM, CM, 1]),
    )
    mesh = build_leaf_mesh(leaves)
    world_from_asset = np.linalg.inv(ASSET_FROM_WORLD)
    points_m = mesh.points_m.astype(np.float64) @ world_from_asset[:3, :3].T + world_from_asset[:3, 3]
    middle = (points_m.min(axis=0) + points_m.max(axis=0)) / 2
    away = 2.5 * np.linalg.norm(points_m - middle, axis=1).max()
    capture = folder / "capture"
    poses = {}
    for number, angle in enumerate((0.0, 1.5, 3.0)):
        position = middle + away * np.array([np.sin(angle), -np.cos(angle), 0.2])
        pose = look_at(position, middle, up=(0, 0, 1))
        name = f"{number}.png"
        write_photo(capture / "images" / name, (LENS.width_px, LENS.height_px), number)
        draw_mask(capture / "masks" / name, LENS.pinhole(pose), points_m, mesh)
        poses[name] = np.column_stack([pose[:, :3], pose[:, 3] / CM])
    write_text_model(capture / "cameras", poses, [LENS])
    (capture / "capture.toml").write_text(f'up_axis = "Z"\nmetres_per_unit = {CM}\n')
    return folder


@pytest.fixture(scope="module")
def shape(plant):
    return read_shape(plant / "asset")


def draw_mask(path, camera, points_m, mesh):
    """Fill every face where a pinhole camera sees it."""
    places, _ = camera.project(points_m)
    mask = np.zeros((camera.height_px, camera.width_px), np.uint8)
    for face in np.split(mesh.face_vertices, np.cumsum(mesh.face_counts)[:-1]):
        corners = np.rint((places[face] - 0.5) * 16).astype(np.int32)
        cv2.fillConvexPoly(mask, corners, 255, shift=4)
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), mask)


@pytest.mark.preview
def test_the_plant_lies_on_its_masks_from_every_camera(plant, shape, tmp_path):
    compared = draw_comparisons(plant / "asset", shape, read_capture(plant / "capture"), tmp_path, SMALL)
    assert len(compared.comparisons) == 2
    assert compared.remarks == ()
    for one in compared.comparisons:
        assert one.iou is not None
        assert one.iou > 0.9
        photograph, drawing = read_picture(one.photograph), read_picture(one.drawing)
        assert photograph.shape == drawing.shape == (240, 320, 3)


@pytest.mark.preview
def test_a_photograph_that_is_damaged_is_left_out_and_one_without_mask_has_no_figure(plant, shape, tmp_path):
    shutil.copytree(plant / "capture", tmp_path / "capture")
    shutil.rmtree(tmp_path / "capture" / "masks")
    (tmp_path / "capture" / "images" / "1.png").write_bytes(b"no picture")
    settings = PictureSettings(comparisons=3, comparison_px=64, samples=1)
    compared = draw_comparisons(plant / "asset", shape, read_capture(tmp_path / "capture"), tmp_path / "out", settings)
    assert [(one.name, one.iou) for one in compared.comparisons] == [("0.png", None), ("2.png", None)]
    assert [(each.code, each.subject) for each in compared.remarks] == [("photographs-not-compared", "1.png")]


@pytest.mark.preview
def test_pictures_are_the_same_bytes_when_drawn_again(plant, shape, tmp_path):
    drawn = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        paths = [
            *draw_turntable(plant / "asset", shape, folder, SMALL),
            draw_asset_pictures(plant / "asset", shape, folder, SMALL).thumbnail,
        ]
        compared = draw_comparisons(plant / "asset", shape, read_capture(plant / "capture"), folder, SMALL)
        paths += [path for one in compared.comparisons for path in (one.photograph, one.drawing)]
        drawn.append({path.name: path.read_bytes() for path in paths})
    assert len(drawn[0]) == 2 + 1 + 4
    assert drawn[0] == drawn[1]
    frames = [drawn[0][f"turntable_{number:03}.png"] for number in range(2)]
    assert len(set(frames)) == 2
    alpha = read_picture(tmp_path / "a" / "thumbnail.png")[..., 3]
    assert alpha[0].max() == 0
    assert alpha.max() == 255


@pytest.mark.preview
def test_every_variant_of_a_choice_is_drawn_from_one_place(plant, shape, tmp_path):
    drawn = draw_variants(plant / "asset", shape, tmp_path, SMALL)
    assert [(one.set, one.name, one.is_default) for one in drawn] == [
        ("representation", "bezier", True),
        ("representation", "mesh", False),
    ]
    bezier, mesh = (read_picture(one.picture).astype(int) for one in drawn)
    assert np.mean(np.abs(bezier - mesh).max(axis=2) > 40) < 0.05  # the same leaves in the same places


def test_without_photographs_nothing_is_compared(plant, shape, tmp_path):
    settings = PictureSettings(comparisons=0)
    compared = draw_comparisons(plant / "asset", shape, read_capture(plant / "capture"), tmp_path, settings)
    assert compared == DrawnComparisons()
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_asset_is_refused(tmp_path):
    shape = AssetShape(extent_m=None, asset_from_capture=np.eye(4), variants={}, selections={})
    with pytest.raises(AssetError, match="does not exist"):
        draw_turntable(tmp_path / "gone", shape, tmp_path)


def test_silhouettes_are_compared_at_the_size_of_the_drawing():
    mask = np.zeros((80, 120), bool)
    mask[20:60, 20:60] = True
    alpha = np.zeros((40, 60), np.float32)
    alpha[10:30, 20:40] = 1
    assert compare_silhouettes(mask, alpha) == pytest.approx(10 / 30)
    assert compare_silhouettes(np.zeros_like(mask), np.zeros_like(alpha)) == 0


def test_a_camera_of_a_scaled_plant_sees_the_same():
    camera = Pinhole(
        width_px=640,
        height_px=480,
        focal_px=(600.0, 610.0),
        center_px=(330.0, 235.0),
        cam_from_world=look_at((3, 2, 8), (0, 0, 0)),
    )
    stage_from_world = ASSET_FROM_WORLD @ np.diag([4.0, 4.0, 4.0, 1.0])
    shrunk = shrink_to_stage(camera, 320, stage_from_world)
    np.testing.assert_allclose(shrunk.cam_from_world[:, :3] @ shrunk.cam_from_world[:, :3].T, np.eye(3), atol=1e-12)
    points_m = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    on_stage = points_m @ stage_from_world[:3, :3].T + stage_from_world[:3, 3]
    np.testing.assert_allclose(2 * shrunk.project(on_stage)[0], camera.project(points_m)[0], atol=1e-9)


@pytest.mark.parametrize(
    "wrong", [{"turntable_frames": 1}, {"comparisons": -1}, {"thumbnail_px": 4}, {"samples": 0}, {"complexity": "x"}]
)
def test_settings_that_cannot_be_drawn_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must|needs"):
        PictureSettings(**wrong)
