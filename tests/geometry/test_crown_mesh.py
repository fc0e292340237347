"""The crown's surface against closed forms: sphere, ellipsoid, and what every closed surface must be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.geometry.crown_mesh import build_crown_mesh
from usdfoliage.geometry.cubemap import face_directions, sample_cubemap, share_borders


def sphere(size, radius_m=1.0):
    return np.full((6, size, size), radius_m, np.float32)


def ellipsoid(size, axes_m):
    return 1.0 / np.linalg.norm(face_directions(size) / np.asarray(axes_m), axis=-1)


def signed_volume(mesh):
    p = mesh.points_m.astype(np.float64)
    a, b, c, d = (p[mesh.face_vertices[:, k]] for k in range(4))
    return (np.einsum("ij,ij->", a, np.cross(b, c)) + np.einsum("ij,ij->", a, np.cross(c, d))) / 6


@pytest.mark.parametrize("size", [2, 3, 9, 16])
def test_surface_is_closed_and_consistently_turned(size):
    mesh = build_crown_mesh(sphere(16), np.zeros(3), size)
    assert len(mesh.points_m) == 6 * (size - 1) ** 2 + 2
    assert len(mesh.face_vertices) == 6 * (size - 1) ** 2
    assert set(mesh.face_vertices.ravel()) == set(range(len(mesh.points_m)))
    quads = mesh.face_vertices
    directed = [tuple(edge) for k in range(4) for edge in np.stack([quads[:, k], quads[:, (k + 1) % 4]], 1).tolist()]
    assert len(set(directed)) == len(directed)  # no edge twice in the same order
    assert {(b, a) for a, b in directed} == set(directed)  # each one in the opposite order too
    assert len(mesh.points_m) - len(directed) // 2 + len(quads) == 2  # Euler


def test_sphere_has_its_radius_and_volume():
    center_m = np.array([1.0, 2.0, -3.0])
    mesh = build_crown_mesh(sphere(32, 1.5), center_m, 33)
    out = mesh.points_m - center_m
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.5, rtol=1e-6)
    assert signed_volume(build_crown_mesh(sphere(32, 1.5), np.zeros(3), 33)) == pytest.approx(
        4 / 3 * np.pi * 1.5**3, rel=5e-3
    )


def test_odd_size_reaches_the_poles_exactly():
    mesh = build_crown_mesh(sphere(32, 1.5), np.zeros(3), 17)
    np.testing.assert_allclose(mesh.points_m.max(axis=0), 1.5, rtol=1e-6)
    np.testing.assert_allclose(mesh.points_m.min(axis=0), -1.5, rtol=1e-6)


@settings(max_examples=15, deadline=None)
@given(axes_m=st.tuples(*[st.floats(0.5, 3.0)] * 3))
def test_ellipsoid_has_its_volume_and_lies_on_its_equation(axes_m):
    mesh = build_crown_mesh(ellipsoid(65, axes_m), np.zeros(3), 33)
    assert np.abs(np.linalg.norm(mesh.points_m / np.asarray(axes_m), axis=1) - 1).max() < 1e-5
    assert signed_volume(mesh) == pytest.approx(4 / 3 * np.pi * np.prod(axes_m), rel=0.02)


@pytest.mark.parametrize("size", [5, 9, 17])
def test_st_of_a_corner_is_the_texel_it_looks_at(size):
    n = 17
    names = np.arange(6 * n * n, dtype=np.float64).reshape(6, n, n)  # every texel another value
    mesh = build_crown_mesh(sphere(n), np.zeros(3), size)  # (n − 1) is a multiple of (size − 1): on texels
    s, t = mesh.st[mesh.face_st.ravel()].astype(np.float64).T
    column, row = s * n - 0.5, (1 - t) * 6 * n - 0.5
    np.testing.assert_allclose(column, np.rint(column), atol=1e-4)
    np.testing.assert_allclose(row, np.rint(row), atol=1e-3)
    directions = face_directions(n).reshape(6 * n, n, 3)[np.rint(row).astype(int), np.rint(column).astype(int)]
    np.testing.assert_allclose(directions, mesh.points_m[mesh.face_vertices.ravel()], atol=1e-6)
    shared = share_borders(names)
    colors = shared.reshape(6 * n, n)[np.rint(row).astype(int), np.rint(column).astype(int)]
    np.testing.assert_allclose(colors, sample_cubemap(shared, directions), atol=1e-6)


def test_corners_of_a_quad_stay_on_one_face_of_the_strip():
    mesh = build_crown_mesh(sphere(8), np.zeros(3), 5)
    faces = np.floor((1 - mesh.st[mesh.face_st][..., 1]) * 6)
    assert (faces == faces[:, :1]).all()
    assert np.bincount(faces[:, 0].astype(int)).tolist() == [16] * 6


def test_coarse_mesh_samples_the_map():
    rng = np.random.default_rng(0)
    radius_m = share_borders(1 + 0.2 * rng.random((6, 33, 33)).astype(np.float32))
    fine, coarse = (build_crown_mesh(radius_m, np.zeros(3), size) for size in (33, 9))
    fine_points = {tuple(p) for p in np.rint(fine.points_m * 1e5).astype(int).tolist()}
    assert {tuple(p) for p in np.rint(coarse.points_m * 1e5).astype(int).tolist()} <= fine_points


@pytest.mark.parametrize(
    ("radius_m", "center_m", "size", "message"),
    [
        (np.ones((5, 4, 4)), np.zeros(3), 4, r"\(6, N, N\)"),
        (np.ones((6, 4, 5)), np.zeros(3), 4, r"\(6, N, N\)"),
        (np.ones((6, 4, 4)), np.zeros(2), 4, r"\(3,\)"),
        (np.zeros((6, 4, 4)), np.zeros(3), 4, "positive"),
        (np.full((6, 4, 4), np.nan), np.zeros(3), 4, "finite"),
        (np.ones((6, 4, 4)), np.zeros(3), 1, "at least 2"),
    ],
)
def test_what_is_no_crown_is_refused(radius_m, center_m, size, message):
    with pytest.raises(ValueError, match=message):
        build_crown_mesh(radius_m, center_m, size)
