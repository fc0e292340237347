"""A capture in USD: cameras that see what the photographs show, the photographs behind them, the cloud before them."""

import errno
import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdValidation
from usdfoliage.asset.capture_layer import (
    CaptureCamera,
    CaptureLayerSettings,
    author_camera,
    author_cloud,
    author_image_plane,
    depth_range,
    write_capture_layer,
)
from usdfoliage.asset.validation.known_findings import KnownFindings
from usdfoliage.asset.validation.nvidia_rules import run_nvidia_rules
from usdfoliage.capture.cloud.fusion import SeenSurface, merge_views
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.capture.lens import Lens, undistort
from usdfoliage.errors import AssetError, PreviewError
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.geometry.up_turn import turn_to_y_up
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, encode_png, finish_picture
from usdfoliage.jobs.preview.recorder import find_interpreter

from tests.support.captures import LENS, look_at, ring, sphere_depth
from tests.support.machines.blender import blender_interpreter

CAMERAS = "/capture/geo/guide/Cameras"
CLOUD = "/capture/geo/guide/Cloud"
WIDE = Lens(model="OPENCV", width_px=320, height_px=240, parameters=(300.0, 300, 171, 112, -0.25, 0.06, 0.002, -0.003))


def some_cloud(count: int = 200, seed: int = 0, middle_m: tuple[float, float, float] = (0, 0, 0)) -> Cloud:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Cloud(
        points_m=0.5 * normals + middle_m,
        normals=normals.astype(np.float32),
        srgb=rng.integers(0, 256, (count, 3), dtype=np.uint8),
        confidence=rng.uniform(0, 1, count).astype(np.float32),
        views=rng.integers(1, 9, count, dtype=np.int32),
    )


def ring_cameras(count: int = 3, lens: Lens = LENS) -> list[CaptureCamera]:
    return [
        CaptureCamera(name=name, photo=f"images/{name}", camera=lens.pinhole(pose), lens=lens)
        for name, pose in ring(count).items()
    ]


def write(folder: Path, cloud: Cloud | None = None, **settings: object) -> Usd.Stage:
    cloud = some_cloud() if cloud is None else cloud
    layer = folder / "capture.usda"
    write_capture_layer(layer, ring_cameras(), cloud, settings=CaptureLayerSettings(**settings))  # type: ignore[arg-type]
    return Usd.Stage.Open(str(layer))


