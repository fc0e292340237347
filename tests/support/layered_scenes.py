"""A plain scene that refers to a whole plant twice, with different variants and overrides."""

from pathlib import Path

from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.looks.look import write_look_layer
from usdfoliage.leaf.shape.edits import LeafEdits

from tests.support.plant_assets import write_whole_plant

ONE, TWO = "/set/one", "/set/two"
WIDTH = 3.0
MOVED = (20.0, 0.0, 0.0)
RED = (0.9, 0.0, 0.0)


def new_scene(path: Path) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, "/set").GetPrim()
    Usd.ModelAPI(root).SetKind(Kind.Tokens.assembly)
    stage.SetDefaultPrim(root)
    return stage


def place(stage: Usd.Stage, path: str, asset: Path, **variants: str) -> Usd.Prim:
    """A reference to the asset, which lies beside the scene's folder or below."""
    prim = UsdGeom.Xform.Define(stage, path).GetPrim()
    folder = Path(stage.GetRootLayer().realPath).parent
    prim.GetReferences().AddReference(f"./{asset.relative_to(folder).as_posix()}")
    for name, variant in variants.items():
        prim.GetVariantSet(name).SetVariantSelection(variant)
    return prim


def write_layered_scene(folder: Path, second: str = "both", count: int = 12) -> Path:
    """The plant twice, everything in folder.

    One is leaves of the representation bezier with a look on it; the other, in the lod `second`, is a mesh, red in its
    leaves, and moved.
    """
    asset = write_whole_plant(folder / "oak", count=count)
    stage = new_scene(folder / "scene.usda")
    place(stage, ONE, asset, lod="leaves", representation="bezier")
    two = place(stage, TWO, asset, lod=second, representation="mesh", branches="order1")
    UsdGeom.XformCommonAPI(two).SetTranslate(MOVED)
    material = UsdShade.Material.Define(stage, "/set/mtl/Autumn")
    surface = UsdShade.Shader.Define(stage, "/set/mtl/Autumn/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*RED))
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    if second != "crown":
        # By the plant's own collection: what is in it needs not be known.
        binding = UsdShade.MaterialBindingAPI.Apply(two)
        leaves = Usd.CollectionAPI(two, "leaves")
        binding.Bind(leaves, material, "autumn", UsdShade.Tokens.strongerThanDescendants)
    stage.Save()
    write_look_layer(folder / "look.usda", asset, LeafEdits(width=WIDTH), prim_path=ONE)
    stage.GetRootLayer().subLayerPaths.append("./look.usda")
    stage.Save()
    return folder / "scene.usda"
