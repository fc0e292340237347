"""A look in a scene of somebody else's changes what Storm draws; muted, it gives the original back, to the pixel."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.looks.look import write_look_layer
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.preview.recorder import find_interpreter
from usdfoliage.leaf.shape.edits import LeafEdits

from tests.support.leaves.assets import random_leaves, two_leaves, write_spray

pytestmark = pytest.mark.preview

# No jitter and no height: what makes leaves wider must cover more pixels.
EDITS = LeafEdits(width=1.8)


def draw(scene, **settings):
    view = PreviewView(output=Path("unused.png"), orthographic=True, window=(-1.0, 4.0, -1.0, 2.0))
    (picture,) = draw_views(scene, [view], PreviewSettings(width_px=250, height_px=150, **settings))
    return picture


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A plain scene with the asset three times: as it is, as an instance, turned and scaled."""
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    folder = tmp_path_factory.mktemp("a shot")
    write_spray(folder / "spray", random_leaves(12))
    stage = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    for number in range(3):
        plant = UsdGeom.Xform.Define(stage, f"/World/garden/plant_{number}")
        plant.GetPrim().GetReferences().AddReference("./spray/spray.usda")
        plant.AddTranslateOp().Set((1.5 * number, 0.0, 0.0))
    plant.AddRotateZOp().Set(40.0)
    plant.AddScaleOp().Set((0.7, 0.7, 0.7))
    stage.GetPrimAtPath("/World/garden/plant_1").SetInstanceable(True)
    stage.Save()
    return Path(stage.GetRootLayer().realPath)


def test_a_sublayered_look_shows_and_goes_without_a_trace(scene):
    before = draw(scene)
    look = write_look_layer(scene.with_name("look.usda"), scene.parent / "spray", EDITS)
    stage = Usd.Stage.Open(str(scene))
    stage.GetRootLayer().subLayerPaths.append("./look.usda")
    stage.Save()

    wide, muted = draw(scene), draw(scene, muted=(look,))

    np.testing.assert_array_equal(muted, before)
    for number in range(3):  # in the picture's thirds
        third = slice(25 + 75 * number, 100 + 75 * number)
        assert (wide[:, third, 3] > 0.5).sum() > 1.15 * (before[:, third, 3] > 0.5).sum()
    fallback = draw(scene, variants=(("representation", "mesh"),))
    np.testing.assert_array_equal(fallback, draw(scene, variants=(("representation", "mesh"),), muted=(look,)))


@pytest.mark.parametrize("layers", [("wide", "bent"), ("bent", "wide"), ("hand",)])
def test_leaves_far_from_the_prototype_are_not_culled(scene, tmp_path, layers):
    """Storm culls by the prototype's extent, of which neither layer knows what the others do."""
    asset = write_spray(tmp_path / "spray", two_leaves().take([0]))
    write_look_layer(tmp_path / "wide.usda", asset, LeafEdits(width=3.0))
    write_look_layer(tmp_path / "bent.usda", asset, LeafEdits(axis1=(0.0, 0.0, 1.5), axis2=(0.0, 0.0, 1.5)))
    hand = Usd.Stage.CreateNew(str(tmp_path / "hand.usda"))
    leaves = hand.OverridePrim("/World/plant/geo/render/Leaves")
    leaves.CreateAttribute("primvars:leaf:edit:width", Sdf.ValueTypeNames.Float).Set(3.0)
    hand.Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.Xform.Define(stage, "/World/plant").GetPrim().GetReferences().AddReference("./spray/spray.usda")
    stage.GetRootLayer().subLayerPaths = [f"./{name}.usda" for name in layers]
    stage.Save()
    # The leaf reaches to x = 0.3 without edits and to 0.9 with them; the camera sees nothing else.
    beside = PreviewView(output=Path("unused.png"), orthographic=True, window=(0.7, 0.8, 0.45, 0.55))
    (picture,) = draw_views(tmp_path / "shot.usda", [beside], PreviewSettings(width_px=40, height_px=40))
    assert (picture[..., 3] > 0.5).all()


def test_an_unknown_variant_is_named_with_those_that_exist(scene):
    with pytest.raises(PreviewError, match="no variant representation=voxels; there are bezier, mesh, nurbs, subdiv"):
        draw(scene, variants=(("representation", "voxels"),))
    with pytest.raises(PreviewError, match="no variant season=autumn; no prim has such a variant set"):
        draw(scene, variants=(("season", "autumn"),))
