"""The viewer's window on a virtual display, led by scripts; and the camera that the mouse leads."""

import json
import math
import sys
from pathlib import Path

import cv2
import numpy as np
import orbit as orbits
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom
from usdfoliage.__main__ import main
from usdfoliage.asset.looks.look import read_look
from usdfoliage.errors import FoliageError, PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter
from usdfoliage.jobs.preview.viewer import ViewerSettings, view_asset

from tests.support.leaves.assets import random_leaves, write_spray
from tests.support.plant_assets import write_whole_plant

SIZE = {"width_px": 800, "height_px": 520}
WIDE, BEND, AMPLITUDE = 1.75, 0.25, 0.05


# The camera


def cube() -> orbits.Shape:
    corners = tuple(Gf.Vec3d(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
    return orbits.Shape(middle=Gf.Vec3d(0), corners=corners, reach=2 * math.sqrt(3))


def front(z_up: bool = False) -> orbits.Orbit:
    return orbits.frame_all(cube(), orbits.Direction(azimuth_rad=0.0, elevation_rad=0.0), z_up, 400, 300)


@pytest.mark.parametrize("z_up", [False, True])
def test_all_of_a_shape_is_framed(z_up: bool) -> None:
    frustum = orbits.camera_of(front(z_up), cube(), 400, 300).frustum
    assert all(frustum.Intersects(corner) for corner in cube().corners)


def test_a_drag_to_the_right_shows_more_of_the_left_side() -> None:
    turned = orbits.tumble(front(), 360, 0)
    assert turned.direction.azimuth_rad == pytest.approx(-math.pi / 2)
    assert orbits.camera_of(turned, cube(), 400, 300).transform.ExtractTranslation()[0] < -2


def test_a_camera_stops_above_the_pole() -> None:
    assert orbits.tumble(front(), 0, 10_000).direction.elevation_rad == pytest.approx(math.pi / 2)


def test_what_is_panned_stays_under_the_mouse() -> None:
    start = front()
    moved = orbits.truck(start, 30, -20, 300)

    def pixel(orbit: orbits.Orbit) -> np.ndarray:
        frustum = orbits.camera_of(orbit, cube(), 400, 300).frustum
        place = (frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()).Transform(start.target)
        return np.array([(place[0] + 1) * 200, (1 - place[1]) * 150])

    np.testing.assert_allclose(pixel(moved) - pixel(start), (30, -20), atol=1e-6)


def test_right_drag_and_wheel_come_nearer_and_never_through() -> None:
    assert orbits.zoom(front(), 50, 0).distance < front().distance
    assert orbits.zoom_wheel(front(), 120).distance == pytest.approx(front().distance * 0.88)
    assert 0 < orbits.zoom(front(), 1e6, 1e6).distance < front().distance


# The window


def play(asset: Path, folder: Path, actions: list[dict], **settings: object) -> None:
    """Do actions in a window."""
    script = folder / "script.json"
    script.write_text(json.dumps(actions), encoding="utf-8")
    view_asset(asset, ViewerSettings(script=script, **SIZE, **settings))


def covered(picture: np.ndarray) -> np.ndarray:
    """Which pixels differ from the background."""
    return np.abs(picture.astype(int) - picture[2, 2].astype(int)).max(axis=-1) > 12


def differ(first: np.ndarray, second: np.ndarray) -> float:
    """The share of what is covered in either picture that looks otherwise in the other."""
    either = covered(first) | covered(second)
    return float((np.abs(first.astype(int) - second.astype(int)).max(axis=-1)[either] > 12).mean())


@pytest.fixture(scope="module")
def session(display, tmp_path_factory):
    """One window on a spray; its pictures by name, and the folder of what it wrote."""
    folder = tmp_path_factory.mktemp("a viewer")
    assert main(["scatter", "-n", "50", "--seed", "1", "-o", str(folder / "spray")]) == 0
    before = {path: path.read_bytes() for path in (folder / "spray").rglob("*") if path.is_file()}

    def picture(name: str) -> dict:
        return {"picture": str(folder / f"{name}.png")}

    middle = [200, 200]
    play(
        folder / "spray",
        folder,
        [
            *[picture("start"), {"window": str(folder / "window.png")}],
            *[{"variant": {"representation": "mesh"}}, picture("mesh")],
            *[{"variant": {"representation": "nurbs"}}, picture("nurbs")],
            {"variant": {"representation": "bezier"}},
            *[{"edit": {"width": WIDE}}, picture("wide"), {"edit": {"bend": BEND}}],
            {"slide": {"amplitude": round(AMPLITUDE / 0.2 * 1000)}},
            *[picture("edited"), {"window": str(folder / "window_edited.png")}],
            {"save_look": str(folder / "saved.usda")},
            *[{"show_edits": False}, picture("hidden"), {"show_edits": True}, picture("shown")],
            *[{"reset": True}, picture("reset")],
            *[{"drag": {"alt": True, "from": middle, "to": [400, 200]}}, picture("turned")],
            *[{"drag": {"button": "middle", "from": middle, "to": [240, 200]}}, picture("panned")],
            *[{"wheel": -360}, picture("far"), {"frame_all": True}, picture("framed")],
        ],
    )
    pictures = {path.stem: cv2.imread(str(path)) for path in folder.glob("*.png")}
    after = {path: path.read_bytes() for path in (folder / "spray").rglob("*") if path.is_file()}
    assert after == before
    return folder, pictures


@pytest.mark.preview
def test_variants_show_the_same_leaves_otherwise(session) -> None:
    _, pictures = session
    assert 0.05 < covered(pictures["start"]).mean() < 0.6
    assert (pictures["start"] != pictures["mesh"]).any()
    assert differ(pictures["start"], pictures["mesh"]) < 0.1
    assert differ(pictures["start"], pictures["nurbs"]) > 0.05  # hulls are fuller


@pytest.mark.preview
def test_sliders_change_the_picture_at_once_and_reset_takes_it_back(session) -> None:
    _, pictures = session
    assert covered(pictures["wide"]).sum() > 1.2 * covered(pictures["start"]).sum()
    assert differ(pictures["wide"], pictures["edited"]) > 0.1
    assert differ(pictures["hidden"], pictures["start"]) == 0
    assert differ(pictures["shown"], pictures["edited"]) == 0
    assert differ(pictures["reset"], pictures["start"]) == 0


@pytest.mark.preview
def test_the_mouse_turns_pans_and_zooms(session) -> None:
    _, pictures = session
    assert differ(pictures["turned"], pictures["reset"]) > 0.3
    columns = [np.nonzero(covered(pictures[name]))[1].mean() for name in ("turned", "panned")]
    assert columns[1] - columns[0] == pytest.approx(40, abs=6)
    assert covered(pictures["far"]).sum() < 0.8 * covered(pictures["panned"]).sum()
    assert covered(pictures["framed"]).sum() > covered(pictures["far"]).sum()


@pytest.mark.preview
def test_the_saved_look_is_that_of_edit(session) -> None:
    folder, _ = session
    words = ["--width", WIDE, "--bend", BEND, "--jitter", AMPLITUDE, 8, "-o", folder / "edit.usda"]
    assert main(["edit", str(folder / "spray"), *map(str, words)]) == 0
    assert (folder / "saved.usda").read_bytes() == (folder / "edit.usda").read_bytes()


@pytest.mark.preview
def test_the_average_leaf_is_drawn_and_follows_the_sliders(session) -> None:
    _, pictures = session

    def blade(name: str) -> int:
        panel = pictures[name][:, -360:].astype(int)
        return int((np.abs(panel - (149, 199, 169)).max(axis=-1) < 10).sum())  # the blade's colour, BGR

    assert blade("window") > 500
    assert abs(blade("window_edited") - blade("window")) > 0.1 * blade("window")


@pytest.mark.preview
def test_a_look_is_drawn_over_its_asset_and_can_be_muted(display, session, tmp_path) -> None:
    folder, _ = session
    play(
        folder / "saved.usda",
        tmp_path,
        [
            {"picture": str(tmp_path / "look.png")},
            *[{"edit": {"width": 1.0}}, {"save_look": str(tmp_path / "narrow.usda")}, {"reset": True}],
            *[{"show_look": False}, {"picture": str(tmp_path / "muted.png")}],
            *[{"show_look": True}, {"picture": str(tmp_path / "again.png")}],
        ],
    )
    look, muted, again = (cv2.imread(str(tmp_path / f"{name}.png")) for name in ("look", "muted", "again"))
    assert differ(look, muted) > 0.2
    assert differ(look, again) == 0
    # The new look is one of the asset, with all that the old one shows and the width of the asset.
    written = Sdf.Layer.FindOrOpen(str(tmp_path / "narrow.usda"))
    assert read_look(written).asset == folder / "spray" / "spray.usda"
    text = written.ExportToString()
    assert "jitterAmplitude" in text
    assert "edit:width" not in text


@pytest.mark.preview
def test_purposes_guides_and_a_capture_are_drawn_when_asked(display, tmp_path) -> None:
    write_spray(tmp_path / "spray", random_leaves(20, seed=3))
    scene = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageUpAxis(scene, UsdGeom.Tokens.y)
    scene.DefinePrim("/plant").GetReferences().AddReference("./spray/spray.usda")
    proxy = UsdGeom.Cube.Define(scene, "/proxy")
    proxy.CreatePurposeAttr(UsdGeom.Tokens.proxy)
    proxy.CreateDisplayColorAttr([Gf.Vec3f(1, 0, 0)])
    scene.Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "capture.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.Xform.Define(stage, "/capture")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/capture"))
    for path in ("/capture/geo", "/capture/geo/guide"):
        UsdGeom.Scope.Define(stage, path)
    cloud = UsdGeom.Points.Define(stage, "/capture/geo/guide/Cloud")
    cloud.CreatePointsAttr([Gf.Vec3f(x, y, 6) for x in range(-4, 5) for y in range(-4, 5)])
    cloud.CreateWidthsAttr([1.0])
    cloud.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    cloud.CreateDisplayColorAttr([Gf.Vec3f(1, 0, 0)])
    cloud.CreateExtentAttr([(-5, -5, 5), (5, 5, 7)])
    UsdGeom.Scope.Define(stage, "/capture/geo/guide/Cameras")
    UsdGeom.Camera.Define(stage, "/capture/geo/guide/Cameras/one").AddTranslateOp().Set(Gf.Vec3d(0, 0, 9))
    stage.Save()
    names = ("start", "proxy", "cloud", "cameras", "hidden")
    start, proxies, with_cloud, cameras, hidden = ({"picture": str(tmp_path / f"{name}.png")} for name in names)
    play(
        tmp_path / "scene.usda",
        tmp_path,
        [
            *[start, {"purpose": {"proxy": True}}, proxies, {"purpose": {"proxy": False}}],
            *[{"guide": {"Cloud": True}}, with_cloud, {"guide": {"Cameras": True}}, cameras],
            *[{"guide": {"Cloud": False, "Cameras": False}}, hidden],
        ],
        capture=tmp_path / "capture.usda",
    )
    pictures = {name: cv2.imread(str(tmp_path / f"{name}.png")) for name in names}

    def red(name: str) -> int:
        blue, green, red = np.moveaxis(pictures[name].astype(int), -1, 0)
        return int(((red > green + 60) & (red > blue + 60)).sum())

    assert red("start") == 0
    assert red("proxy") > 500
    assert red("cloud") > 2000
    assert differ(pictures["cameras"], pictures["cloud"]) > 0
    assert differ(pictures["hidden"], pictures["start"]) == 0


