"""The radius of a captured crown: the truth of closed forms, outliers, silhouettes, gaps."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from usdfoliage.crown.hull import HullSettings, carve_radius, fit_crown_hull, outermost_points
from usdfoliage.crown.views import reduce_view
from usdfoliage.errors import FitError
from usdfoliage.geometry.cubemap import face_directions, share_borders

from tests.support.captured_crowns import (
    CENTER_M,
    ellipsoid,
    lumpy,
    ring,
    sphere,
    surface_points,
    true_radius,
    views_of,
)

SIZE = 64
BASE_M = 0.9


def reduced(views, reach_m=1.5):
    return [reduce_view(view, CENTER_M, reach_m, 200) for view in views]


@pytest.mark.parametrize("shape", [sphere, ellipsoid, lumpy])
def test_points_alone_give_the_surface(shape):
    hull = fit_crown_hull(surface_points(shape), CENTER_M, BASE_M, [], SIZE)

    error_m = hull.radius_m - true_radius(shape, CENTER_M, SIZE)
    assert hull.known == 1
    assert np.abs(error_m).mean() < 0.03
    assert np.abs(error_m).max() < 0.08
    np.testing.assert_array_equal(hull.radius_m, share_borders(hull.radius_m))


def test_a_bare_half_is_closed_and_carved_to_the_silhouettes():
    points_m = surface_points(sphere)
    front = points_m[points_m[:, 2] > CENTER_M[2]]
    far_m = np.concatenate([front, CENTER_M + 2.0 * (front - CENTER_M)])  # a shell of outliers, beyond the sphere

    hull = fit_crown_hull(far_m, CENTER_M, BASE_M, reduced(views_of(ring(12), sphere)), SIZE)

    assert hull.known < 0.6
    assert hull.carved > 0.4
    assert (hull.radius_m > 0).all()
    # 12 silhouettes leave corners beyond the sphere, and closing rounds off what is narrow.
    assert np.quantile(hull.radius_m, 0.9) < 1.15
    assert np.quantile(hull.radius_m, 0.05) > 0.9


def test_no_radius_is_beyond_a_silhouette():
    views = reduced(views_of(ring(8), ellipsoid))

    hull = fit_crown_hull(1.2 * (surface_points(ellipsoid) - CENTER_M) + CENTER_M, CENTER_M, BASE_M, views, SIZE)

    places_m = CENTER_M + (face_directions(SIZE) * hull.radius_m[..., None]).reshape(-1, 3)
    assert hull.carved > 0.5
    for view in views:
        place, _ = view.camera.project(places_m)
        column, row = place.astype(int).T
        # A silhouette is known to a pixel, and carved in steps of a hundredth or two.
        assert cv2.dilate(view.mask.astype(np.uint8), np.ones((5, 5), np.uint8))[row, column].all()


def test_light_between_leaves_does_not_carve_where_masks_were_drawn_leaf_by_leaf():
    rng = np.random.default_rng(4)

    def with_gaps(view):
        gaps = cv2.resize(rng.uniform(0, 1, (24, 24)), view.mask.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0.6
        return replace(view, mask=view.mask & gaps)

    views = [with_gaps(view) for view in reduced(views_of(ring(12), sphere))]
    points_m = 1.2 * (surface_points(sphere) - CENTER_M) + CENTER_M

    given, drawn = (
        fit_crown_hull(points_m, CENTER_M, BASE_M, views, SIZE, HullSettings(drawn_masks=drawn)).radius_m
        for drawn in (False, True)
    )

    assert np.median(given) < 0.7  # every gap counts
    assert np.median(drawn) == pytest.approx(1.0, abs=0.08)


def test_depth_carves_where_two_views_see_past():
    views = reduced(views_of(ring(16), sphere, masks=False, depth=True))
    assert all(view.mask is None and view.depth_m is not None for view in views)
    large = np.full((6, 32, 32), 1.3)

    carved = carve_radius(large, CENTER_M, 0.1, views, HullSettings())
    alone = carve_radius(large, CENTER_M, 0.1, views[:1], HullSettings())

    # Depth ends at the sphere: in front of it two cameras see that nothing is there.
    level = np.abs(face_directions(32)[..., 1]) < 0.5
    assert np.median(carved[level]) < 1.1
    assert carved.min() > 0.9
    np.testing.assert_array_equal(alone, large)


def test_a_few_outliers_make_no_spike():
    points_m = surface_points(sphere, 8000)
    outliers_m = CENTER_M + np.array([[2.0, 0.01 * k, 0.0] for k in range(3)])

    with_outliers, known = outermost_points(np.concatenate([points_m, outliers_m]) - CENTER_M, 32, HullSettings())

    assert known.all()
    assert with_outliers.max() < 1.01


def test_points_in_no_direction_are_refused():
    with pytest.raises(FitError, match="too few in every direction"):
        fit_crown_hull(CENTER_M + np.eye(3), CENTER_M, BASE_M, [], 32)
