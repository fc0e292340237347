"""What Storm draws of a crown whose colours are its directions: the maps are where they belong, by every shader."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.packages.leaf_package import AssetSettings, write_crown_asset
from usdfoliage.asset.provenance import Provenance
from usdfoliage.crown.model import CrownModel
from usdfoliage.errors import PreviewError
from usdfoliage.geometry.cubemap import face_directions
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.preview.recorder import find_interpreter

pytestmark = pytest.mark.preview

SPACING_M = 3.0
VARIED = (1.5, 0.5, 1.0)  # factors on the colour of one instance
CROWNS = ("glslfx", "preview", "bare", "instance", "varied", "mtlx")


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    """Six crowns of 1 m from left to right, seen from the front: (64, 6 · 64, 4), linear, row 0 on top."""
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    folder = tmp_path_factory.mktemp("storm") / "crown"
    folder.mkdir()
    crown = CrownModel(
        radius_m=np.ones((6, 32, 32), np.float32),
        color=(0.5 + 0.4 * face_directions(32)).astype(np.float32),
        center_m=np.array([0.0, 2.0, 0.0]),
        relief_weight=0.0,
        asset_from_photo=np.eye(4),
    )
    provenance = Provenance(capture="crown.png", generator="test", seed=0, input_sha256="")
    write_crown_asset(folder, "crown", crown, provenance, AssetSettings(crown_mesh_size=17))

    shot = Usd.Stage.CreateNew(str(folder.parent / "shot.usda"))
    UsdGeom.SetStageUpAxis(shot, UsdGeom.Tokens.y)
    for column, name in enumerate(CROWNS):
        tree = UsdGeom.Xform.Define(shot, f"/{name}")
        tree.GetPrim().GetReferences().AddReference("./crown/crown.usda")
        tree.AddTranslateOp().Set((SPACING_M * column, -2.0, 0.0))
    material = UsdShade.Material(shot.GetPrimAtPath("/preview/mtl/Crown"))
    for context in ("glslfx", "mtlx"):
        material.GetSurfaceOutput(context).GetAttr().SetConnections([])
    material = UsdShade.Material(shot.GetPrimAtPath("/mtlx/mtl/Crown"))
    for context in ("glslfx", ""):
        material.GetSurfaceOutput(context).GetAttr().SetConnections([])
    UsdGeom.PrimvarsAPI(shot.GetPrimAtPath("/bare/geo/proxy/Crown")).BlockPrimvar("st")
    shot.GetPrimAtPath("/instance").SetInstanceable(True)
    varied = shot.GetPrimAtPath("/varied")
    varied.SetInstanceable(True)
    variation = UsdGeom.PrimvarsAPI(varied).CreatePrimvar(
        "foliage:variation", Sdf.ValueTypeNames.Color3f, UsdGeom.Tokens.constant
    )
    variation.Set(Gf.Vec3f(*VARIED))
    shot.Save()

    half = SPACING_M / 2
    view = PreviewView(
        output=Path("unused.png"),
        orthographic=True,
        window=(-half, (len(CROWNS) - 0.5) * SPACING_M, -half, half),
    )
    settings = PreviewSettings(width_px=64 * len(CROWNS), height_px=64)
    return draw_views(Path(shot.GetRootLayer().realPath), [view], settings)[0]


def color_at(picture, name, x_m, y_m):
    """The drawn colour's shares of red, green and blue where a crown's front shows (x, y)."""
    column = round((CROWNS.index(name) + 0.5 + x_m / SPACING_M) * 64)
    row = round((0.5 - y_m / SPACING_M) * 64)
    patch = picture[row - 1 : row + 1, column - 1 : column + 1]
    assert patch[..., 3].min() == 1.0
    rgb = patch[..., :3].mean(axis=(0, 1))
    return rgb / rgb.sum()


@pytest.mark.parametrize("name", CROWNS)
@pytest.mark.parametrize(("x_m", "y_m"), [(0, 0), (0.7, 0), (-0.7, 0), (0, 0.7), (0, -0.7), (0.5, 0.5), (-0.5, 0.5)])
def test_colour_is_that_of_the_direction(picture, name, x_m, y_m):
    direction = np.array([x_m, y_m, np.sqrt(1 - x_m**2 - y_m**2)])
    wanted = (0.5 + 0.4 * direction) * (VARIED if name == "varied" else 1)
    # The highlights of UsdPreviewSurface and OpenPBR add white.
    tolerance = 0.06 if name in ("preview", "mtlx") else 0.02
    np.testing.assert_allclose(color_at(picture, name, x_m, y_m), wanted / wanted.sum(), atol=tolerance)


def test_crown_is_lit_softly_and_darker_below(picture):
    lit = picture[:, :64, :3].sum(axis=-1)
    assert lit[16, 32] > 1.2 * lit[48, 32]
    assert lit[48, 32] > 0.15 * lit.max()


def test_silhouette_is_the_sphere(picture):
    area_m2 = (picture[:, :64, 3]).sum() * (SPACING_M / 64) ** 2
    assert area_m2 == pytest.approx(np.pi, rel=0.03)


@pytest.mark.parametrize("name", ["preview", "mtlx"])
def test_every_pixel_has_its_own_colour_on_small_faces(picture, name):
    """A pixel that reads a coarse level of the picture has the mean colour, and would stand out as a dot."""
    rows, columns = np.mgrid[:64, :64]
    x_m, y_m = (columns + 0.5) / 64 * SPACING_M - SPACING_M / 2, SPACING_M / 2 - (rows + 0.5) / 64 * SPACING_M
    inside = np.hypot(x_m, y_m) < 0.6  # beyond, a coarser level mixes the colours of two faces of the cubemap
    x_m, y_m = x_m[inside], y_m[inside]
    wanted = 0.5 + 0.4 * np.stack([x_m, y_m, np.sqrt(1 - x_m**2 - y_m**2)], axis=-1)
    column = CROWNS.index(name) * 64
    rgb = picture[:, column : column + 64, :3][inside]
    differences = np.abs(rgb / rgb.sum(-1, keepdims=True) - wanted / wanted.sum(-1, keepdims=True))
    assert differences.max() < 0.02
