"""Looks of a lobed leaf: the functions of its branches, and the points that follow from them, over its asset."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.locate import find_interface, open_layer
from usdfoliage.asset.look_layer import build_look
from usdfoliage.asset.looks.look import (
    check_look_output,
    look_class,
    look_relative,
    open_asset,
    read_look,
    the_plant,
)
from usdfoliage.asset.parts.lobed_leaf import author_functions
from usdfoliage.asset.parts.lobed_numbers import read_lobed_leaf
from usdfoliage.asset.parts.terrain import vertex_normals
from usdfoliage.asset.plant import TO_LEAVES
from usdfoliage.asset.publish_file import publish_text
from usdfoliage.asset.schema import LOBED_LEAF_API
from usdfoliage.errors import AssetError
from usdfoliage.leaf.lobed.deformation import BranchFunctions
from usdfoliage.leaf.lobed.placed import LobedLeaf


@dataclass(frozen=True, kw_only=True, eq=False)
class LobedAsset:
    """The lobed leaf of an asset, or as a look has it."""

    interface: Path  # of the asset itself
    leaf: LobedLeaf
    prim_path: str  # the one placement that the look is for, empty for all


def find_lobed_leaf(asset: Path) -> LobedAsset | None:
    """The leaf of an asset, or of a look of one; None where it is no lobed leaf.

    Raises:
        AssetError: The asset cannot be read, or the numbers of its leaf do not fit together.
    """
    named = open_layer(find_interface(asset))
    look = read_look(named)
    stage = open_asset(asset)  # its prims live as long as it does
    mesh = _mesh_of(stage)
    if mesh is None:
        return None
    plant, prim = mesh
    matrix = plant.GetAttribute("foliage:captureToAsset").Get()
    leaf = read_lobed_leaf(prim, np.eye(4) if matrix is None else np.array(matrix).T)
    interface = look.asset if look else Path(named.realPath)
    return LobedAsset(interface=interface, leaf=leaf, prim_path=look.prim_path if look else "")


def write_lobed_look(
    path: Path, asset: LobedAsset, functions: BranchFunctions, prim_path: str | None = None, *, force: bool = False
) -> Path:
    """Write a look that gives the leaf of an asset these functions; it appears whole or not at all.

    Args:
        path: The .usda to write; an earlier look there is replaced.
        asset: Of find_lobed_leaf.
        functions: As the leaf shall have them in the end.
        prim_path: Edit only the placement at this prim of a scene; without, the one that asset is a look for, else all.
        force: Replace a file that is no look of ours too.

    Raises:
        AssetError: The asset has no lobed leaf, or path cannot be a look or be written.
    """
    stage = open_asset(asset.interface)
    plant = the_plant(stage, asset.interface)
    mesh = _mesh_of(stage)
    if mesh is None:
        raise AssetError(f"{asset.interface} holds no lobed leaf", "name an asset of usdfoliage lobed")
    target = check_look_output(path, asset.interface, force=force)
    placement = prim_path or asset.prim_path or None
    class_path = look_class(plant, asset.interface, placement)
    points_m = replace(asset.leaf, functions=functions).points_m()
    prim = mesh[1]

    def author_leaf(overs: Usd.Stage) -> None:
        over = UsdGeom.Mesh(overs.OverridePrim(prim.GetPath().ReplacePrefix(plant.GetPath(), class_path)))
        points = Vt.Vec3fArray.FromNumpy(points_m.astype(np.float32))
        extent = UsdGeom.PointBased.ComputeExtent(points)
        over.CreatePointsAttr(points)
        over.CreateExtentAttr(extent)
        if UsdGeom.Mesh(prim).GetNormalsAttr().HasAuthoredValue():
            normals = vertex_normals(points_m, asset.leaf.shape.faces)
            over.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
        author_functions(over.GetPrim(), functions)
        hint = overs.OverridePrim(class_path).CreateAttribute(
            "extentsHint", Sdf.ValueTypeNames.Float3Array, custom=False
        )
        hint.Set(extent)

    layer = build_look(plant, class_path, look_relative(asset.interface, path), author_leaf, placement)
    publish_text(target, layer.ExportToString())
    return path


def _mesh_of(stage: Usd.Stage) -> tuple[Usd.Prim, Usd.Prim] | None:
    """The plant of a stage whose leaves are a lobed leaf, and the mesh; None without such."""
    for prim in stage.Traverse():
        relationship = prim.GetRelationship(TO_LEAVES)
        for target in relationship.GetForwardedTargets() if relationship else ():
            leaf = stage.GetPrimAtPath(target)
            if leaf and LOBED_LEAF_API in leaf.GetAppliedSchemas():
                return prim, leaf
    return None