@pytest.fixture(scope="module")
def plant_session(display, tmp_path_factory):
    """One window on a whole plant; its pictures by name, and the folder of what it wrote."""
    folder = tmp_path_factory.mktemp("a plant")
    write_whole_plant(folder / "oak", count=40)

    def picture(name: str) -> dict:
        return {"picture": str(folder / f"{name}.png")}

    play(
        folder / "oak",
        folder,
        [
            picture("start"),
            *[{"variant": {"lod": "both"}}, {"frame_all": True}, picture("render")],
            *[{"edit": {"width": WIDE}}, picture("wide"), {"window": str(folder / "window.png")}],
            {"save_look": str(folder / "saved.usda")},
            *[{"purpose": {"render": False, "proxy": True}}, picture("proxy")],
            *[{"purpose": {"render": True, "proxy": False}}, picture("render_again")],
            *[{"variant": {"lod": "crown"}}, picture("crown"), {"window": str(folder / "window_crown.png")}],
            *[{"variant": {"lod": "leaves"}}, picture("wide_leaves"), {"reset": True}, picture("reset")],
        ],
    )
    return folder, {path.stem: cv2.imread(str(path)) for path in folder.glob("*.png")}


def crown_green(picture: np.ndarray) -> float:
    """The share of a picture that is the crown's green."""
    blue, green, red = np.moveaxis(picture.astype(int), -1, 0)
    return float(((green > red + 20) & (green > blue + 20)).mean())


