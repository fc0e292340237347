"""What Storm draws of the ground: the orthophoto from afar, noise of mean 0 near by, and darker under plants."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.materials.ground import GROUND_SHADER, GroundMaterial, author_ground_material
from usdfoliage.asset.materials.layer import GROUND_MATERIAL, copy_shaders, write_materials_layer
from usdfoliage.asset.parts.sky import SkyPrim, write_sky_layer, write_sky_picture
from usdfoliage.asset.parts.terrain import TerrainPrim, write_terrain_layer
from usdfoliage.errors import PreviewError
from usdfoliage.forest.contact import ContactSettings, open_sky
from usdfoliage.forest.raster import Raster
from usdfoliage.forest.sky import LUMINANCE, SUN_WIDTH_DEG, SkySettings, make_sky
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.preview.recorder import find_interpreter

pytestmark = pytest.mark.preview

SIDE_M = 40.0
PIXEL_M = 0.5  # of the orthophoto
PLANT_M = np.array([12.0, 9.0])  # from the south-west corner
CONTACT = ContactSettings(opacity=0.8, base_share=0.25, reach=3.0)
GROUND = GroundMaterial(texture="./photo.png", contact_map="./contact.png", shader=f"./{GROUND_SHADER}")
FAR, MIDDLE, NEAR = 40, 160, 640  # pixels of the picture across the ground
QUIET = {"colorNoise": 0.0, "normalNoise": 0.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A level ground in a grey and a red half, and one plant of 2 m, 8 m high."""
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    folder = tmp_path_factory.mktemp("ground")
    photo = np.full((80, 80, 3), 120, np.uint8)
    photo[:, 40:] = (60, 60, 160)  # blue, green, red
    cv2.imwrite(str(folder / "photo.png"), photo)
    onto = Raster(values=np.zeros((200, 200)), ground_from_pixel=np.array([[0.2, 0, 0], [0, -0.2, SIDE_M]]))
    sky = open_sky(onto, PLANT_M[None], np.array([2.0]), np.array([8.0]), CONTACT)
    cv2.imwrite(str(folder / "contact.png"), np.rint(sky * 255).astype(np.uint8))
    copy_shaders(folder, [GROUND_SHADER])
    half = SIDE_M / 2
    corners = np.array([[-half, 0, half], [half, 0, half], [half, 0, -half], [-half, 0, -half]])
    st = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    terrain = TerrainPrim(points_m=corners, faces=np.array([[0, 1, 2, 3]], np.int32), st=st)
    write_terrain_layer(folder / "terrain.usda", "valley", terrain)
    return folder


