"""What the check of a cage finds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.branch.cage.build import build_branch_cage, check_cage
from usdfoliage.branch.cage.check import check_mesh

from tests.support.branch_shapes import fork
from tests.support.cage_reference import crossing_quads

CUBE = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
CUBE_FACES = np.array([(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)], np.int32)
NONE = np.zeros(0, np.int32)


def test_a_cube_is_clean():
    check = check_mesh(CUBE, CUBE_FACES, NONE, NONE)
    assert check.clean
    assert check.components == 1


@pytest.mark.parametrize(
    ("points", "faces", "field"),
    [
        (CUBE, CUBE_FACES[1:], "open_edges"),
        (CUBE, np.concatenate([CUBE_FACES[:1, ::-1], CUBE_FACES[1:]]), "open_edges"),
        (CUBE, CUBE_FACES[:, ::-1], "inverted_components"),
        (np.concatenate([CUBE, [[5, 5, 5]]]), CUBE_FACES, "unused_vertices"),
        (CUBE * [1, 1, 0], CUBE_FACES, "degenerate_faces"),
        # A second cube that shares a corner with the first.
        (
            np.concatenate([CUBE, CUBE[1:] + 2]),
            np.concatenate([CUBE_FACES, np.array([7, *range(8, 15)], np.int32)[CUBE_FACES]]),
            "split_vertices",
        ),
    ],
)
def test_faults_are_found(points, faces, field):
    check = check_mesh(points, faces, NONE, NONE)
    assert getattr(check, field) > 0
    assert not check.clean


def test_a_branch_pushed_through_its_parent_is_found():
    cage = build_branch_cage(fork(60))
    assert check_cage(cage).fork_crossings == 0
    points = cage.points_m.copy()
    child = np.setdiff1d(np.unique(cage.faces[cage.curve == 1]), np.unique(cage.faces[cage.curve == 0]))
    points[child] -= [0.15, 0, 0]
    assert check_cage(replace(cage, points_m=points)).fork_crossings > 0


def crosses(one, two):
    """The same for two quads by the plain definition: an edge of a triangle goes through another."""

    def through(a, b, triangle):
        matrix = np.stack([a - b, triangle[1] - triangle[0], triangle[2] - triangle[0]], axis=1)
        t, u, v = np.linalg.solve(matrix, a - triangle[0])
        return 0 < t < 1 and u > 0 and v > 0 and u + v < 1

    split = ([0, 1, 2], [0, 2, 3])
    for first in split:
        for second in split:
            for mine, other in ((one[first], two[second]), (two[second], one[first])):
                if any(through(mine[k], mine[(k + 1) % 3], other) for k in range(3)):
                    return True
    return False


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_crossing_quads_are_those_of_the_definition(seed):
    points = np.random.default_rng(seed).normal(size=(8, 3))
    points[4:] += [0.7, 0, 0]
    faces = np.arange(8).reshape(2, 4)
    assert crossing_quads(points, faces, np.array([[0, 1]]))[0] == crosses(points[:4], points[4:])


def test_quads_that_share_a_vertex_do_not_count():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.8, 0.2, 1], [0.8, 0.2, -1], [0, 0, 1]], float)
    faces = np.array([[0, 1, 2, 3], [0, 4, 5, 6]])
    assert not crossing_quads(points, faces, np.array([[0, 1]]))[0]
