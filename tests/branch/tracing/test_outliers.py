"""What is far beside a plant and small is an outlier; what is below or above it is not, nor another plant."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.outliers import OutlierSettings, find_ground_remains, find_outliers


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def plant(rng: np.random.Generator) -> np.ndarray:
    """A trunk below a crown, 3 m high."""
    trunk = np.column_stack([np.zeros(200), np.linspace(0, 2, 200), np.zeros(200)])
    return np.concatenate([trunk, rng.uniform([-0.7, 1.8, -0.7], [0.7, 3, 0.7], (2000, 3))])


def bit(rng: np.random.Generator, count: int, middle_m: tuple[float, float, float]) -> np.ndarray:
    return np.array(middle_m) + rng.normal(0, 0.02, (count, 3))


def test_a_plant_has_no_outliers(rng):
    assert not find_outliers(plant(rng)).any()


def test_bits_beside_a_plant_are_outliers(rng):
    points_m = np.concatenate([plant(rng), bit(rng, 40, (2.5, 0.1, 0)), bit(rng, 30, (0, 1, -3))])
    np.testing.assert_array_equal(find_outliers(points_m), np.arange(len(points_m)) >= 2200)


def test_a_foot_below_a_crown_whose_trunk_was_not_seen_stays(rng):
    points_m = np.concatenate([plant(rng)[200:], bit(rng, 40, (0, 0.1, 0))])
    assert not find_outliers(points_m).any()


@pytest.mark.parametrize(("beside_m", "flat", "stays"), [(1.2, False, True), (3.0, False, False), (1.2, True, False)])
def test_the_foot_of_a_trunk_that_leans_stays_beside_the_crown(rng, beside_m, flat, stays):
    """A gap of 1.4 m is above it: upright it stands up to half of that beside the crown, which ends at 0.7 m."""
    foot = np.column_stack([np.zeros(40), np.linspace(0, 0.4, 40), np.zeros(40)])
    if flat:
        foot = foot[:, [1, 0, 2]]
    points_m = np.concatenate([plant(rng)[200:], np.add(foot, [beside_m, 0, 0])])
    assert find_outliers(points_m).any() != stays


def test_another_plant_is_no_outlier(rng):
    assert not find_outliers(np.concatenate([plant(rng), plant(rng) + np.array([4.0, 0, 0])])).any()


@pytest.mark.parametrize("scale", [0.01, 1.0, 100.0])
def test_outliers_are_the_same_at_every_size(rng, scale):
    points_m = np.concatenate([plant(rng), bit(rng, 40, (2.5, 0.1, 0))])
    assert find_outliers(scale * points_m).sum() == 40


@pytest.mark.parametrize("points_m", [np.zeros((0, 3)), np.zeros((5, 3))])
def test_points_without_height_have_no_outliers(points_m):
    assert not find_outliers(points_m).any()


@pytest.mark.parametrize("change", [{"gap_of_height": 0.0}, {"max_points": 1.0}])
def test_settings_that_cannot_be_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        OutlierSettings(**change)


def test_low_points_far_beside_a_plant_are_remains_of_its_ground():
    rng = np.random.default_rng(1)
    stem_m = np.column_stack([rng.normal(0, 0.02, 500), rng.uniform(0, 2, 500), rng.normal(0, 0.02, 500)])
    crown_m = rng.normal(0, 0.3, (2000, 3)) + np.array([0.0, 3, 0])
    shoots_m = np.column_stack([rng.uniform(-0.8, 0.8, 200), rng.uniform(0.1, 0.4, 200), rng.uniform(-0.3, 0.3, 200)])
    turn = 2 * np.pi * rng.random(800)
    far_m = rng.uniform(3, 8, 800)
    remains_m = np.column_stack([far_m * np.cos(turn), rng.uniform(0.05, 0.3, 800), far_m * np.sin(turn)])
    points_m = np.concatenate([stem_m, crown_m, shoots_m, remains_m])
    slope = np.array([0.1, -0.05, 0.7])  # the ground rises, and is not at zero
    points_m[:, 1] += points_m[:, [0, 2]] @ slope[:2] + slope[2]
    found = find_ground_remains(points_m, slope)
    np.testing.assert_array_equal(found, np.arange(len(points_m)) >= 2700)


def test_a_spruce_keeps_its_lowest_branches_and_a_neighbor_its_stem():
    rng = np.random.default_rng(2)
    height_m = rng.uniform(0, 10, 20000)
    turn, share = 2 * np.pi * rng.random(20000), np.sqrt(rng.random(20000))
    radius_m = (10 - height_m) / 4 * share
    cone_m = np.column_stack([radius_m * np.cos(turn), height_m, radius_m * np.sin(turn)])
    flat = np.zeros(3)
    assert not find_ground_remains(cone_m, flat).any()
    assert not find_ground_remains(np.concatenate([cone_m, cone_m + np.array([12.0, 0, 0])]), flat).any()
    assert not find_ground_remains(np.zeros((0, 3)), flat).any()