def draw(
    folder: Path,
    ground: GroundMaterial,
    pixels: int,
    *,
    scale: float = 1.0,
    turn_deg: float = 0.0,
    lights: str = "",
    **inputs: float,
) -> np.ndarray:
    """(pixels, pixels, 3) the ground from above, linear, north on top.

    Args:
        folder: Of the files.
        ground: The material.
        pixels: A side of the picture.
        scale: By which ground and picture are larger.
        turn_deg: By which the east side is lowered.
        lights: Those of sky.usda, both or one; empty for the preview's.
        inputs: Of Storm's material.
    """
    name = f"shot_{len(list(folder.glob('shot_*')))}"
    layer = folder / f"{name}_materials.usda"
    write_materials_layer(
        layer, "valley", [lambda stage, root: author_ground_material(stage, root.AppendPath(GROUND_MATERIAL), ground)]
    )
    shot = Usd.Stage.CreateNew(str(folder / f"{name}.usda"))
    UsdGeom.SetStageUpAxis(shot, UsdGeom.Tokens.y)
    root = UsdGeom.Xform.Define(shot, "/valley")
    for each in (layer.name, "terrain.usda"):
        root.GetPrim().GetReferences().AddReference(f"./{each}")
    root.AddRotateZOp().Set(-turn_deg)
    root.AddScaleOp().Set((scale, scale, scale))
    surface = shot.GetPrimAtPath(f"/valley/{GROUND_MATERIAL}/StormSurface")
    for key, value in inputs.items():
        surface.CreateAttribute(f"inputs:{key}", Sdf.ValueTypeNames.Float).Set(value)
    if lights:
        shot.DefinePrim("/light").GetReferences().AddReference("./sky.usda")
        for other in {"Dome", "Sun"} - ({lights} if lights != "both" else {"Dome", "Sun"}):
            shot.OverridePrim(f"/light/sky/{other}").SetActive(False)
    shot.Save()
    half = scale * SIDE_M / 2
    view = PreviewView(output=Path("unused.png"), direction="top", orthographic=True, window=(-half, half, -half, half))
    settings = PreviewSettings(width_px=pixels, height_px=pixels)
    picture = draw_views(Path(shot.GetRootLayer().realPath), [view], settings)[0]
    assert picture[pixels // 4 : -pixels // 4, pixels // 4 : -pixels // 4, 3].min() == 1
    return picture[..., :3]


def middles_m(pixels: int) -> tuple[np.ndarray, np.ndarray]:
    """East and north of the middles of a picture's pixels."""
    row, column = (np.mgrid[:pixels, :pixels] + 0.5) * SIDE_M / pixels
    return column, SIDE_M - row


def inner(pixels: int) -> np.ndarray:
    """Pixels that are neither at the border nor where the two colours meet: there Storm's own filters differ."""
    east, north = middles_m(pixels)
    at_border = (np.abs(np.stack([east, north]) - SIDE_M / 2) > SIDE_M / 2 - 1).any(axis=0)
    return (np.abs(east - SIDE_M / 2) > 2) & ~at_border


def test_ground_below_a_plant_is_darker_and_no_other(folder):
    plain = draw(folder, replace(GROUND, shader=""), MIDDLE)
    ratio = (draw(folder, GROUND, MIDDLE, **QUIET) / plain).mean(axis=-1)
    east, north = middles_m(MIDDLE)
    away_m = np.hypot(east - PLANT_M[0], north - PLANT_M[1])
    np.testing.assert_allclose(ratio[(away_m > 7) & inner(MIDDLE)], 1, atol=0.01)
    assert ratio.min() == pytest.approx(1 - 0.8 * 0.5, abs=0.02)
    assert away_m.reshape(-1)[np.argmin(ratio)] < 0.5
    at_edge = 0.8 * 0.5 * (1 - 1 / np.sqrt(5)) * (1 - 1 / 9) ** 2
    assert ratio[np.abs(away_m - 2) < 0.2].mean() == pytest.approx(1 - at_edge, abs=0.02)
    without = draw(folder, GROUND, MIDDLE, contact=0.0, **QUIET)
    np.testing.assert_allclose(without[inner(MIDDLE)], plain[inner(MIDDLE)], atol=1 / 255)


@pytest.fixture(scope="module")
def near(folder):
    """With noise and without."""
    return draw(folder, GROUND, NEAR, contact=0.0), draw(folder, GROUND, NEAR, contact=0.0, **QUIET)


def differences(drawn: np.ndarray, plain: np.ndarray) -> np.ndarray:
    """By which part the inner pixels of a picture are brighter than those of another."""
    return (drawn / plain).mean(axis=-1)[inner(len(plain))] - 1


def test_from_afar_it_is_the_orthophoto(folder):
    plain = draw(folder, replace(GROUND, shader=""), FAR)
    drawn = draw(folder, GROUND, FAR, contact=0.0)
    np.testing.assert_allclose(drawn[inner(FAR)], plain[inner(FAR)], atol=1 / 255)
    quiet = draw(folder, GROUND, FAR, contact=0.0, **QUIET)
    np.testing.assert_array_equal(drawn[inner(FAR)], quiet[inner(FAR)])


def test_near_by_it_has_noise_that_keeps_the_mean_colour(near):
    drawn, quiet = near
    assert 0.1 < differences(drawn, quiet).std() < 0.5
    east, _ = middles_m(NEAR)
    for half in (east < SIDE_M / 2, east > SIDE_M / 2):
        own = half & inner(NEAR)
        np.testing.assert_allclose(drawn[own].mean(axis=0), quiet[own].mean(axis=0), atol=1 / 255)


@pytest.mark.parametrize("kind", ["colorNoise", "normalNoise"])
def test_colour_and_normal_have_noise_each(folder, near, kind):
    drawn = draw(folder, GROUND, NEAR, contact=0.0, **{key: value for key, value in QUIET.items() if key != kind})
    differs = differences(drawn, near[1])
    assert differs.std() > 0.03
    assert abs(differs.mean()) < 0.02


def test_octaves_come_one_after_the_other_as_the_camera_comes_nearer(folder, near):
    spreads = []
    for pixels in (80, MIDDLE, 320):
        pair = [draw(folder, GROUND, pixels, contact=0.0, **quiet) for quiet in ({}, QUIET)]
        spreads.append(differences(*pair).std())
    spreads.append(differences(*near).std())
    assert spreads[0] == 0  # two pixels of the picture in the widest wave
    assert (np.diff(spreads) > 0.02).all()


def test_no_wave_is_as_narrow_as_two_pixels_so_that_nothing_shimmers(near):
    side = NEAR // 2 - 60
    patch = (near[0] / near[1])[40 : 40 + side, 20 : 20 + side, 0] * np.outer(np.hanning(side), np.hanning(side))
    power = np.abs(np.fft.fft2(patch - patch.mean())) ** 2
    waves = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side)))  # a pixel
    assert power[waves > 0.4].sum() < 0.03 * power[waves > 0.02].sum()  # 1/2 in a picture of random pixels


