"""What Storm draws, against pictures computed by hand; one start of the preview interpreter a scene."""

import logging
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt
from scipy.spatial.transform import Rotation
from usdfoliage.errors import PreviewError
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, finish_picture

from tests.support.preview_stages import (
    CUBE_COLORS,
    bind_surface,
    define_mesh,
    new_stage,
    write_ball,
    write_cube,
    write_square,
)

REPOSITORY = Path(__file__).resolve().parents[2]
MARGIN = 0.05

BALL_RADIUS_M = 2.0
BALL_CENTER_M = (10.0, 20.0, -30.0)

pytestmark = pytest.mark.preview


def look(name, **arguments):
    return PreviewView(output=Path("unused.png"), direction=name, **arguments)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    scene = tmp_path_factory.mktemp("a ball in a folder with spaces") / "white ball.usda"
    write_ball(scene, BALL_RADIUS_M, BALL_CENTER_M)
    x, y, _ = BALL_CENTER_M
    views = [
        look("front"),
        look("front", orthographic=True),
        look("front", orthographic=True, window=(x - 4, x + 4, y - 3, y + 5), size_px=(320, 320)),
        look("three-quarter"),
        look("back"),
    ]
    return draw_views(scene, views, PreviewSettings(width_px=300, height_px=200))


def moments(picture):
    """Area, centre (column, row) and standard deviations (across, down) of what is covered, in pixels."""
    alpha = picture[..., 3].astype(np.float64)
    rows, columns = np.mgrid[: alpha.shape[0], : alpha.shape[1]] + 0.5
    area = alpha.sum()
    center = np.array([(alpha * columns).sum(), (alpha * rows).sum()]) / area
    variance = np.array([(alpha * (columns - center[0]) ** 2).sum(), (alpha * (rows - center[1]) ** 2).sum()]) / area
    return area, center, np.sqrt(variance)


def check_disc(picture, center_px, radius_px):
    area, center, spread = moments(picture)
    assert area == pytest.approx(math.pi * radius_px**2, rel=5e-3)
    np.testing.assert_allclose(center, center_px, atol=0.1)
    np.testing.assert_allclose(spread, radius_px / 2, rtol=5e-3)


def test_perspective_silhouette_of_a_ball(ball):
    # Its points are known, so the ball itself, not its cube, touches the margin.
    radius_px = 100 * (1 - 2 * MARGIN)
    check_disc(ball[0], (150, 100), radius_px)
    check_disc(ball[4], (150, 100), radius_px)


def test_orthographic_silhouette_of_a_ball(ball):
    check_disc(ball[1], (150, 100), 100 * (1 - 2 * MARGIN))


def test_pictures_of_one_sample_are_the_same_but_for_their_edges(ball, tmp_path):
    scene = tmp_path / "ball.usda"
    write_ball(scene, BALL_RADIUS_M, BALL_CENTER_M)
    (jagged,) = draw_views(scene, [look("front")], PreviewSettings(width_px=300, height_px=200, samples=1))
    soft = ball[0][..., 3]
    assert set(np.unique(jagged[..., 3])) == {0, 1}
    assert ((soft > 0) & (soft < 1)).any()
    whole = (soft == 1) & (jagged[..., 3] == 1)
    assert np.abs(jagged[whole] - ball[0][whole]).mean() < 0.005
    assert jagged[..., 3].sum() == pytest.approx(soft.sum(), rel=0.01)


def test_a_picture_of_a_million_triangles_has_the_size_and_the_edges_of_any_other(tmp_path):
    """It is drawn larger with one sample of a pixel, and shrunk."""
    scene = tmp_path / "fan.usda"
    stage = Usd.Stage.CreateNew(str(scene))
    turn = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(1000)])
    mesh = UsdGeom.Mesh.Define(stage, "/Disc")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.vstack([rim, [[0, 0, 0]]]).astype(np.float32)))
    corners = np.column_stack([np.full(1000, 1000), np.arange(1000), np.roll(np.arange(1000), -1)])
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.tile(corners.ravel(), 1001).astype(np.int32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(1001 * 1000, 3))
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateExtentAttr([(-1, -1, 0), (1, 1, 0)])
    stage.Save()
    view = replace(look("front"), orthographic=True, window=(-1.25, 1.25, -1.25, 1.25))
    (picture,) = draw_views(scene, [view], PreviewSettings(width_px=100, height_px=100))
    check_disc(picture, (50, 50), 40)
    assert len(np.unique(np.round(picture[..., 3], 2))) > 2


def test_a_window_places_the_picture_in_the_assets_own_coordinates(ball):
    check_disc(ball[2], (160, 200), BALL_RADIUS_M * 320 / 8)


@pytest.mark.parametrize("number", [0, 3, 4])
def test_white_is_neither_black_nor_burnt_out_and_lit_from_the_upper_left(ball, number):
    picture = ball[number]
    inside = picture[..., 3] > 0.999
    assert picture[inside][:, :3].min() > 0.15
    assert picture[inside][:, :3].max() < 1.05
    assert 0.4 < picture[inside][:, :3].mean() < 0.7
    np.testing.assert_allclose(picture[inside][:, 0], picture[inside][:, 2], atol=0.02)  # neutral
    assert picture[60, 110, 0] > 1.5 * picture[140, 190, 0]


