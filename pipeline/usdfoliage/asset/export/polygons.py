"""Subdivision surfaces as polygons, for what draws the cage in their place.

Points and normals are those of the limit surface. Values at the corners of faces go along in straight lines, as USD's
own default for them; those of a face are those of its parts.
"""

from collections.abc import Container

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from usdfoliage._native import refine_catmull_clark
from usdfoliage.asset.parts.leaf_gprims import outward_corners
from usdfoliage.errors import AssetError

_SHARP = 10.0  # from here on an edge is infinitely sharp, as USD has it


def polygonize_meshes(stage: Usd.Stage, max_faces: int, fine: Container[Sdf.Path] = ()) -> list[str]:
    """Replace every Catmull-Clark surface of a stage by polygons of its limit: each face by four, or by its cage.

    Args:
        stage: Flat; it is changed.
        max_faces: Of a cage that is refined; one of more stays as it is, and becomes polygons.
        fine: Where cages are that have faces enough: if all are quads, none is divided, and points move to the limit.

    Returns:
        The paths of those that stayed as they are.

    Raises:
        AssetError: A surface is no mesh.
    """
    coarse = []
    for prim in stage.Traverse():
        mesh = UsdGeom.Mesh(prim)
        if not mesh or mesh.GetSubdivisionSchemeAttr().Get() == UsdGeom.Tokens.none:
            continue
        if len(mesh.GetFaceVertexCountsAttr().Get() or ()) > max_faces:
            coarse.append(str(prim.GetPath()))
        else:
            _refine(mesh, is_fine=prim.GetPath() in fine)
        _drop_subdivision(mesh)
    return coarse


