"""Catmull–Clark refinement of the extension, against closed forms and a plain reference."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage._native import refine_catmull_clark

CUBE_POINTS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
CUBE_FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def refine(points, faces, levels=1, *, creases=(), sharpness=(), corners=(), corner_sharpness=(), limit=False):
    mesh = refine_catmull_clark(
        np.asarray(points, np.float64),
        np.array([len(face) for face in faces], np.int32),
        np.array([i for face in faces for i in face], np.int32),
        crease_edges=np.array(creases, np.int32).reshape(-1, 2),
        crease_sharpness=np.array(sharpness, np.float32),
        corner_vertices=np.array(corners, np.int32),
        corner_sharpness=np.array(corner_sharpness, np.float32),
        levels=levels,
        limit=limit,
    )
    return mesh.points, mesh.normals, mesh.faces


def reference(points, faces, sharp=frozenset()):
    """One step by the rules of Catmull and Clark, creases and borders infinitely sharp, border corners kept."""
    points = np.asarray(points, np.float64)
    face_points = np.array([points[list(face)].mean(axis=0) for face in faces])
    edges = {}
    for f, face in enumerate(faces):
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            edges.setdefault((min(a, b), max(a, b)), []).append(f)
    is_sharp = {edge: len(touching) == 1 or edge in sharp for edge, touching in edges.items()}
    edge_points = {}
    for (a, b), touching in edges.items():
        middle = (points[a] + points[b]) / 2
        edge_points[a, b] = middle if is_sharp[a, b] else (2 * middle + face_points[touching].sum(axis=0)) / 4
    vertex_points = []
    for v, point in enumerate(points):
        around = [f for f, face in enumerate(faces) if v in face]
        own = [edge for edge in edges if v in edge]
        far = [points[a + b - v] for a, b in own]
        creased = [points[a + b - v] for a, b in own if is_sharp[a, b]]
        n = len(own)
        if len(creased) > 2 or len(around) == 1:
            vertex_points.append(point)
        elif len(creased) == 2:
            vertex_points.append((6 * point + creased[0] + creased[1]) / 8)
        else:
            ring = sum((point + other) / 2 for other in far) / n
            vertex_points.append((face_points[around].mean(axis=0) + 2 * ring + (n - 3) * point) / n)
    return np.concatenate([vertex_points, face_points, list(edge_points.values())])


def in_order(points):
    return points[np.lexsort(np.round(points, 9).T)]


def grid(rows, columns, heights):
    points = [(x, y, heights[y, x]) for y in range(rows + 1) for x in range(columns + 1)]
    faces = []
    for y in range(rows):
        for x in range(columns):
            a = y * (columns + 1) + x
            faces.append((a, a + 1, a + columns + 2, a + columns + 1))
    return points, faces


def test_cube_after_one_step():
    points, normals, quads = refine(CUBE_POINTS, CUBE_FACES)
    assert points.shape == (26, 3)
    assert quads.shape == (24, 4)
    assert normals.shape == (0, 3)
    np.testing.assert_allclose(in_order(points), in_order(reference(CUBE_POINTS, CUBE_FACES)), atol=1e-12)
    np.testing.assert_allclose(np.abs(points[np.abs(points).min(axis=1) > 0.1]), 5 / 9, atol=1e-12)  # the old corners


def test_two_steps_are_the_step_of_a_step():
    points, _, quads = refine(CUBE_POINTS, CUBE_FACES)
    twice, _, quads_twice = refine(CUBE_POINTS, CUBE_FACES, 2)
    np.testing.assert_allclose(in_order(twice), in_order(reference(points, [tuple(q) for q in quads])), atol=1e-12)
    assert len(quads_twice) == 4 * len(quads)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), rows=st.integers(1, 3), columns=st.integers(1, 3))
def test_a_surface_with_a_border_follows_the_rules(seed, rows, columns):
    points, faces = grid(rows, columns, np.random.default_rng(seed).normal(size=(rows + 1, columns + 1)))
    refined, _, quads = refine(points, faces)
    np.testing.assert_allclose(in_order(refined), in_order(reference(points, faces)), atol=1e-12)
    assert len(quads) == 4 * rows * columns


@pytest.mark.parametrize("edges", [[(0, 1), (1, 3), (3, 2), (2, 0)], [(0, 1)], [(0, 1), (1, 3), (1, 5)]])
def test_creases_follow_the_rules(edges):
    refined, _, _ = refine(CUBE_POINTS, CUBE_FACES, creases=edges, sharpness=[10.0] * len(edges))
    sharp = {(min(e), max(e)) for e in edges}
    np.testing.assert_allclose(in_order(refined), in_order(reference(CUBE_POINTS, CUBE_FACES, sharp)), atol=1e-12)


def test_a_sharp_corner_stays():
    refined, _, _ = refine(CUBE_POINTS, CUBE_FACES, 3, corners=[7], corner_sharpness=[10.0], limit=True)
    assert np.linalg.norm(refined - CUBE_POINTS[7], axis=1).min() < 1e-12
    assert np.linalg.norm(refined - CUBE_POINTS[0], axis=1).min() > 0.5


def test_a_flat_grid_stays_flat_and_keeps_its_border():
    points, faces = grid(3, 4, np.zeros((4, 5)))
    refined, normals, _ = refine(points, faces, 3, limit=True)
    np.testing.assert_allclose(refined[:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(normals, np.tile((0, 0, 1), (len(normals), 1)), atol=1e-12)
    np.testing.assert_allclose(refined.min(axis=0), (0, 0, 0), atol=1e-12)
    np.testing.assert_allclose(refined.max(axis=0), (4, 3, 0), atol=1e-12)


def test_the_limit_of_a_cube_is_nearly_a_sphere():
    points, normals, quads = refine(CUBE_POINTS, CUBE_FACES, 4, limit=True)
    radius = np.linalg.norm(points, axis=1)
    assert np.ptp(radius) / radius.mean() < 0.1
    assert (np.sum(points / radius[:, None] * normals, axis=1) > 0.97).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)
    # A corner's limit is (n² v + 4 Σ edges + Σ faces) / (n (n + 5)) of the cage.
    corner = (9 * CUBE_POINTS[7] + 4 * CUBE_POINTS[[3, 5, 6]].sum(axis=0) + CUBE_POINTS[[1, 2, 4]].sum(axis=0)) / 24
    assert np.linalg.norm(points - corner, axis=1).min() < 1e-12
    # Every edge is shared by two quads, which run along it in opposite directions.
    directed = {(a, b) for q in quads.tolist() for a, b in zip(q, q[1:] + q[:1], strict=True)}
    assert all((b, a) in directed for a, b in directed)


def test_the_limit_of_a_fine_sphere_is_the_sphere():
    unit = CUBE_POINTS / np.sqrt(3)
    points, _, quads = refine(unit, CUBE_FACES, 4)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    limit, normals, _ = refine(points, [tuple(q) for q in quads], 1, limit=True)
    radius = np.linalg.norm(limit, axis=1)
    np.testing.assert_allclose(radius, 1, atol=5e-3)
    assert (np.sum(limit / radius[:, None] * normals, axis=1) > 0.999).all()


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000))
def test_refinement_moves_with_the_cage(seed):
    rng = np.random.default_rng(seed)
    linear, offset = rng.normal(size=(3, 3)), rng.normal(size=3)
    points, _, _ = refine(CUBE_POINTS, CUBE_FACES, 2, limit=True)
    moved, _, _ = refine(CUBE_POINTS @ linear.T + offset, CUBE_FACES, 2, limit=True)
    np.testing.assert_allclose(moved, points @ linear.T + offset, atol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"faces": [(0, 1, 8)]}, "face index 8 of 8 points"),
        ({"faces": [(0, 1, -1)]}, "face index -1"),
        ({"faces": [(0, 1)]}, "fewer than 3"),
        ({"faces": CUBE_FACES, "creases": [(0, 9)], "sharpness": [1.0]}, "crease index 9"),
        ({"faces": CUBE_FACES, "corners": [-2], "corner_sharpness": [1.0]}, "corner index -2"),
    ],
)
def test_a_wrong_topology_is_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        refine(CUBE_POINTS, **wrong)


def test_counts_that_do_not_fit_the_indices_are_refused():
    none = np.zeros(0, np.int32)
    with pytest.raises(ValueError, match="sum to 4, indices are 3"):
        refine_catmull_clark(
            CUBE_POINTS,
            np.array([4], np.int32),
            np.arange(3, dtype=np.int32),
            crease_edges=none.reshape(0, 2),
            crease_sharpness=none.astype(np.float32),
            corner_vertices=none,
            corner_sharpness=none.astype(np.float32),
            levels=1,
            limit=False,
        )


def test_threads_do_not_disturb_each_other():
    expected = refine(CUBE_POINTS, CUBE_FACES, 4, limit=True)
    with ThreadPoolExecutor(4) as pool:
        for result in pool.map(lambda _: refine(CUBE_POINTS, CUBE_FACES, 4, limit=True), range(8)):
            for array, same in zip(result, expected, strict=True):
                np.testing.assert_array_equal(array, same)
