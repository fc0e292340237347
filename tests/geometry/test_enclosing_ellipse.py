"""The smallest ellipses around points, against ellipses that are known and Khachiyan's algorithm written plainly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.geometry.enclosing_ellipse import enclosing_ellipses


def one_ellipse(points, **options):
    found = enclosing_ellipses(np.asarray(points, float), np.array([0, len(points)]), **options)
    return found.centers[0], found.half_axes[0], found.angles[0]


def shape_matrix(half_axes, angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return turn @ np.diag(half_axes**2) @ turn.T


def khachiyan(points, tolerance=1e-4):
    """Centre and shape matrix, by Khachiyan's steps towards the farthest point alone."""
    lifted = np.column_stack([points, np.ones(len(points))]).T
    weights = np.full(len(points), 1 / len(points))
    for _ in range(200_000):
        kappa = np.einsum("ip,ij,jp->p", lifted, np.linalg.inv(lifted * weights @ lifted.T), lifted)
        far = kappa.argmax()
        if kappa[far] <= 3 * (1 + tolerance):
            break
        step = (kappa[far] - 3) / (3 * (kappa[far] - 1))
        weights *= 1 - step
        weights[far] += step
    center = weights @ points
    return center, 2 * ((points - center).T * weights) @ (points - center)


def ring(half_axes, angle, center, count=24):
    turns = 2 * np.pi * np.arange(count) / count
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (np.column_stack([np.cos(turns), np.sin(turns)]) * half_axes) @ turn.T + center


@settings(max_examples=60, deadline=None)
@given(
    narrow=st.floats(1e-3, 0.98),
    size=st.floats(1e-4, 1e4),
    angle=st.floats(-1.57, 1.57),
    x=st.floats(-100, 100),
    seed=st.integers(0, 1000),
)
def test_an_ellipse_is_found_again(narrow, size, angle, x, seed):
    points = ring((size, size * narrow), angle, (x * size, -3 * size))
    rng = np.random.default_rng(seed)
    inside = rng.permutation(np.concatenate([points, points.mean(axis=0) + 0.9 * (points - points.mean(axis=0))]))

    center, half_axes, found = one_ellipse(inside)

    assert center == pytest.approx((x * size, -3 * size), abs=1e-5 * size)
    assert half_axes == pytest.approx((size, size * narrow), rel=1e-5)
    assert np.sin(found - angle) == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize(("corners", "half_axes"), [(3, (2 / 3**0.5,) * 2), (4, (2**0.5,) * 2)])
def test_regular_polygons_have_their_circle(corners, half_axes):
    points = ring((half_axes[0], half_axes[0]), 0.3, (1, 2), corners)

    center, found, _ = one_ellipse(points)

    assert center == pytest.approx((1, 2), abs=1e-6)
    assert found == pytest.approx(half_axes, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_is_khachiyans(seed):
    points = np.random.default_rng(seed).normal(size=(40, 2)) @ [[1.0, 0.4], [0.0, 0.3]]

    center, half_axes, angle = one_ellipse(points)

    expected_center, expected = khachiyan(points)
    assert center == pytest.approx(expected_center, abs=2e-3)
    assert shape_matrix(half_axes, angle) == pytest.approx(expected, abs=5e-3)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(3, 60), stretch=st.floats(0.001, 1000))
def test_no_point_is_outside_and_some_are_on_it(seed, count, stretch):
    points = np.random.default_rng(seed).normal(size=(count, 2)) * (1, stretch)

    center, half_axes, angle = one_ellipse(points)

    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    squares = np.sum(((points - center) @ turn.T / half_axes) ** 2, axis=1)
    assert squares.max() == pytest.approx(1, abs=1e-9)
    assert np.sum(squares > 1 - 1e-4) >= 3
    assert half_axes[0] >= half_axes[1] > 0


def test_points_on_a_line_have_an_ellipse_without_width():
    along = np.array([0.2, 0.0, 1.0, 0.7])
    points = np.array([1.0, -1.0]) + along[:, None] * (3, 4)

    center, half_axes, angle = one_ellipse(points)

    assert center == pytest.approx((2.5, 1.0))
    assert half_axes == pytest.approx((2.5, 0.0))
    assert angle == pytest.approx(np.arctan2(4, 3))


def test_two_points_one_point_and_none():
    points = np.array([[0.0, 0.0], [0.0, 2.0], [5.0, 6.0], [7.0, 7.0], [7.0, 7.0]])

    found = enclosing_ellipses(points, np.array([0, 2, 3, 3, 5]))

    assert found.centers[[0, 1, 3]] == pytest.approx(np.array([[0, 1], [5, 6], [7, 7]]))
    assert np.isnan(found.centers[2]).all()
    assert found.half_axes == pytest.approx(np.array([[1, 0], [0, 0], [0, 0], [0, 0]]))
    assert found.angles[0] == pytest.approx(np.pi / 2)


def test_no_set_at_all():
    assert enclosing_ellipses(np.empty((0, 2)), np.array([0])).centers.shape == (0, 2)


def test_any_number_of_threads_gives_the_same():
    rng = np.random.default_rng(7)
    points, offsets = rng.normal(size=(2000, 2)), np.arange(0, 2001, 20)

    one, three = (enclosing_ellipses(points, offsets, threads=threads) for threads in (1, 3))

    assert np.array_equal(one.centers, three.centers)
    assert np.array_equal(one.half_axes, three.half_axes)
    assert np.array_equal(one.angles, three.angles)


@pytest.mark.parametrize(
    ("points", "offsets", "message"),
    [
        (np.zeros((4, 3)), [0, 4], "points"),
        (np.zeros((4, 2)), [0, 3], "offsets"),
        (np.zeros((4, 2)), [0, 3, 2, 4], "offsets"),
        (np.full((4, 2), np.nan), [0, 4], "finite"),
    ],
)
def test_wrong_arguments_are_refused(points, offsets, message):
    with pytest.raises(ValueError, match=message):
        enclosing_ellipses(points, np.array(offsets))
    with pytest.raises(ValueError, match="tolerance"):
        enclosing_ellipses(np.zeros((4, 2)), np.array([0, 4]), tolerance=0)