@pytest.mark.preview
def test_lods_and_purposes_of_a_whole_plant_are_drawn(plant_session) -> None:
    _, pictures = plant_session
    assert covered(pictures["render"]).any()
    assert differ(pictures["wide"], pictures["render"]) > 0.02
    assert differ(pictures["render_again"], pictures["wide"]) == 0
    assert crown_green(pictures["proxy"]) > 0.15
    assert differ(pictures["crown"], pictures["proxy"]) < 0.05
    assert differ(pictures["wide_leaves"], pictures["wide"]) < 0.01
    assert differ(pictures["reset"], pictures["render"]) < 0.01


@pytest.mark.preview
def test_the_saved_look_of_a_whole_plant_is_that_of_edit(plant_session) -> None:
    folder, _ = plant_session
    assert main(["edit", str(folder / "oak"), "--width", str(WIDE), "-o", str(folder / "edit.usda")]) == 0
    assert (folder / "saved.usda").read_bytes() == (folder / "edit.usda").read_bytes()


@pytest.mark.preview
def test_leaves_cannot_be_edited_where_the_crown_alone_is_drawn(display, plant_session, tmp_path) -> None:
    with pytest.raises(PreviewError, match="there is no slider width that can be moved"):
        play(plant_session[0] / "oak", tmp_path, [{"variant": {"lod": "crown"}}, {"edit": {"width": WIDE}}])


