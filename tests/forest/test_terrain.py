"""The ground: holes, slopes, meshes."""

import numpy as np
import pytest
from usdfoliage.errors import CaptureError
from usdfoliage.forest.raster import Raster
from usdfoliage.forest.terrain import close_holes, ground_height, is_known, make_terrain, mesh_terrain, slope_deg

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
