"""Leaves that are put where a cloud has leaves."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.fill import FillSettings, fill_places

LENGTH_M = 0.1


def blade(middle_m: np.ndarray, turn: Rotation, rng: np.random.Generator, count: int = 60) -> np.ndarray:
    """Points on a flat leaf: its axis is the y of turn, its normal the z."""
    local = np.column_stack([rng.uniform(-0.015, 0.015, count), rng.uniform(-0.045, 0.045, count), np.zeros(count)])
    return middle_m + turn.apply(local)


def test_a_leaf_lies_in_the_plane_of_its_points_and_points_away_from_its_twig() -> None:
    rng = np.random.default_rng(0)
    turn = Rotation.from_euler("xyz", [-70, 25, 10], degrees=True)
    middle_m = np.array([0.5, 1.5, -0.2])
    points_m = blade(middle_m, turn, rng)
    twig_m = (middle_m - turn.apply([0, 0.06, 0]))[None]
    places = fill_places(points_m, twig_m, LENGTH_M, np.random.default_rng(1), FillSettings(apart=1.2, around=1.2))
    assert len(places.base_m) == 1
    own = Rotation.from_quat(places.orientation[0])
    normal = turn.apply([0, 0, 1]) * np.sign(turn.apply([0, 0, 1])[1])
    assert own.apply([0, 0, 1]) @ normal > 0.999
    assert own.apply([0, 1, 0]) @ turn.apply([0, 1, 0]) > 0.99
    assert np.linalg.norm(places.base_m[0] + 0.5 * LENGTH_M * own.apply([0, 1, 0]) - middle_m) < 0.015


@pytest.mark.parametrize(("share", "found"), [(0.1, 0.3), (0.5, 0.5), (0.8, 0.8), (1.0, 1.0)])
def test_a_leaf_is_as_long_as_its_points_where_they_end(share: float, found: float) -> None:
    rng = np.random.default_rng(8)
    turn = Rotation.from_euler("xyz", [-70, 25, 10], degrees=True)
    points_m = turn.apply(
        rng.uniform([-0.01, -0.5 * share * LENGTH_M, 0], [0.01, 0.5 * share * LENGTH_M, 0], (4000, 3))
    )
    twig_m = -turn.apply([0, 0.08, 0])[None]
    settings = FillSettings(apart=1.2, around=1.2)
    places = fill_places(points_m, twig_m, LENGTH_M, rng, settings)
    np.testing.assert_allclose(places.length_m, [found * LENGTH_M], atol=0.002)
    own = Rotation.from_quat(places.orientation[0])
    middle_m = places.base_m[0] + 0.5 * places.length_m[0] * own.apply([0, 1, 0])
    np.testing.assert_allclose(middle_m, 0, atol=0.003)
    not_shortened = fill_places(points_m, twig_m, LENGTH_M, rng, FillSettings(apart=1.2, around=1.2, shortest=1))
    np.testing.assert_array_equal(not_shortened.length_m, [LENGTH_M])


@pytest.mark.parametrize(("away_m", "begins_m"), [(0.03, 0.03), (0.034, 0.034), (0.04, 0.01), (0.012, 0.012)])
def test_a_short_leaf_begins_at_its_twig_where_that_is_near(away_m: float, begins_m: float) -> None:
    """Points from 1 cm before the middle to 1 cm behind it."""
    rng = np.random.default_rng(10)
    points_m = rng.uniform([-0.01, -0.01, 0], [0.01, 0.01, 0], (4000, 3))
    settings = FillSettings(apart=1.2, around=1.2, shortest=0.05)
    places = fill_places(points_m, np.array([[0.0, -away_m, 0.0]]), LENGTH_M, rng, settings)
    np.testing.assert_allclose(places.base_m, [[0, -begins_m, 0]], atol=0.001)
    np.testing.assert_allclose(places.length_m, [begins_m + 0.01], atol=0.001)


def test_points_that_are_far_apart_do_not_show_where_a_leaf_ends() -> None:
    across, along = np.meshgrid([-1.0, 0, 1], np.arange(-4.0, 5))
    points_m = 0.007 * np.column_stack([across.ravel(), along.ravel(), np.zeros(across.size)])
    twig_m = np.array([[0.0, -0.06, 0.0]])
    settings = FillSettings(apart=1.2, around=1.2)
    assert fill_places(points_m, twig_m, LENGTH_M, np.random.default_rng(8), settings).length_m == LENGTH_M
    denser = fill_places(0.7 * points_m, twig_m, LENGTH_M, np.random.default_rng(8), settings)
    assert denser.length_m == pytest.approx(8 * 0.7 * 0.007)


def test_the_plant_shows_where_a_leaf_ends_that_is_known_in_part() -> None:
    rng = np.random.default_rng(11)
    known_m = rng.uniform([-0.01, -0.01, 0], [0.01, 0.01, 0], (2000, 3))
    rest_m = rng.uniform([-0.01, 0.01, 0], [0.01, 0.03, 0], (2000, 3))
    settings = FillSettings(apart=1.2, around=1.2, shortest=0.05)
    twig_m = np.array([[0.0, -0.5, 0.0]])
    settings = replace(settings, farthest=10)
    places = fill_places(known_m, twig_m, LENGTH_M, rng, settings, plant_m=np.concatenate([known_m, rest_m]))
    np.testing.assert_allclose(places.length_m, [0.04], atol=0.002)
    np.testing.assert_allclose(places.base_m, [[0, -0.01, 0]], atol=0.002)


def test_points_beyond_a_gap_are_of_another_leaf() -> None:
    rng = np.random.default_rng(9)
    leaf_m = rng.uniform([-0.01, -0.02, 0], [0.01, 0.02, 0], (2000, 3))
    beyond_m = rng.uniform([-0.01, 0.04, 0], [0.01, 0.06, 0], (1000, 3))
    beside_m = rng.uniform([0.04, -0.04, 0], [0.05, 0.04, 0], (1000, 3))
    above_m = rng.uniform([-0.01, -0.06, 0.02], [0.01, 0.06, 0.02], (1000, 3))
    twig_m = np.array([[0.0, -0.1, 0.0]])
    settings = FillSettings(apart=0.25, around=0.2)
    places = fill_places(np.concatenate([leaf_m, beyond_m, beside_m, above_m]), twig_m, LENGTH_M, rng, settings)
    own = places.length_m[places.point < len(leaf_m)]
    assert len(own)
    assert (own <= 0.07).all()
    assert np.median(own) < 0.05


def test_leaves_keep_apart_and_fill_all() -> None:
    rng = np.random.default_rng(2)
    points_m = rng.uniform(0, 0.4, (4000, 3))
    settings = FillSettings(apart=0.8)
    places = fill_places(points_m, points_m[::50], LENGTH_M, np.random.default_rng(3), settings)
    chosen_m = points_m[places.point]
    between_m = np.linalg.norm(chosen_m[:, None] - chosen_m[None], axis=-1) + np.eye(len(chosen_m))
    assert between_m.min() >= settings.apart * LENGTH_M
    assert len(chosen_m) > 50


def test_points_that_stand_alone_are_no_leaf() -> None:
    rng = np.random.default_rng(4)
    alone_m = np.array([[5.0, 5, 5], [5.001, 5, 5], [9, 9, 9]])
    leaf_m = blade(np.zeros(3), Rotation.identity(), rng)
    places = fill_places(np.concatenate([alone_m, leaf_m]), alone_m * 0, LENGTH_M, np.random.default_rng(5))
    assert len(places.point)
    assert (places.point >= 3).all()


def test_leaves_of_clumps_without_a_plane_have_the_tilt_of_the_settings() -> None:
    points_m = np.random.default_rng(6).uniform(0, 0.3, (20000, 3))
    for tilt, low, high in ((0.0, 0.999, 1.0), (0.7, 0.6, 0.9)):
        settings = FillSettings(tilt=tilt)
        places = fill_places(points_m, points_m[::50], LENGTH_M, np.random.default_rng(7), settings)
        upward = Rotation.from_quat(places.orientation).apply([0, 0, 1])[:, 1]
        assert low <= np.median(upward) <= high + 1e-9


@given(st.integers(0, 40), st.integers(0, 2**31), st.floats(0.001, 10))
def test_any_points_give_whole_leaves_and_the_same_each_time(count: int, seed: int, length_m: float) -> None:
    points_m = np.random.default_rng(seed).normal(size=(count, 3)).round(1)  # some fall together, or on a line
    origins_m = np.zeros((1, 3))
    first, second = (fill_places(points_m, origins_m, length_m, np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(first.base_m, second.base_m)
    assert np.isfinite(first.base_m).all()
    np.testing.assert_allclose(np.linalg.norm(first.orientation, axis=1), 1)


def test_what_is_far_from_every_twig_is_no_leaf_of_the_plant() -> None:
    rng = np.random.default_rng(10)
    near_m, far_m = blade(np.zeros(3), Rotation.identity(), rng), blade(np.ones(3), Rotation.identity(), rng)
    places = fill_places(np.concatenate([near_m, far_m]), np.zeros((1, 3)), LENGTH_M, np.random.default_rng(11))
    assert len(places.point)
    assert (places.point < len(near_m)).all()


def test_leaves_up_to_the_limit_are_kept_evenly() -> None:
    points_m = np.random.default_rng(8).uniform(0, 0.5, (5000, 3))
    places = fill_places(points_m, points_m[::50], LENGTH_M, np.random.default_rng(9), FillSettings(max_leaves=100))
    assert len(places.base_m) == 100
    assert np.abs(points_m[places.point].mean(axis=0) - 0.25).max() < 0.08


@pytest.mark.parametrize("length_m", [0.0, -1.0, float("nan")])
def test_a_length_that_cannot_be_is_refused(length_m: float) -> None:
    with pytest.raises(ValueError, match="length_m"):
        fill_places(np.zeros((4, 3)), np.zeros((1, 3)), length_m, np.random.default_rng(0))


def rod(begin_m: tuple[float, float, float], end_m: tuple[float, float, float], count: int = 2000) -> np.ndarray:
    """Points in a rod, 4 mm thick."""
    rng = np.random.default_rng(12)
    return np.linspace(begin_m, end_m, count) + rng.uniform(-0.002, 0.002, (count, 3))


@pytest.mark.parametrize("tip_m", [(0.05, 0.05, 0.0), (0.0, 0.06, -0.03), (0.03, -0.05, 0.0)])
def test_a_pod_lies_along_its_points_from_the_stem(tip_m: tuple[float, float, float]) -> None:
    """Away from the nearest point of the stem is another direction."""
    stem_m = np.column_stack([np.zeros(200), np.linspace(-0.5, 0.5, 200), np.zeros(200)])
    pod_m = rod((0, 0, 0), tip_m)
    plant_m = np.concatenate([pod_m, rod((0, -0.5, 0), (0, 0.5, 0), 20000)])
    places = fill_places(pod_m, stem_m, LENGTH_M, np.random.default_rng(13), plant_m=plant_m)
    assert len(places.point) == 1
    along = Rotation.from_quat(places.orientation[0]).apply([0, 1, 0])
    assert along @ tip_m > 0.99 * np.linalg.norm(tip_m)
    np.testing.assert_allclose(places.base_m[0], 0, atol=0.012)
    np.testing.assert_allclose(places.base_m[0] + places.length_m[0] * along, tip_m, atol=0.006)
    assert places.width_m[0] == pytest.approx(0.004, abs=0.0015)


def test_a_twig_is_no_leaf() -> None:
    twig_m = rod((0, 0, 0), (0.2, 0.1, 0))
    places = fill_places(twig_m, np.linspace((0, 0, 0), (0.2, 0.1, 0), 50), LENGTH_M, np.random.default_rng(14))
    assert not len(places.point)


def test_a_leaf_that_is_longer_than_expected_stays_on_its_points() -> None:
    pod_m = rod((0, 0, 0), (0.15, 0, 0), 4000)
    places = fill_places(pod_m, np.array([[-0.1, 0.0, 0.0]]), LENGTH_M, np.random.default_rng(15))
    tips_m = places.base_m + places.length_m[:, None] * Rotation.from_quat(places.orientation).apply([0, 1, 0])
    assert len(tips_m)
    assert (places.base_m[:, 0] > -0.01).all()
    assert (tips_m[:, 0] < 0.16).all()
