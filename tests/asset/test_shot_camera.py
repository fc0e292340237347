"""Cameras of shots: their places in the forest's frame, at every frame, and files that cannot be."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom
from usdfoliage.asset.shot_camera import read_shot_camera
from usdfoliage.errors import AssetError


def shot(tmp_path, *, up="Y", unit=1.0, cameras=("/shot/cam",), frames=(1001, 1003), name="shot.usda"):
    """A file with cameras that look to -Z, a unit above the ground, and move a unit to +X a frame."""
    stage = Usd.Stage.CreateNew(str(tmp_path / name))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    if frames:
        stage.SetStartTimeCode(frames[0])
        stage.SetEndTimeCode(frames[1])
    stage.SetTimeCodesPerSecond(25)
    for path in cameras:
        camera = UsdGeom.Camera.Define(stage, path)
        camera.CreateFocalLengthAttr(20.0)
        camera.CreateHorizontalApertureAttr(40.0)
        camera.CreateVerticalApertureAttr(20.0)
        move = camera.AddTranslateOp()
        for frame in (1001, 1002, 1003):
            move.Set(Gf.Vec3d(frame - 1001, 0, 1) if up == "Z" else Gf.Vec3d(frame - 1001, 1, 0), frame)
        if up == "Z":
            camera.AddRotateXOp().Set(90.0)  # to look to +Y, up +Z
    stage.GetRootLayer().Save()
    return tmp_path / name


@pytest.mark.parametrize(("up", "unit"), [("Y", 1.0), ("Z", 1.0), ("Y", 0.01)])
def test_a_camera_stands_in_the_frame_of_forests(tmp_path, up, unit):
    camera = read_shot_camera(shot(tmp_path, up=up, unit=unit))
    assert camera.prim == "/shot/cam"
    assert camera.time_codes_per_second == 25
    assert camera.states_unit
    assert camera.path.frame.tolist() == [1001, 1002, 1003]
    np.testing.assert_allclose(camera.path.eye_m, unit * np.array([[0, 1, 0], [1, 1, 0], [2, 1, 0]]), atol=1e-9)
    np.testing.assert_allclose(camera.path.axes, np.broadcast_to(np.eye(3), (3, 3, 3)), atol=1e-6)
    np.testing.assert_allclose(camera.path.window, np.broadcast_to([-1, 1, -0.5, 0.5], (3, 4)), atol=1e-6)


def test_a_file_without_a_range_has_the_frames_of_its_camera(tmp_path):
    assert read_shot_camera(shot(tmp_path, frames=None)).path.frame.tolist() == [1001, 1002, 1003]


def test_frames_are_whole_and_within_the_shot(tmp_path):
    assert read_shot_camera(shot(tmp_path, frames=(1000.5, 1003.2))).path.frame.tolist() == [1001, 1002, 1003]
    assert read_shot_camera(shot(tmp_path, frames=(1.2, 1.8), name="short.usda")).path.frame.tolist() == [1.2]
    file = shot(tmp_path, frames=None, name="begin.usda")
    stage = Usd.Stage.Open(str(file))
    stage.SetStartTimeCode(1002)
    stage.GetRootLayer().Save()
    assert read_shot_camera(file).path.frame.tolist() == [1002, 1003]


@pytest.mark.parametrize(
    ("field", "value", "about"),
    [
        ("timeCodesPerSecond", "0", "time codes"),
        ("timeCodesPerSecond", "nan", "time codes"),
        ("timeCodesPerSecond", "-24", "time codes"),
        ("metersPerUnit", "0", "metersPerUnit"),
        ("metersPerUnit", "-1", "metersPerUnit"),
        ("metersPerUnit", "nan", "metersPerUnit"),
    ],
)
def test_units_and_rates_that_cannot_be_are_refused(tmp_path, field, value, about):
    file = shot(tmp_path)
    text = file.read_text()
    lines = [f"    {field} = {value}" if line.strip().startswith(field) else line for line in text.splitlines()]
    file.write_text("\n".join(lines))
    with pytest.raises(AssetError, match=about):
        read_shot_camera(file)


def test_cameras_of_instances_are_found(tmp_path):
    rig = shot(tmp_path, name="rig.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    prim = stage.DefinePrim("/rig")
    prim.GetReferences().AddReference(str(rig), "/shot")
    prim.SetInstanceable(True)
    stage.SetStartTimeCode(1001)
    stage.SetEndTimeCode(1003)
    stage.GetRootLayer().Save()
    assert read_shot_camera(tmp_path / "scene.usda").prim == "/rig/cam"


def test_one_of_several_cameras_is_named(tmp_path):
    file = shot(tmp_path, cameras=("/shot/left", "/shot/right"))
    assert read_shot_camera(file, "/shot/right").prim == "/shot/right"
    with pytest.raises(AssetError, match="2 cameras: /shot/left, /shot/right"):
        read_shot_camera(file)
    with pytest.raises(AssetError, match="no camera /shot/middle"):
        read_shot_camera(file, "/shot/middle")


def test_files_that_are_no_shot_are_refused(tmp_path):
    with pytest.raises(AssetError, match="no camera"):
        read_shot_camera(shot(tmp_path, cameras=(), name="none.usda"))
    with pytest.raises(AssetError, match="frames"):
        read_shot_camera(shot(tmp_path, frames=(0, 1e7), name="long.usda"))
    with pytest.raises(AssetError, match="frames"):
        read_shot_camera(shot(tmp_path, frames=(1e18, 1e18 + 1000), name="far.usda"))
    with pytest.raises(AssetError, match="from frame 5 to 1"):
        read_shot_camera(shot(tmp_path, frames=(5, 1), name="back.usda"))
    (tmp_path / "broken.usda").write_text("#usda 1.0\n(")
    with pytest.raises(AssetError, match=r"broken\.usda"):
        read_shot_camera(tmp_path / "broken.usda")
    with pytest.raises(AssetError, match=r"missing\.usda"):
        read_shot_camera(tmp_path / "missing.usda")


def test_cameras_without_perspective_or_picture_are_refused(tmp_path):
    file = shot(tmp_path)
    stage = Usd.Stage.Open(str(file))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/shot/cam"))
    camera.CreateProjectionAttr(UsdGeom.Tokens.orthographic)
    stage.GetRootLayer().Save()
    with pytest.raises(AssetError, match="no perspective"):
        read_shot_camera(file)
    camera.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    camera.CreateFocalLengthAttr(0.0)
    stage.GetRootLayer().Save()
    with pytest.raises(AssetError, match="no picture"):
        read_shot_camera(file)
