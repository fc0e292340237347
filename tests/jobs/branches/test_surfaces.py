"""The surface of branches by the faces that it may have."""

import numpy as np
from scipy.spatial import cKDTree
from usdfoliage.branch.distances import place_on_axes
from usdfoliage.geometry.smooth_mesh import refine_smooth
from usdfoliage.jobs.branches.surfaces import MIN_FACES, build_surfaces, faces_of_cloud

from tests.support.branch_shapes import plant_of


def test_a_stem_that_takes_few_faces_is_drawn_finely():
    """It winds by a tenth of its radius: no ring is needed for that, but there is room for many."""
    height_m = np.linspace(0, 4, 81)
    axis_m = np.stack([0.03 * np.sin(2 * height_m), height_m, 0 * height_m], axis=1)
    stem = plant_of((axis_m, np.linspace(0.3, 0.2, 81), None, 0))
    places = place_on_axes(stem, 0.01)
    off_m = []
    for max_faces in (30, MIN_FACES):
        made = build_surfaces(stem, max_faces)
        cage = made.surfaces.whole
        assert len(cage.faces) <= MIN_FACES
        surface_m = refine_smooth(cage.points_m, cage.faces, 3)[0]
        beside = (surface_m[:, 1] > 0.5) & (surface_m[:, 1] < 3.5)
        away_m, nearest = cKDTree(places.points_m).query(surface_m[beside])
        off_m.append(float(np.abs(away_m - places.radius_m[nearest]).mean()))
    assert off_m[1] < 0.001 < 0.004 < off_m[0]


def test_how_many_faces_a_cloud_gives():
    assert [faces_of_cloud(points) for points in (10, 5000, 20_000, 10**6)] == [30_000, 30_000, 120_000, 400_000]
