"""The crown's cage: its limit is the crown's surface, and what lies between looks where its texture is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.geometry.crown_cage import build_crown_cage, crown_limit
from usdfoliage.geometry.crown_mesh import build_crown_mesh
from usdfoliage.geometry.cubemap import face_directions, sample_cubemap, share_borders


@pytest.mark.parametrize("size", [3, 4, 9, 17])
def test_the_limit_of_every_vertex_of_a_sphere_is_on_it_at_the_three_valent_corners_too(size):
    center_m = np.array([1.0, 2.0, -3.0])
    cage = build_crown_cage(np.full((6, 33, 33), 1.5), center_m, size)
    points_m, quads = crown_limit(cage, 0)
    np.testing.assert_array_equal(quads, cage.face_vertices)
    np.testing.assert_allclose(np.linalg.norm(points_m - center_m, axis=1), 1.5, atol=2e-6)
    mesh = build_crown_mesh(np.full((6, 33, 33), 1.5), center_m, size)
    np.testing.assert_allclose(points_m, mesh.points_m, atol=2e-6)
    # The cage is outside the sphere, by as much as a mean of three of its edges cuts off.
    assert (np.linalg.norm(cage.points_m - center_m, axis=1) > 1.5).all()


def test_the_limit_between_the_vertices_of_a_sphere_is_as_good_as_on_it():
    off = []
    for size in (9, 17, 33):
        points_m, _ = crown_limit(build_crown_cage(np.ones((6, 65, 65)), np.zeros(3), size), 2)
        off.append(np.sqrt(np.mean((np.linalg.norm(points_m, axis=1) - 1) ** 2)))
    assert off[0] < 1e-4  # of the radius; the polygons of the same points are off by 8e-3
    assert off[0] / off[1] > 5
    assert off[1] / off[2] > 5


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), size=st.sampled_from([5, 9, 17]))
def test_the_limit_passes_through_any_crown_that_is_not_too_rough(seed, size):
    rng = np.random.default_rng(seed)
    radius_m = share_borders(1 + 0.04 * rng.random((6, size, size)))
    limit_m, _ = crown_limit(build_crown_cage(radius_m, np.zeros(3), size), 0)
    np.testing.assert_allclose(limit_m, build_crown_mesh(radius_m, np.zeros(3), size).points_m, atol=1e-5)


def test_no_vertex_is_moved_by_more_than_half_its_radius():
    x, y, z = np.moveaxis(np.sign(np.round(face_directions(5), 9)), -1, 0)
    radius_m = 1 + 0.9 * np.where((x + y + z) % 2 == 0, 1.0, -1.0)
    cage = build_crown_cage(radius_m, np.zeros(3), 5)
    mesh = build_crown_mesh(radius_m, np.zeros(3), 5)
    moved = np.linalg.norm(cage.points_m - mesh.points_m, axis=1) / np.linalg.norm(mesh.points_m, axis=1)
    assert 0.49 < moved.max() < 0.5 + 1e-6


def test_what_is_drawn_lies_where_its_texture_coordinates_look():
    """Along the edges and at the corners of the cube too: within a quarter of a texel."""
    size, texels = 17, 65
    directions = face_directions(65)
    radius_m = 1 / np.linalg.norm(directions / (1.5, 2.0, 1.0), axis=-1)
    cage = build_crown_cage(radius_m, np.zeros(3), size)
    points_m, quads = crown_limit(cage, 2)
    at = _refine_evenly(cage.st[cage.face_st].astype(np.float64), 2)  # (F, 25, 2)
    column, row = at[..., 0] * texels - 0.5, (1 - at[..., 1]) * 6 * texels - 0.5
    face = np.repeat(np.floor(((1 - at[..., 1]) * 6).mean(axis=1, keepdims=True)).astype(int), row.shape[1], axis=1)
    right, up = 2 * column / (texels - 1) - 1, 1 - 2 * (row - face * texels) / (texels - 1)
    looked = _directions(face, right, up)
    # Every place on the surface is found among the points of its own face: the nearest in direction.
    unit = points_m / np.linalg.norm(points_m, axis=1, keepdims=True)
    of_face = unit[quads.reshape(len(cage.face_vertices), 16, 4)].reshape(len(cage.face_vertices), 64, 3)
    apart = np.arccos(np.clip(np.einsum("fpk,fqk->fpq", looked, of_face).max(axis=2), -1, 1))
    texel = np.pi / 2 / (texels - 1)
    assert apart.max() < 0.25 * texel
    np.testing.assert_allclose(np.linalg.norm(points_m, axis=1), sample_cubemap(radius_m, unit), rtol=2e-3)


def _refine_evenly(corners, levels):
    """Places on quads (F, 4, 2), evenly spaced: (F, P, 2)."""
    t = np.linspace(0, 1, 2**levels + 1)
    a, b = (mixed.ravel() for mixed in np.meshgrid(t, t))
    weights = np.stack([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b], axis=1)
    return np.einsum("pk,fkc->fpc", weights, corners)


def _directions(face, right, up):
    """Unit vectors of places on the faces of OpenEXR's cube, +X -X +Y -Y +Z -Z."""
    one = np.ones_like(right)
    of_faces = [
        (one, up, right),
        (-one, up, -right),
        (right, one, up),
        (right, -one, -up),
        (-right, up, one),
        (right, up, -one),
    ]
    looked = np.choose(face[..., None], [np.stack(axes, axis=-1) for axes in of_faces])
    return looked / np.linalg.norm(looked, axis=-1, keepdims=True)


@pytest.mark.parametrize(("size", "center_m", "message"), [(2, np.zeros(3), "at least 3"), (5, np.zeros(2), r"\(3,\)")])
def test_what_is_no_cage_is_refused(size, center_m, message):
    with pytest.raises(ValueError, match=message):
        build_crown_cage(np.ones((6, 9, 9)), center_m, size)