def test_views_of_one_start_show_what_each_asks_for(tmp_path):
    """A card whose variant chooses its colour, and a proxy that is larger: no view changes what another one shows."""
    scene = tmp_path / "card.usda"
    stage = new_stage(scene)
    thing = stage.GetDefaultPrim()
    corners, face = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]), np.array([[0, 1, 2, 3]])
    choices = thing.GetVariantSets().AddVariantSet("color")
    for name, color in (("red", (0.8, 0, 0)), ("blue", (0, 0, 0.8))):
        choices.AddVariant(name)
        choices.SetVariantSelection(name)
        with choices.GetVariantEditContext():
            define_mesh(stage, "/Thing/Card", corners, face).CreateDisplayColorAttr([color])
    choices.SetVariantSelection("red")
    proxy = define_mesh(stage, "/Thing/Proxy", 2 * corners - [0, 0, 0.1], face)  # in one plane, either may be in front
    proxy.CreateDisplayColorAttr([(0, 0.8, 0)])
    proxy.CreatePurposeAttr("proxy")
    stage.Save()
    window = {"orthographic": True, "window": (-2.5, 2.5, -2.5, 2.5)}
    views = [
        look("front", **window),
        look("front", variants=(("color", "blue"),), **window),
        look("front", purposes=("default", "proxy"), **window),
        look("front", **window),
        look("front", variants=(("color", "blue"),), even_light=True, **window),
    ]
    settings = PreviewSettings(width_px=100, height_px=100)
    together = draw_views(scene, views, settings)
    for view, picture in zip(views, together, strict=True):
        (alone,) = draw_views(scene, [view], settings)
        assert np.array_equal(picture, alone)
    middles = [int(np.argmax(picture[50, 50, :3])) for picture in together]
    assert [middles[number] for number in (0, 1, 3, 4)] == [0, 2, 0, 2]
    areas = [float((picture[..., 3] > 0.5).mean()) for picture in together]
    assert areas == pytest.approx([0.16, 0.16, 0.64, 0.16, 0.16], abs=0.01)
    assert not np.array_equal(together[1], together[4])  # another light


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    scene = tmp_path_factory.mktemp("cube") / "cube.usda"
    write_cube(scene)
    names = ("front", "right", "back", "left", "top", "bottom")
    views = [*map(look, names), look("front", camera="/Thing/Straight"), look("front", camera="/Thing/Away")]
    return draw_views(scene, [*views, look("three-quarter")], PreviewSettings(width_px=64, height_px=64))


@pytest.mark.parametrize(("number", "face"), list(enumerate(["+Z", "+X", "-Z", "-X", "+Y", "-Y", "+Z"])))
def test_each_direction_sees_its_face_of_the_cube(cube, number, face):
    np.testing.assert_allclose(cube[number][32, 32], [*CUBE_COLORS[face], 1], atol=2e-3)


def test_three_quarters_show_front_right_and_top(cube):
    drawn = cube[8][cube[8][..., 3] > 0.999][:, :3]

    def share(face):
        return np.mean(np.all(np.abs(drawn - CUBE_COLORS[face]) < 0.01, axis=1))

    assert share("+Z") > share("+X") > share("+Y") > 0.01
    assert share("-X") == share("-Y") == share("-Z") == 0
    right = np.all(np.abs(cube[8][..., :3] - CUBE_COLORS["+X"]) < 0.01, axis=2)
    front = np.all(np.abs(cube[8][..., :3] - CUBE_COLORS["+Z"]) < 0.01, axis=2)
    assert np.nonzero(right)[1].mean() > np.nonzero(front)[1].mean()


def test_an_unlit_grey_of_18_percent_has_its_srgb_value(cube):
    finished = finish_picture(cube[2], (0.0, 0.0, 0.0))
    np.testing.assert_allclose(finished[32, 32], round(255 * float(encode_srgb(0.18))), atol=1)


def test_a_camera_of_the_file_is_looked_through(cube):
    assert cube[6][32, 32, 3] == 1
    assert not cube[7][..., 3].any()  # it looks away: an empty picture, not an error


def test_z_up_stages_stand_upright(tmp_path):
    write_cube(tmp_path / "z.usda", z_up=True)
    pictures = draw_views(
        tmp_path / "z.usda",
        [look("front"), look("right"), look("top")],
        PreviewSettings(width_px=32, height_px=32),
    )
    for picture, face in zip(pictures, ["-Y", "+X", "+Z"], strict=True):
        np.testing.assert_allclose(picture[16, 16, :3], CUBE_COLORS[face], atol=2e-3)


