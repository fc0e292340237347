"""What gprims of leaves have in common, whatever they show them as: prototype, mesh, cage or patch."""

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from usdfoliage.leaf.shape.mesh import LeafMesh


def author_leaf_mesh(
    stage: Usd.Stage,
    path: Sdf.Path,
    leaf: LeafMesh,
    color: tuple[float, float, float],
    *,
    count: int = 1,
    extent: NDArray[np.floating] | None = None,
) -> UsdGeom.Mesh:
    """Define a mesh of leaves at path.

    Args:
        count: How many leaves it has, all with the same division.
        extent: (2, 3); that of the points without it.
    """
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(leaf.points_m)
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(leaf.face_counts))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(leaf.face_vertices))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(leaf.normals))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points) if extent is None else outward_corners(extent))
    author_leaf_gprim(mesh, color)
    author_st(mesh, leaf.st, count)
    return mesh


def author_st(gprim: UsdGeom.Gprim, st: NDArray[np.float32], count: int) -> None:
    """Where on a leaf every point is, (P, 2), kept once for leaves of the same division."""
    primvar = UsdGeom.PrimvarsAPI(gprim).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    of_one = len(st) // count
    primvar.Set(Vt.Vec2fArray.FromNumpy(st[:of_one]))
    if count > 1:
        primvar.SetIndices(Vt.IntArray.FromNumpy(np.tile(np.arange(of_one, dtype=np.int32), count)))


def author_leaf_gprim(gprim: UsdGeom.Gprim, color: tuple[float, float, float]) -> None:
    """What every gprim of leaves has, whatever its type: both sides, one colour."""
    gprim.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    gprim.CreateDoubleSidedAttr(True)
    display = UsdGeom.PrimvarsAPI(gprim).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.constant
    )
    display.Set([Gf.Vec3f(*map(float, color))])


def author_leaf_colors(mesh: UsdGeom.Mesh, colors: NDArray[np.floating], faces: int) -> None:
    """A colour for each of the leaves of one mesh, (N, 3); the mesh has so many faces, every leaf the same number."""
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor")
    primvar.SetInterpolation(UsdGeom.Tokens.uniform)
    primvar.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(colors, np.float32)))
    primvar.SetIndices(Vt.IntArray.FromNumpy(np.repeat(np.arange(len(colors), dtype=np.int32), faces // len(colors))))


def outward_corners(extent: NDArray[np.floating]) -> list[Gf.Vec3f]:
    """Two corners as USD wants them, rounded outwards."""
    low, high = np.asarray(extent, np.float32)
    low = np.where(low > extent[0], np.nextafter(low, np.float32(-np.inf)), low)
    high = np.where(high < extent[1], np.nextafter(high, np.float32(np.inf)), high)
    return [Gf.Vec3f(*map(float, low)), Gf.Vec3f(*map(float, high))]
