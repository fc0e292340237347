"""What Storm draws of grass: the colour of the ground it stands on, in its light, and darker under plants."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux
from usdfoliage.asset.materials.grass import GRASS_SHADER, GrassMaterial, author_grass_material
from usdfoliage.asset.materials.ground import GROUND_SHADER, GroundMaterial, author_ground_material
from usdfoliage.asset.materials.layer import GRASS_MATERIAL, GROUND_MATERIAL, copy_shaders, write_materials_layer
from usdfoliage.asset.parts.grass import GrassPrim, write_grass_layer
from usdfoliage.asset.parts.terrain import TerrainPrim, write_terrain_layer
from usdfoliage.errors import PreviewError
from usdfoliage.forest.grass import even_places
from usdfoliage.forest.grass_clump import build_clump
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.preview.recorder import find_interpreter

pytestmark = pytest.mark.preview

SIDE_M = 4.0
COLOR = np.array([0.1, 0.16, 0.05])  # of the ground, linear
PIXELS = 256


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Ground that is wholly vegetated, with grass on its east half; the north of that is under plants."""
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    folder = tmp_path_factory.mktemp("grass")
    cv2.imwrite(str(folder / "grass.png"), np.full((8, 8), 255, np.uint8))
    copy_shaders(folder, [GROUND_SHADER, GRASS_SHADER])
    half = SIDE_M / 2
    corners = np.array([[-half, 0, half], [half, 0, half], [half, 0, -half], [-half, 0, -half]])
    st = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    write_terrain_layer(
        folder / "terrain.usda",
        "valley",
        TerrainPrim(points_m=corners, faces=np.array([[0, 1, 2, 3]], np.int32), st=st),
    )
    rng = np.random.default_rng(0)
    place = even_places(1600, half, rng)
    place = np.concatenate([place - [0, half], place])  # x from 0, z from -half to half
    count = len(place)
    turn = rng.uniform(0, np.pi, count)
    grass = GrassPrim(
        forms=[build_clump(np.random.default_rng(each)) for each in range(3)],
        form=np.arange(count, dtype=np.int32) % 3,
        position_m=np.column_stack([place[:, 0], np.zeros(count), place[:, 1]]),
        orientation=np.column_stack([np.cos(turn), np.zeros(count), np.sin(turn), np.zeros(count)]),
        scale=np.tile([1.0, 0.1, 1.0], (count, 1)),
        tint=np.tile(COLOR, (count, 1)),
        open_sky=np.where(place[:, 1] < 0, 0.4, 1.0),
    )
    write_grass_layer(folder / "grass.usdc", "valley", grass)
    return folder


def draw(folder: Path, *, storm: bool = True, grass: bool = True, **inputs: float) -> np.ndarray:
    """(PIXELS, PIXELS, 3) from above, linear, north on top; inputs are those of both materials of Storm."""
    name = f"shot_{len(list(folder.glob('shot_*')))}"
    ground = GroundMaterial(
        grass_map="./grass.png", color=tuple(COLOR), shader=f"./{GROUND_SHADER}" if storm else "", photo_pixel_m=2.0
    )
    blades = GrassMaterial(shader=f"./{GRASS_SHADER}" if storm else "")

    def author(stage: Usd.Stage, root: Sdf.Path) -> None:
        author_ground_material(stage, root.AppendPath(GROUND_MATERIAL), ground)
        author_grass_material(stage, root.AppendPath(GRASS_MATERIAL), blades)

    layer = folder / f"{name}_materials.usda"
    write_materials_layer(layer, "valley", [author])
    shot = Usd.Stage.CreateNew(str(folder / f"{name}.usda"))
    UsdGeom.SetStageUpAxis(shot, UsdGeom.Tokens.y)
    root = UsdGeom.Xform.Define(shot, "/valley")
    for each in (layer.name, "terrain.usda", *(["grass.usdc"] if grass else [])):
        root.GetPrim().GetReferences().AddReference(f"./{each}")
    for material in (GROUND_MATERIAL, GRASS_MATERIAL) if storm else ():
        surface = shot.GetPrimAtPath(f"/valley/{material}/StormSurface")
        for key, value in inputs.items():
            surface.CreateAttribute(f"inputs:{key}", Sdf.ValueTypeNames.Float).Set(value)
    sun = UsdLux.DistantLight.Define(shot, "/sun")
    sun.CreateIntensityAttr(3.0)
    sun.AddRotateXYZOp().Set(Gf.Vec3f(-50, 30, 0))
    shot.Save()
    half = SIDE_M / 2
    view = PreviewView(output=Path("unused.png"), direction="top", orthographic=True, window=(-half, half, -half, half))
    settings = PreviewSettings(width_px=PIXELS, height_px=PIXELS)
    picture = draw_views(Path(shot.GetRootLayer().realPath), [view], settings)[0]
    assert np.isfinite(picture).all()
    return picture[..., :3]