def project(camera: UsdGeom.Camera, points_m: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Places in pixels, from what USD itself makes of the camera."""
    frustum = camera.GetCamera(Usd.TimeCode.Default()).frustum
    matrix = np.array(frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix())
    clip = np.column_stack([points_m, np.ones(len(points_m))]) @ matrix
    ndc = clip[:, :2] / clip[:, 3:]
    return (ndc * (0.5, -0.5) + 0.5) * size


# Cameras


@given(
    position=st.tuples(*[st.floats(-50, 50)] * 3),
    focal=st.tuples(st.floats(50, 5000), st.floats(0.7, 1.4)),
    center=st.tuples(st.floats(-0.3, 1.3), st.floats(-0.3, 1.3)),
    size=st.tuples(st.integers(16, 6000), st.integers(16, 6000)),
)
def test_a_camera_sees_points_where_the_pinhole_does(position, focal, center, size):
    target = np.add(position, (0.3, -0.2, 0.9))
    pinhole = Pinhole(
        width_px=size[0],
        height_px=size[1],
        focal_px=(focal[0], focal[0] * focal[1]),
        center_px=(center[0] * size[0], center[1] * size[1]),
        cam_from_world=look_at(position, target),
    )
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 1, (20, 2)) * size
    points_m = pinhole.unproject(places, rng.uniform(0.5, 20, 20))
    stage = Usd.Stage.CreateInMemory()
    camera = author_camera(
        stage,
        Sdf.Path("/Camera"),
        CaptureCamera(name="a", photo="a.jpg", camera=pinhole),
        depth_range(pinhole, points_m, []),
    )
    # 1e-6 of the picture: lens and film are float32 in USD.
    spread = 1 + np.abs(np.array(center) - 0.5)
    np.testing.assert_allclose(project(camera, points_m, size) / size, places / size, rtol=0, atol=1e-6 * spread.max())
    near_m, far_m = camera.GetClippingRangeAttr().Get()
    _, depth_m = pinhole.project(points_m)
    assert 0 < near_m < depth_m.min()
    assert depth_m.max() < far_m


def test_a_camera_has_a_film_of_36_mm_in_tenths_of_metres():
    stage = Usd.Stage.CreateInMemory()
    camera = author_camera(stage, Sdf.Path("/Camera"), ring_cameras()[0], (1.0, 2.0, 3.0))
    focal = LENS.focal_px[1]  # the height follows the lens where its pixels are not square
    assert camera.GetHorizontalApertureAttr().Get() == pytest.approx(0.36)
    assert camera.GetFocalLengthAttr().Get() == pytest.approx(0.36 * LENS.focal_px[0] / LENS.width_px)
    assert camera.GetVerticalApertureAttr().Get() == pytest.approx(
        LENS.height_px / focal * camera.GetFocalLengthAttr().Get()
    )
    assert camera.GetFocusDistanceAttr().Get() == 2.0


def test_depths_of_what_is_not_seen_come_from_the_cameras():
    cameras = [each.camera for each in ring_cameras()]
    nearest, middle, farthest = depth_range(cameras[0], np.zeros((0, 3)), cameras)
    assert nearest < middle < farthest
    away = np.linalg.norm(cameras[0].position_m - cameras[1].position_m)
    assert middle == pytest.approx(10 * away)
    assert depth_range(cameras[0], np.zeros((0, 3)), cameras[:1])[1] == pytest.approx(1.0)
    behind = cameras[0].position_m[None] * 2
    assert depth_range(cameras[0], behind, cameras[:1])[1] == pytest.approx(1.0)


def test_names_of_photographs_become_names_of_prims(tmp_path):
    camera = ring_cameras()[0]
    photos = ["000.jpg", "000.png", "left/a b.jpg", "Left/A B.png", "äpfel.jpg"]
    cameras = [replace(camera, name=name, photo=f"images/{name}") for name in photos]
    write_capture_layer(tmp_path / "capture.usda", cameras, some_cloud())
    stage = Usd.Stage.Open(str(tmp_path / "capture.usda"))
    prims = stage.GetPrimAtPath(CAMERAS).GetChildren()
    assert [prim.GetDisplayName() for prim in prims] == photos
    assert len({prim.GetName().lower() for prim in prims}) == 5
    assert [prim.GetName() for prim in prims[:4]] == ["view_000", "view_000_2", "left_a_b", "Left_A_B_2"]


# Image planes


@pytest.fixture
def stage() -> Usd.Stage:
    return Usd.Stage.CreateInMemory()


def plane_of(stage: Usd.Stage, camera: CaptureCamera) -> UsdGeom.Mesh:
    return author_image_plane(stage, Sdf.Path("/Plane"), camera, 2.0)


@pytest.mark.parametrize("lens", [LENS, WIDE], ids=["pinhole", "distorted"])
def test_an_image_plane_shows_every_pixel_where_its_lens_saw_it(stage, lens):
    camera = replace(ring_cameras(1, lens)[0], lens=lens)
    mesh = plane_of(stage, camera)
    points = np.array(mesh.GetPointsAttr().Get(), np.float64)
    st_ = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get(), np.float64)
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    assert (len(faces) == 1) == lens.is_pinhole
    np.testing.assert_allclose(points[:, 2], -2)
    # Places of the picture without distortion, and of the photograph.
    places = points[:, :2] / 2 * (1, -1) * lens.focal_px + lens.center_px
    photo = np.column_stack([st_[:, 0], 1 - st_[:, 1]]) * (lens.width_px, lens.height_px)
    if lens.is_pinhole:
        np.testing.assert_allclose(places, photo, atol=1e-4)
    else:
        undistortion = undistort(lens)
        inside = np.all((places > 1) & (places < (lens.width_px - 1, lens.height_px - 1)), axis=1)
        at = np.float32(places[inside] - 0.5)[None]
        for axis, pixel_map in enumerate((undistortion.x, undistortion.y)):
            expected = cv2.remap(pixel_map, at[..., 0], at[..., 1], cv2.INTER_LINEAR)[0] + 0.5
            np.testing.assert_allclose(photo[inside, axis], expected, atol=0.05)
    a, b, c = (points[faces[:, corner]] for corner in (0, 1, 2))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()  # it faces the camera


def test_an_image_plane_ends_where_its_lens_turns_back(stage):
    lens = Lens(model="SIMPLE_RADIAL", width_px=100, height_px=80, parameters=(45.0, 50, 40, -0.3))
    mesh = plane_of(
        stage, CaptureCamera(name="a", photo="a.jpg", camera=lens.pinhole(look_at((0, 0, 1), (0, 0, 0))), lens=lens)
    )
    points = np.array(mesh.GetPointsAttr().Get())
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    assert np.isfinite(points).all()
    assert 0 < len(faces) / 4 < 48 * 38
    assert sorted(set(faces.tolist())) == list(range(len(points)))


def test_photographs_are_off_until_one_is_chosen(tmp_path):
    stage = write(tmp_path)
    camera = stage.GetPrimAtPath(CAMERAS).GetChildren()[1]
    assert not camera.GetChildren()
    camera.GetVariantSet("imagePlane").SetVariantSelection("on")
    (plane,) = camera.GetChildren()
    assert plane.IsA(UsdGeom.Mesh)
    material = UsdShade.MaterialBindingAPI(plane).ComputeBoundMaterial()[0]
    texture = UsdShade.Shader(material.GetPrim().GetChild("Texture"))
    assert texture.GetInput("file").Get().path == "./images/001.png"
    assert texture.GetInput("sourceColorSpace").Get() == "sRGB"
    assert UsdGeom.BackPlateAPI(camera, "photograph").GetImageAttr().Get().path == "./images/001.png"
    nearest = project(UsdGeom.Camera(camera), np.array(UsdGeom.Mesh(plane).GetPointsAttr().Get()), (64, 48))
    assert np.isfinite(nearest).all()
    depth_m = -np.array(UsdGeom.Mesh(plane).GetPointsAttr().Get())[:, 2]
    _, far_m = UsdGeom.Camera(camera).GetClippingRangeAttr().Get()
    _, points_m = ring_cameras()[1].camera.project(some_cloud().points_m)
    assert points_m.max() < depth_m.min() <= depth_m.max() < far_m


# The frame


def test_a_world_in_which_neither_y_nor_z_is_up_is_turned(tmp_path):
    cloud = some_cloud()
    turn = np.eye(4)
    turn[:3, :3] = turn_to_y_up(np.array([0.6, -0.8, 0.0]))
    stage = write(tmp_path, cloud, asset_from_world=turn)
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    points = UsdGeom.Points.Get(stage, CLOUD)
    np.testing.assert_allclose(points.GetPointsAttr().Get(), cloud.points_m, atol=1e-7)
    matrix = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(points.GetPrim()))
    np.testing.assert_allclose(np.array([0.6, -0.8, 0.0, 0]) @ matrix, [0, 1, 0, 0], atol=1e-12)


# The cloud


def test_a_cloud_has_all_that_it_had(tmp_path):
    cloud = some_cloud()
    stage = write(tmp_path, cloud, up_axis="Z")
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    points = UsdGeom.Points.Get(stage, CLOUD)
    primvars = UsdGeom.PrimvarsAPI(points)
    np.testing.assert_allclose(points.GetPointsAttr().Get(), cloud.points_m, atol=1e-7)
    np.testing.assert_array_equal(points.GetNormalsAttr().Get(), cloud.normals)
    np.testing.assert_array_equal(primvars.GetPrimvar("confidence").Get(), cloud.confidence)
    np.testing.assert_array_equal(primvars.GetPrimvar("views").Get(), cloud.views)
    share = cloud.srgb / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(primvars.GetPrimvar("displayColor").Get(), linear, atol=1e-6)
    assert {primvars.GetPrimvar(name).GetInterpolation() for name in ("displayColor", "confidence", "views")} == {
        "vertex"
    }
    low, high = np.array(points.GetExtentAttr().Get())
    assert (low < cloud.points_m.min(axis=0)).all()
    assert (high > cloud.points_m.max(axis=0)).all()
    hint = UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint()
    np.testing.assert_allclose(hint, [low, high])


@given(away_m=st.sampled_from([0.0, 1e3, 4e5, -7e6]))
def test_a_cloud_far_from_the_origin_keeps_its_places(away_m):
    cloud = some_cloud(middle_m=(away_m, 0.3, -away_m))
    stage = Usd.Stage.CreateInMemory()
    points = author_cloud(
        stage, stage.DefinePrim("/A").GetPath().AppendChild("Cloud"), cloud, np.full(len(cloud), 0.01, np.float32)
    )
    matrix = np.array(UsdGeom.Xformable(points).ComputeLocalToWorldTransform(Usd.TimeCode.Default()))
    places = np.column_stack([np.array(points.GetPointsAttr().Get(), np.float64), np.ones(len(cloud))]) @ matrix
    np.testing.assert_allclose(places[:, :3], cloud.points_m, rtol=0, atol=1e-4)


def test_a_capture_without_points_has_its_cameras(tmp_path):
    stage = write(tmp_path, some_cloud(0))
    assert len(stage.GetPrimAtPath(CAMERAS).GetChildren()) == 3
    assert not stage.GetPrimAtPath(CLOUD)


# The layer


def test_nothing_heavy_is_read_without_the_payload(tmp_path):
    write(tmp_path)
    stage = Usd.Stage.Open(str(tmp_path / "capture.usda"), Usd.Stage.LoadNone)
    assert len(stage.GetUsedLayers()) == 2  # with the session's
    assert len(stage.GetPrimAtPath(CAMERAS).GetChildren()) == 3
    stage.Load()
    assert stage.GetPrimAtPath(CLOUD).IsA(UsdGeom.Points)


def test_the_same_capture_gives_the_same_bytes(tmp_path):
    written = []
    for name in ("a", "b"):
        write(tmp_path / name)
        written.append({path.name: path.read_bytes() for path in sorted((tmp_path / name).iterdir())})
    assert list(written[0]) == ["capture.usda", "capture_cloud.usdc"]
    assert written[0] == written[1]


def test_writing_again_replaces_what_is_open(tmp_path):
    stage = write(tmp_path)
    write(tmp_path, some_cloud(7))
    assert len(UsdGeom.Points.Get(stage, CLOUD).GetPointsAttr().Get()) == 7


@pytest.mark.parametrize("plane", ["off", "on"])
def test_validators_have_no_errors(tmp_path, plane):
    stage = write(tmp_path)
    for name in ring(3):
        cv2.imwrite(str(tmp_path / name), np.zeros((48, 64, 3), np.uint8))
        (tmp_path / "images").mkdir(exist_ok=True)
        (tmp_path / name).rename(tmp_path / "images" / name)
    for camera in stage.GetPrimAtPath(CAMERAS).GetChildren():
        camera.GetVariantSet("imagePlane").SetVariantSelection(plane)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    problems = UsdValidation.ValidationContext(validators=validators).Validate(stage)
    assert [problem.GetMessage() for problem in problems] == []
    found = {(finding.severity, finding.validator) for finding in run_nvidia_rules(stage, KnownFindings())}
    assert found <= {("warning", "nvidia:IndexedPrimvarChecker")}  # colours of points are what they are


def test_a_full_disk_leaves_the_old_layer(tmp_path, monkeypatch):
    write(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}

    def full(_self, _target):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(
        AssetError,
        match=r"No space left on device, [\d,]+ MB are free there; what was there is unchanged",
    ):
        write_capture_layer(tmp_path / "capture.usda", ring_cameras(), some_cloud(7))
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_wrong_arguments_are_refused(tmp_path):
    with pytest.raises(ValueError, match="up_axis"):
        CaptureLayerSettings(up_axis="X")
    with pytest.raises(ValueError, match="point_width_m"):
        CaptureLayerSettings(point_width_m=0)
    with pytest.raises(ValueError, match="name must be"):
        write_capture_layer(tmp_path / "a.usda", [], some_cloud(), "two words")
    with pytest.raises(ValueError, match="as seen from the layer's folder"):
        write_capture_layer(tmp_path / "a.usda", [replace(ring_cameras()[0], photo="/a.jpg")], some_cloud())


# In Storm


def draw(layer: Path, camera: str, size: tuple[int, int], planes: bool = False) -> np.ndarray:
    """What the camera sees, (H, W, 4), sRGB with straight alpha."""
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    settings = PreviewSettings(variants=(("imagePlane", "on"),) if planes else ())
    view = PreviewView(output=Path("unused.png"), camera=camera, size_px=size)
    return finish_picture(draw_views(layer, [view], settings)[0], None)


def painted(lens: Lens) -> np.ndarray:
    """A photograph (H, W, 3) in soft colours, of which no two places look the same."""
    y, x = np.mgrid[: lens.height_px, : lens.width_px] + 0.5
    waves = [np.sin(x / 17) * np.cos(y / 23), np.cos(x / 29 + y / 19), x / lens.width_px * 2 - 1]
    return np.rint(127.5 + 110 * np.stack(waves, -1)).astype(np.uint8)


@pytest.mark.preview
def test_a_photograph_with_distortion_stands_where_its_camera_sees_it(tmp_path):
    photo = painted(WIDE)
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "a.png").write_bytes(encode_png(photo))
    camera = CaptureCamera(
        name="a.png", photo="images/a.png", camera=WIDE.pinhole(look_at((1, 2, 3), (0, 0, 0))), lens=WIDE
    )
    write_capture_layer(tmp_path / "capture.usda", [camera], some_cloud(0))
    drawn = draw(tmp_path / "capture.usda", f"{CAMERAS}/a", (WIDE.width_px, WIDE.height_px), planes=True)
    undistortion = undistort(WIDE)
    seen = undistortion.inside & (drawn[..., 3] > 250)
    assert np.mean(seen[undistortion.inside]) > 0.97
    off = np.abs(drawn[..., :3].astype(float) - undistortion.smooth(photo))[seen]
    assert off.mean() < 1.0
    assert np.quantile(off, 0.99) < 5
    shifted = np.abs(np.roll(drawn, 1, axis=1)[..., :3].astype(float) - undistortion.smooth(photo))[seen]
    assert shifted.mean() > 3 * off.mean()


@pytest.mark.preview
def test_the_cloud_lies_over_the_photograph(tmp_path):
    lens = Lens(model="PINHOLE", width_px=320, height_px=240, parameters=(400.0, 400, 171, 112))
    camera = lens.pinhole(look_at((0.4, 0.8, 1.6), (0, 0, 0)))
    depth_m = sphere_depth(camera, 0.5).astype(np.float32)
    photo = painted(lens)
    rays = camera.rays() * depth_m[..., None]
    normals = (rays - camera.cam_from_world[:, 3]) @ camera.cam_from_world[:, :3] / 0.5
    surface = SeenSurface(
        camera=camera,
        depth_m=depth_m,
        normals=normals.astype(np.float32),
        srgb=photo,
        confidence=np.ones(depth_m.shape, np.float32),
    )
    cloud = merge_views([surface])
    write_capture_layer(tmp_path / "capture.usda", [CaptureCamera(name="a", photo="a.png", camera=camera)], cloud)
    drawn = draw(tmp_path / "capture.usda", f"{CAMERAS}/a", (320, 240))
    covered, plant = drawn[..., 3] > 128, depth_m > 0
    assert np.count_nonzero(covered & plant) / np.count_nonzero(covered | plant) > 0.97
    inner = cv2.erode(plant.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    off = np.abs(drawn[..., :3].astype(float) - photo)[inner & covered]
    assert off.mean() < 4
    shifted = np.abs(np.roll(drawn, 2, axis=1)[..., :3].astype(float) - photo)[inner & covered]
    assert shifted.mean() > 1.5 * off.mean()


BLENDER = """
import json, sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=sys.argv[1])
found = {"points": [len(o.data.points) for o in bpy.data.objects if o.type == "POINTCLOUD"], "cameras": {}}
for o in bpy.data.objects:
    if o.type == "CAMERA":
        c = o.data
        numbers = [c.lens, c.sensor_width, c.sensor_height, c.shift_x, c.shift_y, *o.matrix_world.translation]
        found["cameras"][o.name] = numbers
