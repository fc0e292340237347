"""One leaf in several poses, side by side: a stage for a picture, which is no part of an asset."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, UsdGeom, Vt

from usdfoliage.asset.layer import export_layer, new_layer
from usdfoliage.asset.parts.terrain import vertex_normals
from usdfoliage.asset.plant import LEAVES
from usdfoliage.leaf.lobed.deformation import BranchFunctions
from usdfoliage.leaf.lobed.placed import LobedLeaf

_ROOM = 1.15  # of a leaf in its cell


def write_poses(
    path: Path,
    interface: Path,
    leaf: LobedLeaf,
    poses: Sequence[BranchFunctions],
    *,
    columns: int,
    flat_too: bool = False,
) -> None:
    """Write a layer that shows the leaf of an asset deformed in several ways, row after row from above.

    Args:
        path: Of the layer.
        interface: The asset's interface layer.
        leaf: Which the asset has.
        poses: Functions of each copy.
        columns: Copies in a row.

    Raises:
        WriteError: The layer cannot be written.
    """
    stage = new_layer(path, "poses")
    bent = [replace(leaf, functions=each).points_m() for each in poses]
    step_m = _ROOM * np.max([np.ptp(points_m[:, :2], axis=0) for points_m in bent], axis=0)
    for number, points_m in enumerate(bent):
        row, column = divmod(number, columns)
        copy = UsdGeom.Xform.Define(stage, Sdf.Path(f"/poses/pose_{number + 1}"))
        copy.GetPrim().GetReferences().AddReference(str(interface))
        middle_m = (points_m.min(axis=0) + points_m.max(axis=0)) / 2
        copy.AddTranslateOp().Set(Gf.Vec3d(*(np.array([column, -row, 0]) * [*step_m, 0] - middle_m).tolist()))
        mesh = UsdGeom.Mesh(stage.OverridePrim(copy.GetPath().AppendPath(LEAVES)))
        points = Vt.Vec3fArray.FromNumpy(points_m.astype(np.float32))
        mesh.CreatePointsAttr(points)
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(vertex_normals(points_m, leaf.shape.faces).astype(np.float32)))
        mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    export_layer(stage, path)
