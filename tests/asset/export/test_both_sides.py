"""Thin meshes with a face for each side."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt
from usdfoliage.asset.export.both_sides import author_both_sides
from usdfoliage.errors import AssetError

QUAD = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
TIP = (0.5, 2, 0)


def sheet(stage: Usd.Stage, path: str, double_sided: bool) -> UsdGeom.Mesh:
    """A square and a triangle on top of it, in the plane z = 0, seen from +z."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([*QUAD, TIP])
    mesh.CreateFaceVertexCountsAttr([4, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 3, 2, 4])
    mesh.CreateNormalsAttr([(0, 0, 1)] * 5)
    mesh.CreateDoubleSidedAttr(double_sided)
    primvars, types, tokens = UsdGeom.PrimvarsAPI(mesh), Sdf.ValueTypeNames, UsdGeom.Tokens
    primvars.CreatePrimvar("st", types.TexCoord2fArray, tokens.vertex).Set([p[:2] for p in [*QUAD, TIP]])
    of_face = primvars.CreatePrimvar("part", types.IntArray, tokens.uniform)
    of_face.Set([7, 8])
    of_face.SetIndices([1, 0])
    primvars.CreatePrimvar("corner", types.FloatArray, tokens.faceVarying).Set([0, 1, 2, 3, 3, 2, 4])
    primvars.CreatePrimvar("displayColor", types.Color3fArray, tokens.constant).Set([Gf.Vec3f(0.1, 0.2, 0.3)])
    return mesh


def face_normals(points: np.ndarray, counts: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    first = np.cumsum(counts) - counts
    at = points[vertices[first[:, None] + np.arange(3)]]
    return np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])


def test_the_sides_of_a_very_small_leaf_are_nearer_than_it_is_wide():
    stage = Usd.Stage.CreateInMemory()
    mesh = sheet(stage, "/leaf", True)
    small = Vt.Vec3fArray.FromNumpy(1e-4 * np.array(mesh.GetPointsAttr().Get(), np.float32))
    mesh.GetPointsAttr().Set(small)
    author_both_sides(stage)
    points = np.array(mesh.GetPointsAttr().Get())
    assert 0 < np.ptp(points[:, 2]) <= 0.2 * np.ptp(points[:, 0])


def test_each_face_gets_one_behind_it_that_looks_back():
    stage = Usd.Stage.CreateInMemory()
    mesh = sheet(stage, "/leaf", True)
    author_both_sides(stage, 0.1)
    points, normals = np.array(mesh.GetPointsAttr().Get()), np.array(mesh.GetNormalsAttr().Get())
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get())
    vertices = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    np.testing.assert_array_equal(counts, [4, 3, 4, 3])
    np.testing.assert_allclose(points[:, 2], [0.05] * 5 + [-0.05] * 5)
    np.testing.assert_allclose(points[:5, :2], points[5:, :2])
    np.testing.assert_array_equal(np.sign(face_normals(points, counts, vertices)[:, 2]), [1, 1, -1, -1])
    np.testing.assert_array_equal(normals[:, 2], [1] * 5 + [-1] * 5)
    assert set(vertices[7:]) == {5, 6, 7, 8, 9}
    low, high = np.array(mesh.GetExtentAttr().Get())
    np.testing.assert_allclose([low, high], [points.min(axis=0), points.max(axis=0)], atol=1e-6)


def test_what_a_face_carries_is_on_both_its_sides():
    stage = Usd.Stage.CreateInMemory()
    mesh = sheet(stage, "/leaf", True)
    author_both_sides(stage)
    primvars = UsdGeom.PrimvarsAPI(mesh)
    vertices = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    np.testing.assert_array_equal(primvars.GetPrimvar("part").ComputeFlattened(), [8, 7, 8, 7])
    st = np.array(primvars.GetPrimvar("st").ComputeFlattened())
    np.testing.assert_allclose(st, np.array(mesh.GetPointsAttr().Get())[:, :2])
    # The value of a corner was the number of its point.
    np.testing.assert_array_equal(primvars.GetPrimvar("corner").ComputeFlattened(), vertices % 5)
    assert len(primvars.GetPrimvar("displayColor").Get()) == 1


def test_closed_meshes_stay_as_they_are():
    stage = Usd.Stage.CreateInMemory()
    mesh = sheet(stage, "/stem", False)
    author_both_sides(stage)
    assert len(mesh.GetPointsAttr().Get()) == 5


def test_a_mesh_needs_a_normal_at_each_point():
    stage = Usd.Stage.CreateInMemory()
    sheet(stage, "/leaf", True).GetNormalsAttr().Set([(0, 0, 1)] * 2)
    with pytest.raises(AssetError, match="2 normals for 5 points"):
        author_both_sides(stage)
