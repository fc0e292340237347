"""The ground: holes, slopes, meshes."""

import numpy as np
import pytest
from usdfoliage.errors import CaptureError
from usdfoliage.forest.raster import Raster, to_ground, upright_grid
from usdfoliage.forest.terrain import (
    close_holes,
    ground_height,
    is_known,
    make_terrain,
    mesh_height,
    mesh_terrain,
    slope_deg,
)

from tests.support.forests.scene import forest_scene, frame


def plane(size: int = 24) -> np.ndarray:
    row, column = np.mgrid[:size, :size]
    return 100 + 0.3 * column - 0.2 * row


def test_a_hole_in_a_plane_is_closed_by_the_plane():
    values = plane()
    holed = values.copy()
    holed[5:14, 8:17] = np.nan
    np.testing.assert_allclose(close_holes(holed), values, atol=1e-8)


def test_a_hole_at_the_border_takes_what_is_beside_it():
    values = np.full((6, 6), 7.0)
    values[:3] = np.nan
    np.testing.assert_allclose(close_holes(values), 7.0)


def test_what_has_no_height_is_known():
    values = plane()
    values[:, :6] = np.nan
    terrain = make_terrain(Raster(values=values, ground_from_pixel=frame()))
    assert terrain.hole_share == 0.25
    places = np.array([[455_001.0, 4_659_990.0], [455_008.0, 4_659_990.0]])
    assert is_known(terrain, places).tolist() == [False, True]


@pytest.mark.parametrize("values", [np.zeros((1, 5)), np.full((8, 8), np.nan), np.zeros((4, 4, 3))])
def test_what_is_no_ground_is_refused(values):
    with pytest.raises(CaptureError):
        make_terrain(Raster(values=values, ground_from_pixel=frame()))


def test_slopes_are_those_of_the_plane():
    terrain = make_terrain(Raster(values=plane(), ground_from_pixel=frame()))
    steep = np.degrees(np.arctan(np.hypot(0.3, 0.2) / 0.5))
    np.testing.assert_allclose(slope_deg(terrain).values, steep)


@pytest.mark.parametrize("max_quads", [1, 50, 10_000])
def test_a_mesh_lies_on_the_ground_and_is_seen_from_above(max_quads):
    terrain = make_terrain(forest_scene().dem)
    mesh = mesh_terrain(terrain, max_quads)
    assert 1 <= len(mesh.faces) <= max(max_quads, 1)
    np.testing.assert_allclose(mesh.places_m[:, 2], ground_height(terrain, mesh.places_m[:, :2]))
    corners = mesh.places_m[mesh.faces]
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])[:, 2]
    assert (up > 0).all()
    assert (mesh.st >= 0).all()
    assert (mesh.st <= 1).all()
    north = np.argmax(mesh.places_m[:, 1])
    assert mesh.st[north, 1] > 0.9


@pytest.mark.parametrize("north", [-1.0, 1.0])
@pytest.mark.parametrize("max_quads", [10_000, 60])
def test_heights_of_the_mesh_are_those_of_its_triangles(north, max_quads):
    rng = np.random.default_rng(0)
    raster = Raster(
        values=rng.random((14, 20)), ground_from_pixel=np.array([[2.0, 0.3, 100.0], [0.2, north * 2.0, 50]])
    )
    terrain = make_terrain(raster)
    mesh = mesh_terrain(terrain, max_quads)
    assert mesh.shape[0] * mesh.shape[1] == len(mesh.places_m)
    for corners in ([0, 1, 2], [0, 2, 3]):
        weight = rng.dirichlet(np.ones(3), len(mesh.faces))
        places = (weight[:, :, None] * mesh.places_m[mesh.faces[:, corners]]).sum(axis=1)
        np.testing.assert_allclose(mesh_height(mesh, terrain, places[:, :2]), places[:, 2], atol=1e-9)
    np.testing.assert_allclose(mesh_height(mesh, terrain, mesh.places_m[:, :2]), mesh.places_m[:, 2], atol=1e-9)
    beyond = np.array([[-1.0, 5.0], [21.0, 5.0], [5.0, -1.0], [5.0, 15.0]])
    assert np.isnan(mesh_height(mesh, terrain, to_ground(raster, beyond))).all()


@pytest.mark.parametrize("matrix", [[[1.5, 0.8, 100.0], [0.6, -1.6, 50]], [[0.0, 2.0, 100.0], [2.0, 0.0, 50]]])
def test_texture_coordinates_of_a_turned_ground_go_east_and_north(matrix):
    raster = Raster(values=np.zeros((14, 20)), ground_from_pixel=np.array(matrix))
    mesh = mesh_terrain(make_terrain(raster), 10_000)
    pictured = upright_grid(raster)
    height, width = pictured.values.shape
    corner_m, cell_m = pictured.ground_from_pixel[:, 2], np.abs(np.diag(pictured.ground_from_pixel))
    low_m = corner_m - [0, height * cell_m[1]]
    np.testing.assert_allclose(mesh.st, (mesh.places_m[:, :2] - low_m) / ([width, height] * cell_m), atol=1e-12)
    assert (mesh.st.min(axis=0) > 0).all()
    assert (mesh.st.max(axis=0) < 1).all()