@pytest.mark.preview
@pytest.mark.parametrize(
    ("action", "message"),
    [
        ({"fly": 1}, "nothing is known of 'fly'"),
        ({"edit": {"colour": 1}}, "there is no slider colour"),
        ({"save_look": "/nowhere/look.txt"}, "its name must end with .usda"),
    ],
)
def test_an_action_that_fails_is_reported(display, session, tmp_path, action, message) -> None:
    with pytest.raises(PreviewError, match=message):
        play(session[0] / "spray", tmp_path, [action])


# What cannot be shown


def test_no_display_is_reported(tmp_path, monkeypatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    write_spray(tmp_path / "spray")
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", sys.executable)
    with pytest.raises(PreviewError, match=r"no display for a window .* `xvfb-run`"):
        view_asset(tmp_path / "spray")


def test_a_display_that_is_not_there_is_reported(display, session, monkeypatch) -> None:
    monkeypatch.setenv("DISPLAY", ":4711")
    with pytest.raises(PreviewError, match="display :4711 cannot be used"):
        view_asset(session[0] / "spray")


def test_no_preview_interpreter_is_reported(tmp_path, monkeypatch) -> None:
    write_spray(tmp_path / "spray")
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(tmp_path / "python"))
    with pytest.raises(PreviewError, match="USDFOLIAGE_HYDRA_PYTHON names no program"):
        view_asset(tmp_path / "spray")


def test_an_interpreter_without_usd_is_reported(tmp_path, monkeypatch) -> None:
    write_spray(tmp_path / "spray")
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} -S -E "$@"\n', encoding="utf-8")
    python.chmod(0o755)
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(python))
    monkeypatch.setenv("DISPLAY", ":4711")
    with pytest.raises(PreviewError, match="has no USD with imaging"):
        view_asset(tmp_path / "spray")


@pytest.mark.preview
def test_an_interpreter_without_qt_is_reported(display, session, tmp_path, monkeypatch) -> None:
    (tmp_path / "PySide6").mkdir()
    (tmp_path / "PySide6" / "__init__.py").write_text("raise ModuleNotFoundError('PySide6 is not there')\n")
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", str(find_interpreter()))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(PreviewError, match="has no Qt: PySide6 is not there; pip install PySide6-Essentials"):
        view_asset(session[0] / "spray")


def test_what_is_no_asset_is_reported(tmp_path) -> None:
    with pytest.raises(FoliageError, match="does not exist"):
        view_asset(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FoliageError, match="is no asset"):
        view_asset(tmp_path / "empty")


@pytest.mark.parametrize("text", ["{", '{"frame_all": true}', '[{"a": 1, "b": 2}]'])
def test_a_script_that_is_none_is_reported(tmp_path, monkeypatch, text) -> None:
    write_spray(tmp_path / "spray")
    monkeypatch.setenv("USDFOLIAGE_HYDRA_PYTHON", sys.executable)
    monkeypatch.setenv("DISPLAY", ":4711")
    (tmp_path / "script.json").write_text(text, encoding="utf-8")
    with pytest.raises(PreviewError, match=r"script\.json"):
        view_asset(tmp_path / "spray", ViewerSettings(script=tmp_path / "script.json"))


def test_a_window_too_small_is_refused() -> None:
    with pytest.raises(ValueError, match="200 x 200"):
        ViewerSettings(width_px=100)
