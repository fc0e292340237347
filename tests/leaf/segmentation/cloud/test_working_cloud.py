"""A cloud thinned to what its noise lets it show, and the planes at its points."""

import numpy as np
import pytest
from usdfoliage.errors import FitError
from usdfoliage.leaf.segmentation.cloud.settings import CloudSegmentationSettings
from usdfoliage.leaf.segmentation.cloud.working_cloud import MIN_POINTS, prepare_cloud


def level_square(points: int, noise_m: float, side_m: float = 0.1, seed: int = 0):
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, side_m, (points, 3)) * [1, 1, 0]
    return places + rng.normal(0, noise_m, (points, 3)) * [0, 0, 1]


def test_normals_of_a_plane_stand_on_it():
    cloud = prepare_cloud(level_square(800, 0.0002))
    assert cloud.cell_m == 0
    assert np.median(np.abs(cloud.normals[:, 2])) > 0.995
    assert 0.00005 < cloud.thickness_m < 0.0002  # what lies off a plane counts little


def test_where_two_planes_meet_normals_are_of_either_and_not_between():
    rng = np.random.default_rng(2)
    level = rng.uniform(0, 0.1, (1500, 3)) * [1, 1, 0]
    upright = rng.uniform(0, 0.1, (1500, 3)) * [1, 0, 1]
    cloud = prepare_cloud(np.concatenate([level, upright]))
    off = np.minimum(np.abs(cloud.normals[:, 1]), np.abs(cloud.normals[:, 2]))
    assert np.quantile(off, 0.9) < 0.1


def test_points_on_a_line_are_straight():
    rng = np.random.default_rng(0)
    line = np.column_stack([np.linspace(0, 1, 300), *rng.normal(0, 1e-4, (2, 300))])
    assert np.median(prepare_cloud(line).straightness) > 0.95
    assert np.median(prepare_cloud(level_square(800, 0.0)).straightness) < 0.7


def test_what_is_denser_than_its_noise_is_thinned():
    points_m = level_square(40_000, 0.0015)
    cloud = prepare_cloud(points_m)
    assert cloud.cell_m > 0
    assert len(cloud) < len(points_m) / 4
    np.testing.assert_array_equal(np.bincount(cloud.of_point) > 0, True)
    np.testing.assert_allclose(cloud.points_m[0], points_m[cloud.of_point == 0].mean(axis=0), atol=1e-12)


def test_there_are_no_more_points_than_the_settings_allow():
    cloud = prepare_cloud(level_square(3000, 0.0001), CloudSegmentationSettings(max_points=500))
    assert len(cloud) <= 500
    assert cloud.of_point.max() == len(cloud) - 1


def test_distances_and_not_metres_decide():
    small, large = (prepare_cloud(level_square(500, 0.0002) * scale) for scale in (1.0, 1000.0))
    np.testing.assert_array_equal(small.neighbours, large.neighbours)
    assert large.spacing_m == pytest.approx(1000 * small.spacing_m)


def test_too_few_points_are_refused():
    with pytest.raises(ValueError, match=f"at least {MIN_POINTS}"):
        prepare_cloud(np.zeros((MIN_POINTS - 1, 3)))


@pytest.mark.parametrize("max_points", [300_000, 500])
def test_repeated_points_count_once(max_points):
    settings = CloudSegmentationSettings(max_points=max_points)
    points_m = level_square(800, 0.0002)
    once = prepare_cloud(points_m, settings)
    order = np.random.default_rng(0).permutation(np.repeat(np.arange(800), 20))
    order = np.concatenate([np.arange(800), order])
    repeated = prepare_cloud(points_m[order], settings)
    np.testing.assert_array_equal(repeated.points_m, once.points_m)
    np.testing.assert_array_equal(repeated.of_point, once.of_point[order])
    assert repeated.spacing_m == once.spacing_m > 1e-6


def test_points_in_hardly_any_different_places_are_refused():
    points_m = np.repeat(level_square(MIN_POINTS - 1, 0.0), 50, axis=0)
    with pytest.raises(FitError, match=f"550 points lie in {MIN_POINTS - 1} different places.*export"):
        prepare_cloud(points_m, CloudSegmentationSettings(max_points=100))
