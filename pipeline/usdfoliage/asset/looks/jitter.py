"""The jitter's map in a look: leaves name it, and for Storm their material reads it."""

from pxr import Sdf, Usd, UsdGeom, UsdShade

from usdfoliage.asset.materials.leaf import author_jitter_texture
from usdfoliage.asset.parts.leaf_primvars import author_jitter_map


def author_look_jitter_map(stage: Usd.Stage, path: Sdf.Path, plant: Usd.Prim, instancer: Usd.Prim, file: str) -> None:
    """Author a look's opinions of the jitter map.

    Args:
        stage: Of the look.
        path: What stands in the look for the plant.
        plant: Of the asset, composed.
        instancer: Its leaves.
        file: The map, as seen from the look's folder.
    """
    author_jitter_map(stage.OverridePrim(instancer.GetPath().ReplacePrefix(plant.GetPath(), path)), file)
    for material in _leaf_materials(instancer):
        over = stage.OverridePrim(material.ReplacePrefix(plant.GetPath(), path))
        author_jitter_texture(UsdShade.Material(over), file)
    _undefine(stage.GetRootLayer())


def _leaf_materials(instancer: Usd.Prim) -> list[Sdf.Path]:
    """The materials of the prototypes."""
    found = []
    for target in UsdGeom.PointInstancer(instancer).GetPrototypesRel().GetForwardedTargets():
        prototype = instancer.GetStage().GetPrimAtPath(target)
        for gprim in Usd.PrimRange(prototype) if prototype else ():
            material, _ = UsdShade.MaterialBindingAPI(gprim).ComputeBoundMaterial()
            if material and material.GetPath() not in found:
                found.append(material.GetPath())
    return found


def _undefine(layer: Sdf.Layer) -> None:
    """Make overs again of what USD defined above the prims that the look adds: an unloaded asset must show nothing."""

    def visit(path: Sdf.Path) -> None:
        spec = layer.GetPrimAtPath(path) if path.IsPrimPath() else None
        if spec and spec.specifier == Sdf.SpecifierDef and not spec.typeName:
            spec.specifier = Sdf.SpecifierOver

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
