"""The mesh by UsdPreviewSurface alone, as an application without our shader draws it: recognisably the same leaves."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views, finish_picture
from usdfoliage.jobs.preview.recorder import find_interpreter
from usdfoliage.leaf.shape.spray import SpraySettings, scatter_spray

from tests.support.leaves.assets import write_spray

pytestmark = pytest.mark.preview


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """The same 40 leaves by our shader and by UsdPreviewSurface: (300, 300, 4) each, sRGB 0 to 255."""
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    folder = tmp_path_factory.mktemp("portable")
    leaves = scatter_spray(40, np.random.default_rng(2), SpraySettings(length_m=0.1))
    write_spray(folder / "spray", leaves)
    drawn = []
    for name, outputs in (("ours", ()), ("portable", ("glslfx", "mtlx"))):
        shot = Usd.Stage.CreateNew(str(folder / f"{name}.usda"))
        UsdGeom.SetStageUpAxis(shot, UsdGeom.Tokens.y)
        plant = UsdGeom.Xform.Define(shot, "/spray").GetPrim()
        plant.GetReferences().AddReference("./spray/spray.usda")
        plant.GetVariantSet("representation").SetVariantSelection("mesh")
        for context in outputs:
            material = UsdShade.Material(shot.GetPrimAtPath("/spray/mtl/Leaf"))
            material.GetSurfaceOutput(context).GetAttr().SetConnections([])
        shot.Save()
        view = PreviewView(output=Path("unused.png"))
        settings = PreviewSettings(width_px=300, height_px=300, background=None)
        (picture,) = draw_views(Path(shot.GetRootLayer().realPath), [view], settings)
        drawn.append(finish_picture(picture, None).astype(float))
    return drawn


def test_the_same_silhouette(pictures):
    ours, portable = (picture[..., 3] > 127 for picture in pictures)
    assert (ours & portable).sum() / (ours | portable).sum() > 0.999


def test_the_same_greens(pictures):
    on_both = (pictures[0][..., 3] > 250) & (pictures[1][..., 3] > 250)
    ours, portable = (picture[on_both][:, :3] for picture in pictures)
    assert (portable.mean(axis=0).argsort() == ours.mean(axis=0).argsort()).all()  # blue, red, green
    assert np.abs(portable.mean(axis=0) - ours.mean(axis=0)).max() < 25
    assert np.abs(portable - ours).mean() < 20
    # Nothing but the look of a leaf is lost: light and dark leaves are the same ones.
    assert np.corrcoef(portable[:, 1], ours[:, 1])[0, 1] > 0.7
