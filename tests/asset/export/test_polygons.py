"""Subdivision surfaces as polygons of their limit."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt
from usdfoliage.asset.export.polygons import polygonize_meshes
from usdfoliage.asset.parts.branches import author_branches
from usdfoliage.branch.cage.build import build_branch_cage

from tests.support.branch_shapes import fork, limit

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def cube(stage: Usd.Stage) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, "/cube")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(CUBE.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(np.ravel(FACES).tolist())
    return mesh


def test_a_cube_becomes_quads_of_its_limit_with_normals_outwards():
    stage = Usd.Stage.CreateInMemory()
    mesh = cube(stage)
    assert polygonize_meshes(stage, 100) == []
    points = np.array(mesh.GetPointsAttr().Get())
    assert len(mesh.GetFaceVertexCountsAttr().Get()) == 24
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    # The limit of a corner of three faces: (9 of itself + 4 of each neighbour + 1 of each corner across) / 24.
    assert np.abs(points).max() < 1
    np.testing.assert_allclose(np.linalg.norm(points[:8], axis=1), np.sqrt(3) * (9 + 4 - 1) / 24, rtol=1e-5)
    normals = np.array(mesh.GetNormalsAttr().Get())
    assert (np.sum(normals * points, axis=1) > 0).all()
    np.testing.assert_allclose(mesh.GetExtentAttr().Get(), [points.min(axis=0), points.max(axis=0)], atol=1e-6)


def test_values_of_faces_and_corners_go_with_them():
    stage = Usd.Stage.CreateInMemory()
    mesh = cube(stage)
    primvars = UsdGeom.PrimvarsAPI(mesh)
    of_face = primvars.CreatePrimvar("number", Sdf.ValueTypeNames.IntArray, UsdGeom.Tokens.uniform)
    of_face.Set([10, 11, 12, 13, 14, 15])
    st = primvars.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
    st.Set([Gf.Vec2f(0, 0), Gf.Vec2f(1, 0), Gf.Vec2f(1, 1), Gf.Vec2f(0, 1)])
    st.SetIndices([0, 1, 2, 3] * 6)
    shade = primvars.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.constant)
    shade.Set([Gf.Vec3f(0.1, 0.2, 0.3)])
    polygonize_meshes(stage, 100)
    np.testing.assert_array_equal(np.array(of_face.ComputeFlattened()), np.repeat(np.arange(10, 16), 4))
    corners = np.array(st.ComputeFlattened()).reshape(6, 4, 4, 2)
    for face in corners:  # quarters of the unit square: each has its centre, none is twisted
        assert sorted(map(tuple, face.mean(axis=1).tolist())) == [
            (0.25, 0.25),
            (0.25, 0.75),
            (0.75, 0.25),
            (0.75, 0.75),
        ]
        for part in face:
            x, y = part.T
            area = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
            assert area == pytest.approx(0.25)
    assert len(shade.Get()) == 1


def test_branches_are_those_of_the_limit_and_keep_their_numbers():
    stage = Usd.Stage.CreateInMemory()
    cage = build_branch_cage(fork())
    mesh = author_branches(stage, Sdf.Path("/b"), cage, (0.2, 0.2, 0.1))
    polygonize_meshes(stage, 10_000)
    points, quads = limit(cage, levels=1)
    np.testing.assert_allclose(np.array(mesh.GetPointsAttr().Get()), points, atol=1e-6)
    np.testing.assert_array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4), quads)
    curves = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("branch:curve").ComputeFlattened())
    np.testing.assert_array_equal(curves, np.repeat(cage.curve, 4))
    # Along the trunk t is the height: at each corner that of the point, but at its ends, which are rounded.
    st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").ComputeFlattened()).reshape(-1, 4, 2)
    height_m = points[quads][..., 1]
    inside = (curves == 0) & (height_m.min(axis=1) > 0.2) & (height_m.max(axis=1) < 0.6)
    assert inside.any()
    np.testing.assert_allclose(st[inside, :, 1], height_m[inside], atol=0.06)  # rings are 0.26 m apart


def test_too_many_faces_stay_a_cage_of_polygons_and_are_named():
    stage = Usd.Stage.CreateInMemory()
    mesh = cube(stage)
    assert polygonize_meshes(stage, 5) == ["/cube"]
    assert len(mesh.GetFaceVertexCountsAttr().Get()) == 6
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"


def test_a_sharp_edge_stays_where_it_is():
    stage = Usd.Stage.CreateInMemory()
    mesh = cube(stage)
    mesh.CreateCreaseIndicesAttr([4, 6, 7, 5, 4])
    mesh.CreateCreaseLengthsAttr([5])
    mesh.CreateCreaseSharpnessesAttr([10.0])
    mesh.CreateCornerIndicesAttr([0])
    mesh.CreateCornerSharpnessesAttr([10.0])
    polygonize_meshes(stage, 100)
    points = np.array(mesh.GetPointsAttr().Get())
    assert points[:, 0].max() == pytest.approx(1)
    np.testing.assert_allclose(points[0], CUBE[0], atol=1e-6)
    assert not mesh.GetCreaseIndicesAttr().HasAuthoredValue()


def test_a_cage_that_is_fine_enough_keeps_its_faces_at_the_limit():
    stage = Usd.Stage.CreateInMemory()
    mesh = cube(stage)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
    st.Set([Gf.Vec2f(0, 0), Gf.Vec2f(1, 0), Gf.Vec2f(1, 1), Gf.Vec2f(0, 1)])
    st.SetIndices([0, 1, 2, 3] * 6)
    assert polygonize_meshes(stage, 100, fine=[Sdf.Path("/cube")]) == []
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    points = np.array(mesh.GetPointsAttr().Get())
    np.testing.assert_allclose(points, CUBE / 2, rtol=1e-6)  # (9 + 4 - 1) / 24 along each axis
    np.testing.assert_allclose(mesh.GetNormalsAttr().Get(), CUBE / np.sqrt(3), atol=1e-6)
    np.testing.assert_array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()), np.ravel(FACES))
    assert list(st.GetIndices()) == [0, 1, 2, 3] * 6