def test_noise_lies_on_the_ground_however_large_that_is_made(folder, near):
    large = draw(folder, GROUND, NEAR, scale=100.0, contact=0.0)
    # The lights and the orthophoto's place are computed in other numbers.
    assert np.corrcoef(differences(large, near[1]), differences(*near))[0, 1] > 0.98


def test_without_an_orthophoto_it_has_one_colour_with_noise(folder):
    ground = replace(GROUND, texture="", contact_map="", color=(0.2, 0.3, 0.1))
    drawn, plain = draw(folder, ground, NEAR), draw(folder, replace(ground, shader=""), NEAR)
    assert differences(drawn, plain).std() > 0.1
    np.testing.assert_allclose(drawn[inner(NEAR)].mean(axis=0), plain[inner(NEAR)].mean(axis=0), atol=1 / 255)


@pytest.mark.parametrize("shader", ["", GROUND.shader])
def test_a_sky_lights_level_ground_as_white_and_a_slope_towards_the_sun_more(folder, shader):
    white = replace(GROUND, texture="", contact_map="", shader=shader, color=(1.0, 1.0, 1.0))
    sky = make_sky(SkySettings(azimuth_deg=90.0, elevation_deg=40.0))
    write_sky_picture(folder / "sky.exr", sky.radiance)
    prim = SkyPrim(
        picture="./sky.exr", to_sun=sky.to_sun, sun_irradiance=sky.sun_irradiance, sun_width_deg=SUN_WIDTH_DEG
    )
    write_sky_layer(folder / "sky.usda", "valley", prim)
    means = {}
    for light in ("both", "Dome", "Sun"):
        for turn_deg in (-30.0, 0.0, 30.0):  # the east side up, level, down
            drawn = draw(folder, white, FAR, lights=light, turn_deg=turn_deg, **(QUIET if shader else {}))
            means[light, turn_deg] = float((drawn[15:25, 15:25] @ LUMINANCE).mean())
    assert means["both", 0] == pytest.approx(1, abs=0.03)
    for light in ("Dome", "Sun"):
        assert means[light, 30.0] > 1.05 * means[light, 0.0] > 1.05 * means[light, -30.0]
