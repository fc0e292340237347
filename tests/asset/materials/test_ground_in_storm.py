"""What Storm draws of the ground: the orthophoto from afar, darker under plants."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.materials.ground import GROUND_SHADER, GroundMaterial, author_ground_material
from usdfoliage.asset.materials.layer import GROUND_MATERIAL, copy_shaders, write_materials_layer
from usdfoliage.asset.parts.terrain import TerrainPrim, write_terrain_layer
from usdfoliage.errors import PreviewError
from usdfoliage.forest.contact import ContactSettings, open_sky
from usdfoliage.forest.raster import Raster
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.preview.recorder import find_interpreter

pytestmark = pytest.mark.preview

SIDE_M = 40.0
PLANT_M = np.array([12.0, 9.0])  # from the south-west corner
CONTACT = ContactSettings(opacity=0.8, base_share=0.25, reach=3.0)
GROUND = GroundMaterial(texture="./photo.png", contact_map="./contact.png", shader=f"./{GROUND_SHADER}")
FINE = 160  # pixels of the picture across the ground


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


def draw(folder: Path, ground: GroundMaterial, pixels: int, scale: float = 1.0, **inputs: float) -> np.ndarray:
    """(pixels, pixels, 3) the ground from above, linear, north on top, all made larger by scale."""
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
    root.AddScaleOp().Set((scale, scale, scale))
    surface = shot.GetPrimAtPath(f"/valley/{GROUND_MATERIAL}/StormSurface")
    for key, value in inputs.items():
        surface.CreateAttribute(f"inputs:{key}", Sdf.ValueTypeNames.Float).Set(value)
    shot.Save()
    half = scale * SIDE_M / 2
    view = PreviewView(output=Path("unused.png"), direction="top", orthographic=True, window=(-half, half, -half, half))
    settings = PreviewSettings(width_px=pixels, height_px=pixels)
    picture = draw_views(Path(shot.GetRootLayer().realPath), [view], settings)[0]
    assert picture[..., 3].min() == 1
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
    plain = draw(folder, replace(GROUND, shader=""), FINE)
    ratio = (draw(folder, GROUND, FINE) / plain).mean(axis=-1)
    east, north = middles_m(FINE)
    away_m = np.hypot(east - PLANT_M[0], north - PLANT_M[1])
    np.testing.assert_allclose(ratio[(away_m > 7) & inner(FINE)], 1, atol=0.01)
    assert ratio.min() == pytest.approx(1 - 0.8 * 0.5, abs=0.02)
    assert away_m.reshape(-1)[np.argmin(ratio)] < 0.5
    at_edge = 0.8 * 0.5 * (1 - 1 / np.sqrt(5)) * (1 - 1 / 9) ** 2
    assert ratio[np.abs(away_m - 2) < 0.2].mean() == pytest.approx(1 - at_edge, abs=0.02)
    without = draw(folder, GROUND, FINE, contact=0.0)
    np.testing.assert_allclose(without[inner(FINE)], plain[inner(FINE)], atol=1 / 255)