def test_a_shader_that_does_not_compile_is_an_error_with_the_prim_and_the_compilers_words(tmp_path):
    shader_file = tmp_path / "broken.glslfx"
    shader_file.write_text(
        "-- glslfx version 0.1\n-- configuration\n"
        '{ "techniques": { "default": { "surfaceShader": { "source": [ "Broken" ] } } } }\n-- glsl Broken\n'
        "vec4 surfaceShader(vec4 Peye, vec3 Neye, vec4 color, vec4 patchCoord) { return vec4(undeclaredWord, 1); }\n"
    )
    scene = tmp_path / "broken.usda"
    write_square(scene)
    stage = Usd.Stage.Open(str(scene))
    shader = bind_surface(UsdGeom.Mesh.Get(stage, "/Thing/Square"))
    shader.GetPrim().RemoveProperty("info:id")
    shader.SetSourceAsset(Sdf.AssetPath("./broken.glslfx"), "glslfx")
    stage.Save()
    with pytest.raises(PreviewError, match=r"/Thing/Square.*undeclaredWord.*broken\.usda"):
        draw_views(scene, [look("front")], PreviewSettings(width_px=32, height_px=32))


def test_missing_textures_and_references_are_warned_of_and_our_schemas_do_no_harm(tmp_path, caplog, monkeypatch):
    scene = tmp_path / "gaps.usda"
    write_square(scene)
    stage = Usd.Stage.Open(str(scene))
    square = UsdGeom.Mesh.Get(stage, "/Thing/Square")
    surface = bind_surface(square)
    texture = UsdShade.Shader.Define(stage, "/Thing/Texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./lost.png")
    texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    color.ConnectToSource(texture.ConnectableAPI(), "rgb")
    square.GetPrim().SetMetadata(
        "apiSchemas", Sdf.TokenListOp.CreateExplicit(["MaterialBindingAPI", "FoliageCrownAPI"])
    )
    stage.GetRootLayer().ImportFromString(
        stage.GetRootLayer()
        .ExportToString()
        .replace('def Mesh "Square" (', 'def Mesh "Square" (\n references = @./lost.usda@')
    )
    stage.Save()
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", str(REPOSITORY / "schemas" / "usdFoliage"))
    with caplog.at_level(logging.WARNING):
        pictures = draw_views(scene, [look("front")], PreviewSettings(width_px=32, height_px=32))
    assert pictures[0][16, 16, 3] == 1
    messages = [record.message for record in caplog.records]
    assert len(messages) == 2
    assert "/Thing/Texture.inputs:file: no file ./lost.png" in messages[0]
    assert "lost.usda" in messages[1]


def pinhole_behind(corner_m, focal_px, center_px, size_px=(300, 200)):
    """A camera that stands off the corner, turned and rolled so that it sees it off the middle of its picture."""
    turn = Rotation.from_euler("zyx", [25.0, 12.0, -155.0], degrees=True).as_matrix()
    in_cam = np.array([0.3, -0.2, 4.0])
    return Pinhole(
        width_px=size_px[0],
        height_px=size_px[1],
        focal_px=focal_px,
        center_px=center_px,
        cam_from_world=np.column_stack([turn, in_cam - turn @ np.array(corner_m)]),
    )


@pytest.mark.parametrize(
    ("focal_px", "center_px"), [((400.0, 400.0), (150.0, 100.0)), ((420.0, 350.0), (171.5, 83.25))]
)
def test_a_known_point_is_drawn_where_a_pinhole_camera_sees_it(tmp_path, focal_px, center_px):
    scene = tmp_path / "ball.usda"
    at = (1.0, 2.0, -3.0)
    write_ball(scene, 0.1, at)
    pinhole = pinhole_behind(at, focal_px, center_px)
    (picture,) = draw_views(scene, [look("front", pinhole=pinhole)], PreviewSettings())
    assert picture.shape == (200, 300, 4)
    area, center, _ = moments(picture)
    (place_px,), (depth_m,) = pinhole.project(np.array([at]))
    np.testing.assert_allclose(center, place_px, atol=0.15)
    assert area == pytest.approx(math.pi * 0.1**2 * focal_px[0] * focal_px[1] / depth_m**2, rel=0.02)


def test_what_a_pinhole_camera_sees_is_not_mirrored(tmp_path):
    scene = tmp_path / "cube.usda"
    write_cube(scene)
    # From the front: x right, y down, z forward in the stage are +X, -Y, -Z.
    front = np.diag([1.0, -1.0, -1.0])
    pinhole = Pinhole(
        width_px=120,
        height_px=90,
        focal_px=(120.0, 120.0),
        center_px=(60.0, 45.0),
        cam_from_world=np.column_stack([front, -front @ np.array([4.2, 1.9, 2.0])]),
    )
    (picture,) = draw_views(scene, [look("front", pinhole=pinhole)], PreviewSettings())
    places_px, _ = pinhole.project(np.array([[3.2, 1.2, -1.5], [3.5, 1.0, -2.0], [3.0, 1.5, -2.0]]))
    for (x_px, y_px), face in zip(places_px, ("+Z", "+X", "+Y"), strict=True):
        np.testing.assert_allclose(picture[int(y_px), int(x_px), :3], CUBE_COLORS[face], atol=0.02)
