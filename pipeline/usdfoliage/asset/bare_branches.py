"""What a crown leaves bare of a plant's branches, as a mesh that is shown with it: a trunk, a limb below the crown."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

from usdfoliage.asset.layer import author_scopes, export_layer, new_layer
from usdfoliage.asset.locate import open_layer
from usdfoliage.asset.plant import BARE_BRANCHES, BRANCHES
from usdfoliage.crown.bare_faces import find_bare_faces
from usdfoliage.crown.model import CrownModel

BARE_LAYER = "branches_bare.usdc"


def write_bare_branches_layer(path: Path, name: str, surface: Path, crown: CrownModel) -> NDArray[np.float64] | None:
    """Write the faces of branches that stand out of a crown, at /name/geo/proxy/Branches.

    Of the surface, whoever worked on it, they keep points, st, one colour and the material.

    Args:
        path: Layer to write.
        name: Of the root prim of both layers.
        surface: Layer of the branches (usdfoliage.asset.branches.write_branches_layer), in the crown's frame.
        crown: The crown.

    Returns:
        Bounds (2, 3) of what was written; None where nothing stands out, and nothing is written.

    Raises:
        AssetError: The one layer cannot be read, or the other not written.
    """
    source = Usd.Stage.Open(open_layer(surface), Usd.Stage.LoadNone)
    whole = UsdGeom.Mesh(source.GetPrimAtPath(f"/{name}/{BRANCHES}"))
    if not whole:
        return None
    points_m = np.array(whole.GetPointsAttr().Get() or np.zeros((0, 3)), np.float32)
    counts = np.array(whole.GetFaceVertexCountsAttr().Get() or [], np.int64)
    vertices = np.array(whole.GetFaceVertexIndicesAttr().Get() or [], np.int64)
    kept = find_bare_faces(points_m, counts, vertices, crown)
    if not kept.any():
        return None
    stage = new_layer(path, name)
    target = Sdf.Path(f"/{name}/{BARE_BRANCHES}")
    author_scopes(stage, target.GetParentPath())
    mesh = UsdGeom.Mesh.Define(stage, target)
    corner = np.repeat(kept, counts)
    used, index = np.unique(vertices[corner], return_inverse=True)
    points = Vt.Vec3fArray.FromNumpy(points_m[used])
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts[kept].astype(np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(index.astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr(whole.GetSubdivisionSchemeAttr().Get())
    mesh.CreateOrientationAttr(whole.GetOrientationAttr().Get())
    mesh.CreateDoubleSidedAttr(False)  # open, but where the crown is around it
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    _copy_primvars(whole, mesh, corner)
    material = UsdShade.MaterialBindingAPI(whole).GetDirectBinding().GetMaterialPath()
    if material:
        binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
        binding.Bind(UsdShade.Material(stage.OverridePrim(material)))
    export_layer(stage, path)
    return np.array(mesh.GetExtentAttr().Get(), np.float64)


def _copy_primvars(whole: UsdGeom.Mesh, mesh: UsdGeom.Mesh, corner: NDArray[np.bool_]) -> None:
    """The colour, if it is one, and the st of the corners that are kept, if each has its own."""
    old, new = UsdGeom.PrimvarsAPI(whole), UsdGeom.PrimvarsAPI(mesh)
    color = old.GetPrimvar("displayColor")
    if color.HasAuthoredValue() and color.GetInterpolation() == UsdGeom.Tokens.constant:
        new.CreatePrimvar(color.GetPrimvarName(), color.GetTypeName(), UsdGeom.Tokens.constant).Set(color.Get())
    st = old.GetPrimvar("st")
    if st.HasAuthoredValue() and st.GetInterpolation() == UsdGeom.Tokens.faceVarying:
        flat = np.array(st.ComputeFlattened(), np.float32)
        if len(flat) == len(corner):
            values, indices = np.unique(flat[corner], axis=0, return_inverse=True)
            held = new.CreatePrimvar("st", st.GetTypeName(), UsdGeom.Tokens.faceVarying)
            held.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(values)))
            held.SetIndices(Vt.IntArray.FromNumpy(indices.ravel().astype(np.int32)))
