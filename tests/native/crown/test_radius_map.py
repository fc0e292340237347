"""The native rays against Möller and Trumbore's intersection, written plainly."""

import numpy as np
import pytest
from usdfoliage import _native
from usdfoliage.geometry.cubemap import face_directions


def farthest_hits(points, triangles, directions):
    best = np.zeros(directions.shape[:-1])
    for triangle in triangles:
        origin, first, second = points[triangle[0]], *(points[triangle[1:]] - points[triangle[0]])
        p = np.cross(directions, second)
        determinant = p @ first
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (p @ -origin) / determinant
            q = np.cross(-origin, first)
            v = directions @ q / determinant
            t = (second @ q) / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & np.isfinite(t)
        best = np.where(hit, np.maximum(best, t), best)
    return best


@pytest.mark.parametrize("seed", range(5))
def test_random_triangles(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(60, 3))
    triangles = rng.integers(0, 60, size=(40, 3)).astype(np.int32)
    triangles = triangles[[len(set(t)) == 3 for t in triangles.tolist()]]

    radius, triangle = _native.radius_map(points, triangles, 24, 2)

    expected = farthest_hits(points, triangles, face_directions(24))
    assert radius == pytest.approx(expected, rel=1e-9)
    assert np.array_equal(triangle >= 0, expected > 0)


def test_the_triangle_that_is_met_is_named():
    points = np.array([[1.0, -1, -1], [1, 1, -1], [1, 0, 2], [2, -2, -2], [2, 2, -2], [2, 0, 4]])
    _, triangle = _native.radius_map(points, np.array([[0, 1, 2], [3, 4, 5]], np.int32), 9, 1)

    assert set(triangle[0].ravel().tolist()) <= {-1, 1}
    assert (triangle[1] == -1).all()
