"""Looks made with plain USD: layers whose prims have edits of leaves, without the record and the extents of a look."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdGeom

from usdfoliage.asset.locate import check_layers, find_interface, open_layer, select_leafy_lod, select_representation
from usdfoliage.asset.look_layer import BEZIER, CUSTOM_DATA_KEY, EDITS, LOOK_OF, REPRESENTATION, EditValue
from usdfoliage.asset.looks.look import open_root_layer, read_look
from usdfoliage.asset.schema import PLANT_API, require_schemas
from usdfoliage.errors import AssetError

_NAMES = {f"primvars:{primvar}": name for name, primvar in EDITS.items()}


@dataclass(frozen=True, kw_only=True)
class PlainLook:
    """What a layer that is no recorded look does to leaves."""

    path: Path
    prims: Mapping[str, Mapping[str, EditValue | None]]  # edits of each prim, by names of LeafEdits; None: no number
    has_extents: bool  # whether it authors any extent


def read_plain_look(file: Path) -> PlainLook | None:
    """The edits in a layer that is neither a look of ours nor has a plant; None for any other file or folder.

    Raises:
        AssetError: There is nothing of that name, or it is no USD.
    """
    require_schemas()
    layer = open_layer(find_interface(file))
    record = layer.customLayerData.get(CUSTOM_DATA_KEY)
    if isinstance(record, dict) and LOOK_OF in record:
        return None
    prims: dict[str, dict[str, EditValue | None]] = {}
    extents: list[Sdf.Path] = []
    plants: list[str] = []

    def look(path: Sdf.Path) -> None:
        if path.IsPrimPropertyPath():
            if path.name in _NAMES:
                at = str(path.GetPrimPath().StripAllVariantSelections())
                prims.setdefault(at, {})[_NAMES[path.name]] = _numbers(layer.GetAttributeAtPath(path).default)
            elif path.name in ("extent", "extentsHint"):
                extents.append(path)
        elif path.IsPrimPath():
            schemas = layer.GetPrimAtPath(path).GetInfo("apiSchemas")
            plants.extend(name for name in schemas.GetAddedOrExplicitItems() if name == PLANT_API)

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    brings = layer.subLayerPaths or any(prim.hasReferences or prim.hasPayloads for prim in layer.rootPrims)
    if plants or brings or not prims:
        return None
    return PlainLook(path=Path(layer.realPath), prims=prims, has_extents=bool(extents))


def _numbers(value: object) -> EditValue | None:
    """An edit as numbers; None for a value that is none, or not finite."""
    if isinstance(value, (Gf.Vec3f, Gf.Vec3d, Gf.Vec3h)):
        x, y, z = map(float, value)
        return (x, y, z) if all(map(math.isfinite, (x, y, z))) else None
    return value if isinstance(value, float) and math.isfinite(value) else None


def open_under_layer(asset: Path, file: Path, prim_path: str | None) -> Usd.Stage:
    """An asset, or a look over its asset, as the opinions of one more layer make it, ready for its edits to be read.

    Args:
        asset: The asset's folder or interface layer, or a look.
        file: Any layer with opinions of the class of the asset, of its prims, or of the placement.
        prim_path: Where the layer has the placement; without, where the asset has it.

    Raises:
        AssetError: One of them cannot be read.
    """
    require_schemas()
    path, over = find_interface(asset), open_layer(find_interface(file))
    named = open_layer(path)
    look = read_look(named)
    interface = look.asset if look else Path(named.realPath)
    root = Sdf.Layer.CreateAnonymous(f"{path.stem}.usda")
    root.subLayerPaths.append(over.identifier)
    if look is not None:
        root.subLayerPaths.append(named.identifier)
    below = open_root_layer(interface)
    check_layers(below, interface)
    stage = Usd.Stage.Open(root, Usd.Stage.LoadAll)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    at = prim_path or (look.prim_path if look else "") or f"/{below.defaultPrim}"
    if not Sdf.Path.IsValidPathString(at)[0] or not Sdf.Path(at).IsAbsoluteRootOrPrimPath():
        raise AssetError(f"{at!r} is no path of a prim", "give the prim that refers to the asset, like /World/plant_1")
    plant = stage.DefinePrim(at)
    plant.GetReferences().AddReference(str(interface))
    stage.SetDefaultPrim(stage.GetPrimAtPath(plant.GetPath().GetPrefixes()[0]))
    select_leafy_lod(stage)
    if REPRESENTATION in plant.GetVariantSets().GetNames():
        select_representation(stage, BEZIER)
    return stage