def _refine(mesh: UsdGeom.Mesh, *, is_fine: bool) -> None:
    prim = mesh.GetPrim()
    read = [
        each.Get() for each in (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    ]
    if any(value is None for value in read):
        raise AssetError(f"<{prim.GetPath()}> has no points or faces", "write the asset again")
    points, counts, vertices = np.array(read[0], np.float64), np.array(read[1], np.int32), np.array(read[2], np.int32)
    if not len(counts):
        return
    levels = 0 if is_fine and (counts == 4).all() else 1
    edges, edge_sharpness = _creases(mesh)
    corners = np.array(mesh.GetCornerIndicesAttr().Get() or [], np.int32)
    sharpness = np.array(mesh.GetCornerSharpnessesAttr().Get() or [], np.float32)
    try:
        refined = refine_catmull_clark(
            points,
            counts,
            vertices,
            crease_edges=edges,
            crease_sharpness=edge_sharpness,
            corner_vertices=corners,
            corner_sharpness=sharpness,
            levels=levels,
            limit=True,
        )
    except ValueError as error:
        raise AssetError(f"<{prim.GetPath()}> is no mesh: {error}", "write the asset again") from error
    for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues() if levels else ():
        _refine_primvar(primvar, counts, vertices, len(refined.faces))
    moved = Vt.Vec3fArray.FromNumpy(refined.points.astype(np.float32))
    mesh.GetPointsAttr().Set(moved)
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(refined.normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.GetFaceVertexCountsAttr().Set(Vt.IntArray(len(refined.faces), 4))
    mesh.GetFaceVertexIndicesAttr().Set(Vt.IntArray.FromNumpy(np.ascontiguousarray(refined.faces, np.int32).ravel()))
    low, high = (Gf.Vec3f(*corner) for corner in UsdGeom.PointBased.ComputeExtent(moved))
    mesh.CreateExtentAttr(outward_corners(np.array([low, high], np.float64)))


def _creases(mesh: UsdGeom.Mesh) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Edges (E, 2) of all creases, and their sharpness (E,)."""
    indices = np.array(mesh.GetCreaseIndicesAttr().Get() or [], np.int32)
    lengths = np.array(mesh.GetCreaseLengthsAttr().Get() or [], np.int32)
    values = np.array(mesh.GetCreaseSharpnessesAttr().Get() or [], np.float32)
    first = np.ones(len(indices), bool)  # of an edge: all but the last of each crease
    ends = np.cumsum(lengths) - 1
    first[ends] = False
    start = np.flatnonzero(first)
    edges = np.column_stack([indices[start], indices[start + 1]]) if len(start) else np.zeros((0, 2), np.int32)
    each = lengths - 1
    if len(values) == len(lengths):  # one a crease, not one an edge
        values = np.repeat(values, each)
    return np.ascontiguousarray(edges, np.int32), np.minimum(values, _SHARP).astype(np.float32)


def _refine_primvar(
    primvar: UsdGeom.Primvar, counts: NDArray[np.int32], vertices: NDArray[np.int32], faces: int
) -> None:
    interpolation = primvar.GetInterpolation()
    if interpolation == UsdGeom.Tokens.constant:
        return
    # Every face of k corners becomes k quads, in the order of its corners.
    if interpolation == UsdGeom.Tokens.uniform:
        indices = np.array(primvar.GetIndices(), np.int64) if primvar.IsIndexed() else np.arange(len(counts))
        primvar.SetIndices(Vt.IntArray.FromNumpy(np.repeat(indices, counts).astype(np.int32)))
        return
    values = np.array(primvar.Get())
    if values.dtype.kind != "f":
        primvar.GetAttr().GetPrim().RemoveProperty(primvar.GetName())  # numbers of points that are there no more
        return
    if primvar.IsIndexed():
        values = values[np.array(primvar.GetIndices(), np.int64)]
    at_corners = values if interpolation == UsdGeom.Tokens.faceVarying else values[vertices]
    mixed = _corners_of_parts(at_corners.astype(np.float64), counts).astype(values.dtype)
    unique, where = np.unique(mixed, axis=0, return_inverse=True)
    array_type = type(primvar.Get())
    primvar.Set(array_type.FromNumpy(np.ascontiguousarray(unique)))
    primvar.SetIndices(Vt.IntArray.FromNumpy(where.reshape(-1).astype(np.int32)))
    primvar.SetInterpolation(UsdGeom.Tokens.faceVarying)


def _corners_of_parts(values: NDArray[np.float64], counts: NDArray[np.int32]) -> NDArray[np.float64]:
    """(4 C, ...) values at the corners of the quads that faces become, from those at their own corners (C, ...)."""
    parts = np.empty((len(values), 4, *values.shape[1:]))
    first = np.cumsum(counts) - counts
    for count in np.unique(counts):
        of_count = np.flatnonzero(counts == count)
        corner = first[of_count, None] + np.arange(count)
        around = values[corner]  # (F, k, ...)
        weights = _part_weights(int(count))
        parts[corner] = np.einsum("pqk,fk...->fpq...", weights, around)
    return parts.reshape(-1, *values.shape[1:])


def _part_weights(count: int) -> NDArray[np.float64]:
    """(k, 4, k): how each corner of each part of a face of k corners is mixed from the face's corners.

    Whichever corner the refinement begins a part with: found by refining one regular face, whose corners, middles of
    edges and centre lie apart.
    """
    angle = 2 * np.pi * np.arange(count) / count
    corners = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    refined = refine_catmull_clark(
        corners,
        np.array([count], np.int32),
        np.arange(count, dtype=np.int32),
        crease_edges=np.zeros((0, 2), np.int32),
        crease_sharpness=np.zeros(0, np.float32),
        corner_vertices=np.arange(count, dtype=np.int32),
        corner_sharpness=np.full(count, _SHARP, np.float32),
        levels=1,
        limit=False,
    )
    own = np.eye(count)
    mixes = np.concatenate([own, (own + np.roll(own, -1, axis=0)) / 2, np.full((1, count), 1 / count)])
    places = mixes @ corners
    at = refined.points[refined.faces]  # (k, 4, 3)
    nearest = np.linalg.norm(at[:, :, None] - places, axis=-1).argmin(axis=-1)
    return np.asarray(mixes[nearest])


def _drop_subdivision(mesh: UsdGeom.Mesh) -> None:
    prim = mesh.GetPrim()
    for name in (
        "interpolateBoundary", "faceVaryingLinearInterpolation", "triangleSubdivisionRule",
        "creaseIndices", "creaseLengths", "creaseSharpnesses", "cornerIndices", "cornerSharpnesses",
    ):  # fmt: skip
        prim.RemoveProperty(name)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
