"""Meshes of leaves: every vertex on its leaf, sound topology, a clean silhouette."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.mesh import (
    LeafMeshSettings,
    PrototypeSettings,
    build_leaf_mesh,
    build_prototype,
)
from usdfoliage.leaf.shape.surface import evaluate_grid
from usdfoliage.leaf.shape.topology import leaf_topology
from usdfoliage.leaf.shape.variation import VariationSettings, default_leaf, vary_leaves

FLAT = np.array(
    [[0, 1 / 3, 0], [0, 2 / 3, 0], [0.2, 0.2, 0], [0.5, 0.3, 0], [0.8, 0.2, 0], [0, 0, 0], [0, 0, 0]], np.float64
)
TEETH = Jitter(amplitude=0.03, frequency=8)


def placed(parameters, rng=None):
    """Leaves of unit length at the origin, or anywhere."""
    n = len(parameters)
    turn = np.tile([0.0, 0, 0, 1], (n, 1)) if rng is None else rng.normal(size=(n, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    return Leaves(
        parameters=np.asarray(parameters),
        base_m=np.zeros((n, 3)) if rng is None else rng.uniform(-1, 1, (n, 3)),
        orientation=turn,
        length_m=np.ones(n) if rng is None else rng.uniform(0.05, 0.1, n),
        phase=np.arange(n) * 0.7,
    )


def triangles(mesh):
    starts = np.cumsum(mesh.face_counts) - mesh.face_counts
    return np.array(
        [
            (mesh.face_vertices[s], mesh.face_vertices[s + k], mesh.face_vertices[s + k + 1])
            for s, n in zip(starts.tolist(), mesh.face_counts.tolist(), strict=True)
            for k in range(1, n - 1)
        ]
    )


def area_vectors(mesh):
    a, b, c = (mesh.points_m[triangles(mesh)[:, k]].astype(np.float64) for k in range(3))
    return np.cross(b - a, c - a) / 2


def covered(mesh, pixels_a_length=2000):
    """What the mesh covers seen from above, as pixels."""
    image = np.zeros((pixels_a_length + 80, pixels_a_length + 80), np.uint8)
    place = (mesh.points_m[:, :2] + (0.5, 0)) * pixels_a_length + 40
    for corners in np.rint(place * 16).astype(np.int32)[triangles(mesh)]:
        cv2.fillConvexPoly(image, corners, 1, shift=4)
    return image > 0


@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("numbers", [(4, 2, 2), (6, 16, 128), (8, 16, 17), (8, 16, 32), (10, 5, 64), (4, 5, 10)])
def test_a_leaf_is_one_disc_without_t_junctions(numbers, even):
    topology = leaf_topology(*numbers, even)
    edges = {}
    starts = np.cumsum(topology.face_counts) - topology.face_counts
    for start, count in zip(starts, topology.face_counts, strict=True):
        face = topology.face_vertices[start : start + count].tolist()
        assert len(set(face)) == count >= 3
        for edge in zip(face, face[1:] + face[:1], strict=True):
            assert edge not in edges  # each is run through once in either direction
            edges[edge] = True
    border = [edge for edge in edges if edge[::-1] not in edges]
    across, along, silhouette = numbers
    assert len(border) == 2 * silhouette
    assert {vertex for edge in border for vertex in edge} == set(np.flatnonzero(on_border(topology)))
    undirected = len(border) + (len(edges) - len(border)) // 2
    assert topology.vertex_count - undirected + len(topology.face_counts) == 1  # Euler's number of a disc
    assert topology.vertex_count == 2 + (across - 1) * (along - 1) + 2 * (silhouette - 1)


def on_border(topology):
    s, v = topology.st.T
    return (s == 0) | (s == 1) | (v == 0) | (v == 1)


@pytest.mark.parametrize("numbers", [(5, 16, 16), (2, 16, 16), (6, 1, 8), (6, 16, 15)])
def test_impossible_divisions_are_refused(numbers):
    across, along, silhouette = numbers
    with pytest.raises(ValueError, match="must be"):
        PrototypeSettings(across=across, along=along, silhouette=silhouette)
    with pytest.raises(ValueError, match="must be"):
        LeafMeshSettings(across=across, along=along, silhouette=silhouette)


def test_a_flat_leaf_faces_up_and_its_area_is_the_integral_of_its_width():
    mesh = build_leaf_mesh(placed(FLAT[None]), LeafMeshSettings(across=8, along=64, silhouette=512))
    vectors = area_vectors(mesh)
    assert (vectors[:, 2] > 0).all()
    np.testing.assert_allclose(mesh.normals, np.tile([0, 0, 1], (len(mesh.normals), 1)), atol=1e-6)
    v = np.linspace(0, 1, 20001)
    b = np.stack([(1 - v) ** 4, 4 * (1 - v) ** 3 * v, 6 * (1 - v) ** 2 * v**2, 4 * (1 - v) * v**3, v**4])
    x, y = np.array([0, 0.2, 0.3, 0.2, 0]) @ b, np.array([0, 0.2, 0.5, 0.8, 1]) @ b
    assert vectors[:, 2].sum() == pytest.approx(2 * np.trapezoid(x, y), rel=2e-5)


@pytest.mark.parametrize("jitter", [Jitter(), TEETH])
def test_vertices_and_normals_are_those_of_the_surface(jitter):
    rng = np.random.default_rng(1)
    leaves = placed(vary_leaves(5, rng), rng)
    mesh = build_leaf_mesh(leaves, LeafMeshSettings(across=6, along=8), jitter)
    per_leaf = len(mesh.points_m) // 5
    for leaf, matrix in enumerate(leaves.asset_from_leaf()):
        one = slice(leaf * per_leaf, (leaf + 1) * per_leaf)
        u, v = 2 * mesh.st[one, 0].astype(np.float64) - 1, mesh.st[one, 1].astype(np.float64)
        for vertex in range(0, per_leaf, 7):
            grid = evaluate_grid(
                leaves.parameters[leaf : leaf + 1], u[[vertex]], v[[vertex]], jitter, leaves.phase[[leaf]]
            )
            expected = matrix[:, :3] @ grid.points[0, 0, 0] + matrix[:, 3]
            np.testing.assert_allclose(mesh.points_m[one][vertex], expected, atol=2e-7)
            if u[vertex] and 0 < v[vertex] < 1:
                normal = matrix[:, :3] @ grid.normals[0, 0, 0] / leaves.length_m[leaf]
                np.testing.assert_allclose(mesh.normals[one][vertex], normal, atol=2e-5)


def test_the_normal_on_the_axis_lies_between_the_halves():
    leaf = FLAT.copy()
    leaf[5] = 0.03, 0.05, 0.03  # both halves rise from the axis
    mesh = build_prototype(leaf)
    on_axis = (mesh.st[:, 0] == 0.5) & (mesh.st[:, 1] > 0) & (mesh.st[:, 1] < 1)
    np.testing.assert_allclose(mesh.normals[on_axis][:, 0], 0, atol=1e-6)
    beside = evaluate_grid(leaf[None], np.array([1e-6]), np.array([0.5])).normals[0, 0, 0]
    assert beside[0] < -0.2


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), amount=st.floats(0, 3), amplitude=st.sampled_from([0.0, 0.03]))
def test_any_leaf_gives_a_sound_mesh(seed, amount, amplitude):
    rng = np.random.default_rng(seed)
    leaves = placed(vary_leaves(3, rng, VariationSettings(amount=amount)), rng)
    mesh = build_leaf_mesh(leaves, LeafMeshSettings(across=6, along=8), Jitter(amplitude=amplitude, frequency=5))
    for array in (mesh.points_m, mesh.normals, mesh.st):
        assert array.dtype == np.float32
        assert np.isfinite(array).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    assert mesh.face_vertices.max() == len(mesh.points_m) - 1
    np.testing.assert_allclose(mesh.points_m[:: len(mesh.points_m) // 3], leaves.base_m, atol=1e-6)
    areas = np.linalg.norm(area_vectors(mesh), axis=1)
    assert areas.min() > 1e-9 * areas.max()


@pytest.mark.parametrize("jitter", [Jitter(), TEETH])
@pytest.mark.parametrize("amount", [0, 3])
def test_the_prototype_covers_what_the_leaf_covers(jitter, amount):
    leaves = placed(vary_leaves(1, np.random.default_rng(4), VariationSettings(amount=amount)))
    prototype = PrototypeSettings()
    drawn = LeafMeshSettings(across=prototype.across, along=prototype.along, silhouette=prototype.silhouette)
    fine = covered(build_leaf_mesh(leaves, LeafMeshSettings(across=16, along=64, silhouette=2048), jitter))
    coarse = covered(build_leaf_mesh(leaves, drawn, jitter))
    assert (fine & coarse).sum() / (fine | coarse).sum() > 0.998


def test_the_prototype_is_the_leaf_in_leaf_space():
    mesh = build_prototype(default_leaf())
    assert (mesh.face_counts - 2).sum() < 410  # triangles, drawn for every leaf
    np.testing.assert_array_equal(mesh.points_m[:2], [[0, 0, 0], [0, 1, 0]])
    at = np.flatnonzero(mesh.st[:, 0] == 1)[10]
    grid = evaluate_grid(default_leaf()[None], np.array([1.0]), mesh.st[[at], 1].astype(np.float64))
    np.testing.assert_allclose(mesh.points_m[at], grid.points[0, 0, 0], atol=1e-6)
    with pytest.raises(ValueError, match="must be"):
        build_prototype(default_leaf()[:6])


def test_jitter_gets_the_segments_it_needs():
    def segments(jitter, **numbers):
        mesh = build_leaf_mesh(placed(FLAT[None]), LeafMeshSettings(across=4, along=4, **numbers), jitter)
        return (mesh.st[:, 0] == 0).sum() + 1

    assert segments(Jitter()) == 8
    assert segments(TEETH) == 128
    assert segments(Jitter(amplitude=0.03, frequency=20.3)) == 325
    assert segments(Jitter(amplitude=0.03, frequency=3, map=np.sin(np.arange(10.0)))) == 60
    assert segments(TEETH, silhouette=16) == 16


def test_no_leaves_are_an_empty_mesh():
    mesh = build_leaf_mesh(placed(np.zeros((0, 7, 3))))
    assert mesh.points_m.shape == mesh.normals.shape == (0, 3)
    assert mesh.st.shape == (0, 2)
    assert len(mesh.face_counts) == len(mesh.face_vertices) == 0


def test_more_than_a_mesh_can_number_is_refused():
    many = np.broadcast_to(FLAT, (20_000_000, 7, 3))
    ones = np.broadcast_to(np.float64(1), (20_000_000, 4))
    leaves = Leaves(parameters=many, base_m=ones[:, :3], orientation=ones, length_m=ones[:, 0], phase=ones[:, 0])
    with pytest.raises(AssetError, match="20000000 leaves of 169 vertices"):
        build_leaf_mesh(leaves)