print("FOUND" + json.dumps(found))
"""


@pytest.mark.preview
def test_blender_has_the_cameras_and_the_cloud(tmp_path):
    python = blender_interpreter()
    write(tmp_path)
    words = [python, "-c", BLENDER, str(tmp_path / "capture.usda")]
    printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    found = json.loads(next(line for line in printed.splitlines() if line.startswith("FOUND"))[5:])
    assert found["points"] == [200]
    for camera, pose in zip(("view_000", "view_001", "view_002"), ring_cameras(), strict=True):
        lens_mm, width_mm, height_mm, x, y, *place_m = found["cameras"][camera]
        assert lens_mm / width_mm == pytest.approx(LENS.focal_px[0] / LENS.width_px, rel=1e-5)
        assert lens_mm / height_mm == pytest.approx(LENS.focal_px[1] / LENS.height_px, rel=1e-5)
        assert width_mm == pytest.approx(36)
        # Blender counts shifts in widths of the film; the principal point is a pixel right of and above the middle.
        shift_px = np.array([x, y]) * width_mm / lens_mm * LENS.focal_px
        np.testing.assert_allclose(shift_px, (-1, -1), rtol=1e-4)
        np.testing.assert_allclose(place_m, pose.camera.position_m[[0, 2, 1]] * (1, -1, 1), atol=1e-5)  # Z up there
