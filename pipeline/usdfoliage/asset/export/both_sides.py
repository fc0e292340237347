"""Thin meshes with a face for each side, for what ignores doubleSided and draws the front of a face alone."""

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, Vt

from usdfoliage.asset.parts.leaf_gprims import outward_corners
from usdfoliage.errors import AssetError

THICKNESS_M = 2e-4  # of a leaf; sides in one place would shade each other
MAX_SHARE = 0.1  # of an edge of its mesh, for leaves that are very small


def author_both_sides(stage: Usd.Stage, thickness_m: float = THICKNESS_M) -> None:
    """Give every double-sided mesh of a stage a second face behind each of its own, turned round.

    The sides lie half the thickness in front of the surface and behind it, or less where faces are very small. Meshes
    stay double-sided, so that what draws the backs of faces too shades both sides in the same way.

    Args:
        stage: Flat, in metres, its meshes of polygons with a normal at each point; it is changed.

    Raises:
        AssetError: A mesh has another number of normals than of points.
    """
    for prim in stage.Traverse():
        mesh = UsdGeom.Mesh(prim)
        if mesh and mesh.GetDoubleSidedAttr().Get() and len(mesh.GetFaceVertexCountsAttr().Get() or ()):
            _double(mesh, thickness_m / 2)


def _double(mesh: UsdGeom.Mesh, away_m: float) -> None:
    points = np.array(mesh.GetPointsAttr().Get(), np.float64)
    normals = np.array(mesh.GetNormalsAttr().Get() or [], np.float64)
    if points.shape != normals.shape:
        what = f"<{mesh.GetPath()}> has {len(normals)} normals for {len(points)} points"
        raise AssetError(what, "write the asset again")
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(), np.int64)
    vertices = np.array(mesh.GetFaceVertexIndicesAttr().Get(), np.int64)
    edges_m = np.linalg.norm(points[vertices[1:]] - points[vertices[:-1]], axis=1)
    away_m = min(away_m, MAX_SHARE * float(np.median(edges_m)))
    turned = _turned_corners(counts)
    for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithAuthoredValues():
        _double_primvar(primvar, turned)
    moved = Vt.Vec3fArray.FromNumpy(
        np.concatenate([points + away_m * normals, points - away_m * normals]).astype(np.float32)
    )
    mesh.GetPointsAttr().Set(moved)
    mesh.GetNormalsAttr().Set(Vt.Vec3fArray.FromNumpy(np.concatenate([normals, -normals]).astype(np.float32)))
    mesh.GetFaceVertexCountsAttr().Set(Vt.IntArray.FromNumpy(np.tile(counts, 2).astype(np.int32)))
    both = np.concatenate([vertices, vertices[turned] + len(points)])
    mesh.GetFaceVertexIndicesAttr().Set(Vt.IntArray.FromNumpy(both.astype(np.int32)))
    low, high = (Gf.Vec3f(*corner) for corner in UsdGeom.PointBased.ComputeExtent(moved))
    mesh.CreateExtentAttr(outward_corners(np.array([low, high], np.float64)))


def _turned_corners(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """(C,): the corners of faces, those of each face in the other direction; its first corner stays the first."""
    first = np.repeat(np.cumsum(counts) - counts, counts)
    along = np.arange(counts.sum()) - first
    return np.asarray(first + (-along) % np.repeat(counts, counts))


def _double_primvar(primvar: UsdGeom.Primvar, turned: NDArray[np.int64]) -> None:
    interpolation = primvar.GetInterpolation()
    if interpolation == UsdGeom.Tokens.constant:
        return
    values = primvar.GetIndices() if primvar.IsIndexed() else primvar.Get()
    first = np.array(values)
    second = first[turned] if interpolation == UsdGeom.Tokens.faceVarying else first
    both = type(values).FromNumpy(np.ascontiguousarray(np.concatenate([first, second])))
    if primvar.IsIndexed():
        primvar.SetIndices(both)
    else:
        primvar.Set(both)
