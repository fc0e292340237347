"""The heights of meshes whose surface is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from usdfoliage.errors import CaptureError
from usdfoliage.forest.ground_frame import GroundFrame, frame_ground
from usdfoliage.forest.ground_settings import GroundSettings
from usdfoliage.forest.mesh_heights import mesh_heights, spacing_of_mesh
from usdfoliage.forest.raster import Raster, pixel_grid

from tests.support.forests.ground import grid_quads

EAST_M, NORTH_M = 455_000.0, 4_660_000.0
ORIGIN_M = np.array([EAST_M, NORTH_M])


def plane(places):
    return 300 + 0.3 * (places[..., 0] - EAST_M) - 0.2 * (places[..., 1] - NORTH_M)


def places_of(frame: GroundFrame) -> np.ndarray:
    empty = Raster(values=np.zeros((frame.rows, frame.columns)), ground_from_pixel=frame.ground_from_pixel)
    return pixel_grid(empty)


def triangles_of(quads):
    return np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


@given(seed=st.integers(0, 50), cell=st.floats(0.05, 3))
def test_a_tilted_plane_keeps_its_heights_and_has_no_seams(seed, cell):
    rng = np.random.default_rng(seed)
    corners = [[0, 0], [20, 0], [0, 12], [20, 12]]
    plan = np.concatenate([corners, rng.uniform(0, 1, (60, 2)) * [20, 12]]) + ORIGIN_M
    triangles = Delaunay(plan - plan[0]).simplices.astype(np.int64)
    triangles[::2] = triangles[::2, ::-1]  # faces may be turned either way
    frame = frame_ground(plan.min(axis=0), plan.max(axis=0), cell, "the DEM", whole=False)
    heights = mesh_heights(np.column_stack([plan, plane(plan)]), triangles, frame)
    np.testing.assert_allclose(heights, plane(places_of(frame)), atol=1e-5)


def test_a_grid_has_a_pixel_a_point_with_its_height():
    rng = np.random.default_rng(0)
    row, column = np.mgrid[:260, :300]
    plan = np.stack([EAST_M + 0.5 * column, NORTH_M - 0.5 * row], axis=-1)
    heights = rng.uniform(0, 50, (260, 300))
    points = np.concatenate([plan, heights[..., None]], axis=-1).reshape(-1, 3)
    triangles = triangles_of(grid_quads(260, 300))
    assert spacing_of_mesh(points, triangles) == pytest.approx(0.5)
    frame = frame_ground(points[:, :2].min(axis=0), points[:, :2].max(axis=0), 0.5, "the DEM", whole=False)
    np.testing.assert_allclose(mesh_heights(points, triangles, frame), heights, atol=1e-6)
    np.testing.assert_allclose(places_of(frame), plan, atol=1e-6)


def test_a_hole_stays_and_of_two_surfaces_the_upper_one_is_taken():
    outer = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], float)
    inner = np.array([[4, 4], [6, 4], [6, 6], [4, 6]], float)
    points = np.column_stack([np.concatenate([outer, inner]), np.full(8, 5.0)])
    ring = [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    below = [[8, 9, 10], [8, 10, 11]]
    points = np.concatenate([points, [[0, 0, 1], [3, 0, 1], [3, 10, 1], [0, 10, 1]]])
    wall = [[0, 1, 8]]  # it stands upright
    triangles = np.array([*triangles_of(np.array(ring)), *below, *wall])
    frame = frame_ground(np.zeros(2), np.full(2, 10.0), 0.5, "the DEM", whole=False)
    heights = mesh_heights(points, triangles, frame)
    hole = (np.abs(places_of(frame) - 5) < 0.99).all(axis=-1)
    assert np.isnan(heights[hole]).all()
    np.testing.assert_allclose(heights[~hole], 5.0, atol=1e-9)


def test_a_face_a_hair_wide_and_very_steep_keeps_between_its_ends():
    points = np.array([[0, 0, 0], [10, 0, 0], [10, 1e-9, 500.0]])
    frame = frame_ground(np.zeros(2), np.array([10.0, 1.0]), 0.5, "the DEM", whole=False)
    heights = mesh_heights(points, np.array([[0, 1, 2]]), frame)
    known = heights[np.isfinite(heights)]
    assert ((known >= 0) & (known <= 500)).all()


def test_a_coarse_mesh_has_200_pixels_along_its_longer_side():
    points = np.array([[0, 0, 0], [100, 0, 0], [100, 50, 9], [0, 50, 9.0]])
    assert spacing_of_mesh(points, np.array([[0, 1, 2], [0, 2, 3]])) == pytest.approx(0.5)


def test_too_many_pixels_are_refused():
    with pytest.raises(CaptureError, match=r"a\.obj is 1e\+06 x 10 units wide.* 400,000,000 in all"):
        frame_ground(np.zeros(2), np.array([1e6, 10.0]), 1e-4, "the DEM a.obj", whole=False)
    with pytest.raises(CaptureError, match="units wide"):
        frame_ground(np.zeros(2), np.full(2, 1e300), 1e-300, "the DEM a.obj", whole=False)


@pytest.mark.parametrize("spacing_m", [0.0, -1.0, np.nan, np.inf])
def test_a_spacing_that_is_no_length_is_refused(spacing_m):
    with pytest.raises(ValueError, match="ground_spacing"):
        GroundSettings(spacing_m=spacing_m)
