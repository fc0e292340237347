"""Branches in USD: their skeleton as curves with FoliageSkeletonAPI, and their surface as one subdivided mesh."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from usdfoliage.asset.layer import author_scopes, export_layer, new_layer
from usdfoliage.asset.materials.layer import BARK_MATERIAL
from usdfoliage.asset.plant import BRANCHES, SKELETON
from usdfoliage.asset.schema import SKELETON_API
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.model import Skeleton
from usdfoliage.errors import AssetError

_GROWTH: Mapping[str, Sdf.ValueTypeName] = {
    "internodeLength": Sdf.ValueTypeNames.Float,
    "divergenceAngle": Sdf.ValueTypeNames.Float,
    "branchingAngle": Sdf.ValueTypeNames.Float,
    "initialGrowthUnits": Sdf.ValueTypeNames.Float,
    "initialLength": Sdf.ValueTypeNames.Float,
    "maximumLength": Sdf.ValueTypeNames.Float,
    "rootDiameter": Sdf.ValueTypeNames.Float,
    "allometryExponent": Sdf.ValueTypeNames.Float,
}
_INFERRED = "foliage:inferred"


@dataclass(frozen=True, kw_only=True, eq=False)
class SkeletonPrim:
    """A skeleton, and the growth parameters that are known of it, by the schema's names, angles in degrees."""

    skeleton: Skeleton
    growth: Mapping[str, float] = field(default_factory=dict)


def write_skeleton_layer(path: Path, name: str, prim: SkeletonPrim) -> NDArray[np.float64]:
    """Write the skeleton alone, at /name/geo/guide/Skeleton with the purpose guide; returns its bounds (2, 3)."""
    stage = new_layer(path, name)
    skeleton = Sdf.Path(f"/{name}/{SKELETON}")
    author_scopes(stage, skeleton.GetParentPath())
    UsdGeom.Imageable(stage.GetPrimAtPath(skeleton.GetParentPath())).CreatePurposeAttr(UsdGeom.Tokens.guide)
    curves = author_skeleton(stage, skeleton, prim)
    export_layer(stage, path)
    return np.array(curves.GetExtentAttr().Get(), np.float64)


def author_skeleton(stage: Usd.Stage, path: Sdf.Path, prim: SkeletonPrim) -> UsdGeom.BasisCurves:
    """Define linear curves at path, one a branch, with FoliageSkeletonAPI."""
    skeleton = prim.skeleton
    curves = UsdGeom.BasisCurves.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(skeleton.points_m.astype(np.float32))
    widths = Vt.FloatArray.FromNumpy((2 * skeleton.radius_m).astype(np.float32))
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
    curves.CreatePointsAttr(points)
    curves.CreateCurveVertexCountsAttr(Vt.IntArray.FromNumpy(skeleton.counts))
    curves.CreateWidthsAttr(widths)
    curves.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
    curves.CreateExtentAttr(UsdGeom.Curves.ComputeExtent(points, widths))
    share = np.linspace(0, 1, int(skeleton.order.max()) + 1)
    # From blue to orange, for green lines are not seen among leaves.
    shade = np.column_stack([0.05 + 0.95 * share, np.full(len(share), 0.4), 1.0 - 0.95 * share])
    color = UsdGeom.PrimvarsAPI(curves).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.uniform
    )
    color.Set(Vt.Vec3fArray.FromNumpy(shade.astype(np.float32)))  # by order
    color.SetIndices(Vt.IntArray.FromNumpy(skeleton.order))
    curve_prim = curves.GetPrim()
    curve_prim.AddAppliedSchema(SKELETON_API)
    for fact, values in (
        ("parentCurve", skeleton.parent_curve),
        ("parentVertex", skeleton.parent_vertex),
        ("order", skeleton.order),
    ):
        attribute = curve_prim.CreateAttribute(f"foliage:{fact}", Sdf.ValueTypeNames.IntArray, custom=False)
        attribute.Set(Vt.IntArray.FromNumpy(values))
    if skeleton.inferred.any():
        attribute = curve_prim.CreateAttribute(_INFERRED, Sdf.ValueTypeNames.IntArray, custom=False)
        attribute.Set(Vt.IntArray.FromNumpy(skeleton.inferred.astype(np.int32)))
    for fact, value in prim.growth.items():
        curve_prim.CreateAttribute(f"foliage:growth:{fact}", _GROWTH[fact], custom=False).Set(float(value))
    return curves