def part(picture: np.ndarray, east: bool, north: bool) -> np.ndarray:
    """(N, 3) pixels of a quarter of the ground, without its border."""
    half, edge = PIXELS // 2, PIXELS // 16
    columns = slice(half + edge, -edge) if east else slice(edge, half - edge)
    rows = slice(edge, half - edge) if north else slice(half + edge, -edge)
    return picture[rows, columns].reshape(-1, 3)


QUIET = {"hue": 0.0, "colorNoise": 0.0, "normalNoise": 0.0}


def test_blades_have_the_colour_and_the_light_of_their_ground(folder):
    picture = draw(folder, **QUIET)
    ground, blades = (part(picture, east, north=False) for east in (False, True))
    assert ground.std(axis=0).max() < 1e-3
    np.testing.assert_allclose(blades.mean(axis=0) / ground.mean(axis=0), 1, atol=0.25)
    hue = blades.mean(axis=0) / blades.mean()
    np.testing.assert_allclose(hue, ground.mean(axis=0) / ground.mean(), rtol=0.05)
    assert blades.std(axis=0).min() > 0.15 * blades.mean(axis=0).min()  # single blades are seen


def test_blades_under_plants_are_darker(folder):
    dark, none = (draw(folder, contact=each, **QUIET) for each in (1.0, 0.0))
    ratio = part(dark, east=True, north=True) / part(none, east=True, north=True)
    # Pixels that blades fill; what is seen of the ground between is as it was, for it has no picture of the sky here.
    np.testing.assert_allclose([np.percentile(ratio, 5), ratio.max()], [0.4, 1.0], atol=0.02)
    assert ratio.mean() < 0.65
    np.testing.assert_allclose(part(dark, True, False), part(none, True, False), atol=1e-3)


def test_blades_and_ground_have_one_hue_whose_mean_is_kept(folder):
    bare = draw(folder, grass=False, colorNoise=0.0, normalNoise=0.0) / draw(folder, grass=False, **QUIET)
    assert 0.05 < bare.std() < 0.3
    np.testing.assert_allclose(bare.mean(axis=(0, 1)), 1, atol=0.08)
    grown = draw(folder, contact=0.0, colorNoise=0.0, normalNoise=0.0) / draw(folder, contact=0.0, **QUIET)

    def blurred(picture: np.ndarray) -> np.ndarray:
        east = picture[16:-16, PIXELS // 2 + 16 : -16].astype(np.float32)
        return cv2.GaussianBlur(east, (0, 0), 6)

    same = np.corrcoef(blurred(bare).reshape(-1), blurred(grown).reshape(-1))[0, 1]
    assert same > 0.9


def test_other_descriptions_draw_the_colour_of_the_instances(folder):
    picture = draw(folder, storm=False)
    blades = part(picture, east=True, north=False).mean(axis=0)
    np.testing.assert_allclose(blades / blades.sum(), COLOR / COLOR.sum(), rtol=0.1)
