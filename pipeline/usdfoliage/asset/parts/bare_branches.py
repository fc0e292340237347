"""What a crown leaves bare of a plant's branches, as a mesh that is shown with it: a trunk, a limb below the crown."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

from usdfoliage.asset.layer import author_scopes, export_layer, new_layer
from usdfoliage.asset.locate import open_copy
from usdfoliage.asset.parts.branches import stage_of_branches
from usdfoliage.asset.parts.part import AssetPlace, Part
from usdfoliage.asset.plant import BARE_BRANCHES, BRANCHES
from usdfoliage.asset.stored_numbers import stored_numbers
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.crown.bare_faces import find_bare_faces
from usdfoliage.errors import AssetError

BARE_LAYER = "branches_bare.usdc"
# Animated branches are read at their first time, at which the crown was made.
_REST = Usd.TimeCode.EarliestTime()
_KINDS = (Vt.Vec3fArray, Vt.IntArray, Vt.IntArray)  # of points, of vertices of each face, and of their indices


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownHull:
    """The surface out of which branches stand."""

    radius_m: NDArray[np.floating]  # (6, N, N), its distance from its centre
    center_m: NDArray[np.floating]  # (3,)


def write_bare_part(place: AssetPlace, hull: CrownHull, cage: BranchCage, color: tuple[float, float, float]) -> Part:
    """Write the faces of branches that stand out of a crown, at /name/geo/proxy/Branches of the asset at place.

    Args:
        place: Where; the payload's folder exists.
        hull: Of the crown.
        cage: Surface of the branches, in the crown's frame.
        color: Of the branches, linear Rec.709.

    Returns:
        What was written; nothing where no face stands out.

    Raises:
        WriteError: The layer cannot be written.
    """
    path = place.payload / BARE_LAYER
    return _write_bare(place, hull, stage_of_branches(path, place.name, cage, color), place.name, path)


def copy_bare_part(place: AssetPlace, hull: CrownHull, surface: Path, name: str) -> Part:
    """The same of the surface in another asset's layer, with points, st, one colour and material as somebody may have
    changed them.

    Args:
        place: Where; the payload's folder exists.
        hull: Of the crown.
        surface: Layer of the branches (usdfoliage.asset.parts.branches.write_branches_layer), in the crown's frame.
        name: Of that layer's root prim.

    Returns:
        What was written; nothing where no face stands out.

    Raises:
        AssetError: The one layer cannot be read, or is of a mesh that cannot be; or the other cannot be written.
    """
    source = Usd.Stage.Open(open_copy(surface), Usd.Stage.LoadNone)
    return _write_bare(place, hull, source, name, surface)


def _write_bare(place: AssetPlace, hull: CrownHull, source: Usd.Stage, source_name: str, surface: Path) -> Part:
    path, name = place.payload / BARE_LAYER, place.name
    whole = UsdGeom.Mesh(source.GetPrimAtPath(f"/{source_name}/{BRANCHES}"))
    if not whole:
        return Part()
    points_m, counts, vertices = _read_mesh(whole, surface)
    kept = find_bare_faces(points_m, counts, vertices, hull.radius_m, hull.center_m)
    if not kept.any():
        return Part()
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
    for attribute in (whole.GetSubdivisionSchemeAttr(), whole.GetOrientationAttr()):
        token = attribute.Get(_REST)
        if isinstance(token, str):  # else the schema's fallback
            mesh.GetPrim().GetAttribute(attribute.GetName()).Set(token)
    mesh.CreateDoubleSidedAttr(False)  # open, but where the crown is around it
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    _copy_primvars(whole, mesh, corner)
    material = UsdShade.MaterialBindingAPI(whole).GetDirectBinding().GetMaterialPath()
    if material:
        binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
        here = material.ReplacePrefix(Sdf.Path(f"/{source_name}"), Sdf.Path(f"/{name}"))
        binding.Bind(UsdShade.Material(stage.OverridePrim(here)))
    export_layer(stage, path)
    return Part(
        collections={"branches": [BARE_BRANCHES]},
        far=[f"./{BARE_LAYER}"],
        far_m=[np.array(mesh.GetExtentAttr().Get(), np.float64)],
    )


def _read_mesh(mesh: UsdGeom.Mesh, surface: Path) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64]]:
    """Points (P, 3), vertices of each face (F,) and their indices; whoever worked on the layer may have broken it."""
    arrays = [
        attribute.Get(_REST)
        for attribute in (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    ]
    points, counts, vertices = (kind() if value is None else value for value, kind in zip(arrays, _KINDS, strict=True))
    reason = _why_no_mesh(points, counts, vertices)
    if reason:
        raise AssetError(
            f"{surface}: the mesh <{mesh.GetPath()}> is broken ({reason})", "mend it, or build the branches again"
        )
    return (
        np.array(points, np.float32).reshape(-1, 3),
        np.array(counts, np.int64),
        np.array(vertices, np.int64),
    )


def _why_no_mesh(points: Any, counts: Any, vertices: Any) -> str:
    """What is wrong with the values of a mesh; empty where nothing is."""
    if not all(isinstance(value, kind) for value, kind in zip((points, counts, vertices), _KINDS, strict=True)):
        return "its points, counts or indices are of another type"
    good, reason = UsdGeom.Mesh.ValidateTopology(vertices, counts, len(points))
    if not good:
        return str(reason)
    if np.min(counts, initial=3) < 3:
        return "a face has fewer than 3 vertices"
    return "" if np.isfinite(np.array(points)).all() else "a point is no finite number"


def _copy_primvars(whole: UsdGeom.Mesh, mesh: UsdGeom.Mesh, corner: NDArray[np.bool_]) -> None:
    """The colour, if it is one, and the st of the corners that are kept, if each has its own."""
    old, new = UsdGeom.PrimvarsAPI(whole), UsdGeom.PrimvarsAPI(mesh)
    color = old.GetPrimvar("displayColor")
    one = stored_numbers(color.Get(_REST), (1, 3)) if color.HasAuthoredValue() else None
    if one is not None and color.GetInterpolation() == UsdGeom.Tokens.constant:
        shade = new.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.constant)
        shade.Set(Vt.Vec3fArray.FromNumpy(one.astype(np.float32)))
    st = old.GetPrimvar("st")
    if st.HasAuthoredValue() and st.GetInterpolation() == UsdGeom.Tokens.faceVarying:
        flat = stored_numbers(st.ComputeFlattened(_REST), (len(corner), 2))  # None where an index is of no value
        if flat is not None:
            values, indices = np.unique(flat[corner].astype(np.float32), axis=0, return_inverse=True)
            copied = new.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
            copied.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(values)))
            copied.SetIndices(Vt.IntArray.FromNumpy(indices.ravel().astype(np.int32)))