def read_skeleton(prim: Usd.Prim) -> Skeleton:
    """The skeleton that author_skeleton wrote.

    Raises:
        AssetError: An array is missing, or they make no skeleton.
    """
    curves = UsdGeom.BasisCurves(prim)
    values = {
        "points_m": curves.GetPointsAttr().Get(Usd.TimeCode.EarliestTime()),
        "widths": curves.GetWidthsAttr().Get(Usd.TimeCode.EarliestTime()),
        "counts": curves.GetCurveVertexCountsAttr().Get(),
        **{fact: prim.GetAttribute(f"foliage:{fact}").Get() for fact in ("parentCurve", "parentVertex", "order")},
    }
    inferred = prim.GetAttribute(_INFERRED).Get()
    missing = [name for name, value in values.items() if value is None]
    if missing:
        raise AssetError(f"<{prim.GetPath()}> has no {', '.join(missing)}", "write the asset again")
    try:
        with np.errstate(invalid="ignore"):  # of bytes that are no number at all, which Skeleton refuses
            points_m = np.array(values["points_m"], np.float64).reshape(-1, 3)
            widths_m = np.array(values["widths"], np.float64)
        return Skeleton(
            points_m=points_m,
            radius_m=widths_m / 2,
            counts=np.array(values["counts"], np.int32),
            parent_curve=np.array(values["parentCurve"], np.int32),
            parent_vertex=np.array(values["parentVertex"], np.int32),
            order=np.array(values["order"], np.int32),
            inferred=np.zeros(len(values["counts"]), bool) if inferred is None else np.array(inferred, np.int32) == 1,
        )
    except (ValueError, IndexError) as error:
        raise AssetError(f"<{prim.GetPath()}> is no skeleton: {error}", "write the asset again") from error


def write_branches_layer(
    path: Path, name: str, cage: BranchCage, color: tuple[float, float, float]
) -> NDArray[np.float64]:
    """Write the surface alone, at /name/geo/render/Branches; returns its bounds (2, 3)."""
    stage = stage_of_branches(path, name, cage, color)
    export_layer(stage, path)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/{name}/{BRANCHES}"))
    return np.array(mesh.GetExtentAttr().Get(), np.float64)


def stage_of_branches(path: Path, name: str, cage: BranchCage, color: tuple[float, float, float]) -> Usd.Stage:
    """The stage whose layer write_branches_layer writes to path."""
    stage = new_layer(path, name)
    branches = Sdf.Path(f"/{name}/{BRANCHES}")
    author_scopes(stage, branches.GetParentPath())
    mesh = author_branches(stage, branches, cage, color)
    binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    binding.Bind(UsdShade.Material(stage.OverridePrim(Sdf.Path(f"/{name}/{BARK_MATERIAL}"))))
    return stage


def author_branches(
    stage: Usd.Stage, path: Sdf.Path, cage: BranchCage, color: tuple[float, float, float]
) -> UsdGeom.Mesh:
    """Define the cage at path, to be subdivided: st in metres around and along a branch, its number on each face."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(cage.points_m.astype(np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(cage.faces), 4))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(cage.faces, np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(False)  # closed
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    primvars = UsdGeom.PrimvarsAPI(mesh)
    st = primvars.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
    st.Set(Vt.Vec2fArray.FromNumpy(cage.st_m.astype(np.float32)))
    st.SetIndices(Vt.IntArray.FromNumpy(np.ascontiguousarray(cage.face_st, np.int32).ravel()))
    number = primvars.CreatePrimvar("branch:curve", Sdf.ValueTypeNames.IntArray, UsdGeom.Tokens.uniform)
    number.Set(Vt.IntArray.FromNumpy(np.ascontiguousarray(cage.curve, np.int32)))
    shade = primvars.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.constant)
    shade.Set([Gf.Vec3f(*map(float, color))])
    return mesh


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceMesh:
    """A polygonal mesh, before it is subdivided."""

    points_m: NDArray[np.float64]  # (V, 3)
    face_counts: NDArray[np.int32]  # (F,), vertices of each face
    face_vertices: NDArray[np.int32]  # (sum of face_counts,)


def read_branches(prim: Usd.Prim) -> SurfaceMesh:
    """The surface that author_branches wrote, in the prim's own frame.

    Raises:
        AssetError: An array is missing, or they make no mesh.
    """
    mesh = UsdGeom.Mesh(prim)
    read = [
        attribute.Get()
        for attribute in (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    ]
    if any(value is None for value in read):
        raise AssetError(f"<{prim.GetPath()}> has no points or faces", "write the asset again")
    points_m = np.array(read[0], np.float64).reshape(-1, 3)
    counts, vertices = (np.array(value, np.int32) for value in read[1:])
    if counts.sum() != len(vertices) or (len(vertices) and not 0 <= vertices.min() <= vertices.max() < len(points_m)):
        raise AssetError(f"<{prim.GetPath()}> is no mesh: its faces do not fit its points", "write the asset again")
    return SurfaceMesh(points_m=points_m, face_counts=counts, face_vertices=vertices)
