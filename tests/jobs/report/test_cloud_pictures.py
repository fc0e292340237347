"""Pictures of clouds: which sides, which window, what stands before what."""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.jobs.report.cloud_pictures import (
    PAPER,
    Window,
    bar_length,
    draw_scale_bar,
    draw_seen,
    find_common,
    find_inside,
    find_sides,
    frame_points,
    round_length,
    splat_points,
    thin_cloud,
)

from tests.support.captures import LENS, look_at

Y_UP = np.array([0.0, 1, 0])


def cloud_of(points_m: np.ndarray) -> Cloud:
    count = len(points_m)
    return Cloud(
        points_m=np.asarray(points_m, np.float64),
        normals=np.zeros((count, 3), np.float32),
        srgb=np.zeros((count, 3), np.uint8),
        confidence=np.ones(count, np.float32),
        views=np.ones(count, np.int32),
    )


def cameras_at(*places):
    return [LENS.pinhole(look_at(place, (0, 0, 0))) for place in places]


BALL = np.random.default_rng(0).normal(size=(500, 3)) * 0.2
AROUND = [(4 * np.cos(a), 1.0, 4 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)]


# Sides


@given(
    places=st.lists(st.tuples(*[st.floats(-5, 5)] * 3).filter(lambda p: np.hypot(p[0], p[2]) > 0.1), max_size=4),
    up=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda u: np.linalg.norm(u) > 0.1),
)
def test_sides_are_right_handed_with_up_up(places, up):
    sides = find_sides(cameras_at(*places), cloud_of(BALL), np.array(up))
    assert [side.name for side in sides] == ["front", "right", "top"]
    for side in sides:
        axes = np.array([side.right, side.up, side.towards])
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(sides[2].towards, np.array(up) / np.linalg.norm(up), atol=1e-12)
    np.testing.assert_allclose(sides[1].towards, sides[0].right, atol=1e-12)


def test_the_front_is_where_the_cameras_stand():
    front = find_sides(cameras_at((1, 0.5, 4), (-1, 0.5, 4)), cloud_of(BALL), Y_UP)[0]
    np.testing.assert_allclose(front.towards, (0, 0, 1), atol=0.02)
    front = find_sides(cameras_at(*AROUND), cloud_of(BALL), Y_UP)[0]  # the first one, where they stand all around
    np.testing.assert_allclose(front.towards, (1, 0, 0), atol=0.02)


@pytest.mark.parametrize("places", [[], [(0.0, 5.0, 1e-12)]])
def test_cameras_above_or_none_leave_the_front_open(places):
    for cloud in (cloud_of(BALL), cloud_of(np.zeros((0, 3)))):
        assert np.isfinite([side.towards for side in find_sides(cameras_at(*places), cloud, Y_UP)]).all()


# Windows


def test_single_points_far_off_do_not_shrink_the_picture():
    points_m = np.concatenate([np.random.default_rng(1).uniform(-1, 1, (5000, 3)), [[1000.0, 0, 0]]])
    windows = frame_points(points_m, find_sides([], cloud_of(points_m), Y_UP), 500, np.zeros((0, 3)))
    for window in windows:
        assert 2 < window.width_m < 2.5
        assert max(window.size_px) <= 500


def test_points_that_must_be_drawn_are_in_the_window():
    (window,) = frame_points(BALL, find_sides([], cloud_of(BALL), Y_UP)[2:], 400, np.array([[3.0, 0, 0], [0, 0, -2]]))
    top = find_sides([], cloud_of(BALL), Y_UP)[2]
    places = window.places(np.array([[3.0, 0, 0], [0, 0, -2]]), top)
    assert ((places > 0) & (places < window.size_px)).all()


@pytest.mark.parametrize("points_m", [np.zeros((0, 3)), np.zeros((1, 3)), np.ones((7, 3))])
def test_windows_of_hardly_anything_have_a_size(points_m):
    for window in frame_points(points_m, find_sides([], cloud_of(points_m), Y_UP), 100, np.zeros((0, 3))):
        assert min(window.size_px) >= 1


def test_far_hills_are_not_common_to_the_cameras():
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    hills = np.column_stack([200 * np.cos(angle), 5 + 0 * angle, 200 * np.sin(angle)])
    points_m = np.concatenate([BALL, hills])
    common = find_common(points_m, cameras_at(*AROUND))
    assert common[:500].all()
    assert not common[500:].any()
    sides = find_sides(cameras_at(*AROUND), cloud_of(BALL), Y_UP)
    inside = find_inside(points_m, points_m[common], sides)
    assert inside[:500].mean() > 0.98
    assert not inside[500:].any()


def test_without_cameras_all_is_common():
    assert find_common(BALL, []).all()
    assert find_inside(BALL, np.zeros((0, 3)), find_sides([], cloud_of(BALL), Y_UP)).all()


# Points


def splat(points_m, width_m=0.01):
    front = find_sides(cameras_at((0, 0, 4)), cloud_of(np.zeros((1, 3))), Y_UP)[0]
    window = Window(left_m=-1, bottom_m=-1, width_m=2, height_m=2, px_per_m=50)
    points_m = np.asarray(points_m, np.float64).reshape(-1, 3)
    return splat_points(points_m, front, window, np.broadcast_to(np.float64(width_m), len(points_m)))


def test_points_are_where_they_are():
    seen = splat([[0.501, 0.701, 0.0]])
    rows, columns = np.nonzero(seen.point == 0)
    assert (rows.tolist(), columns.tolist()) == ([14], [75])


def test_the_nearer_point_is_seen_whatever_its_order_and_width():
    for points, nearest in (([[0.01, 0.01, 0], [0.01, 0.01, 0.5]], 1), ([[0.01, 0.01, 0.5], [0.01, 0.01, 0]], 0)):
        assert splat(points).point[49, 50] == nearest
    assert splat([[0.05, 0.01, 0.5], [0.01, 0.01, 0]], [0.12, 0.01]).point[49, 50] == 0  # wide, and before it


def test_points_are_as_wide_as_the_given_width():
    for width_m, across_px in ((0.001, 1), (0.02, 1), (0.06, 3), (0.1, 5), (10.0, 13)):
        assert np.count_nonzero(splat([[0, 0, 0]], width_m).point == 0) == across_px**2


def test_what_is_outside_is_not_drawn():
    assert not (splat([[1.2, 0, 0], [0, -7, 0]]).point >= 0).any()
    assert not (splat(np.zeros((0, 3))).point >= 0).any()


def test_what_stands_before_darkens_what_is_behind_it():
    grid = np.stack(np.meshgrid(np.arange(-0.99, 1, 0.02), np.arange(-0.99, 1, 0.02), [0.0]), -1).reshape(-1, 3)
    before = grid[(np.abs(grid[:, 0]) < 0.3)] + (0, 0, 0.3)
    seen = splat(np.concatenate([grid, before]), 0.02)
    assert seen.light[50, 34] < 0.9  # beside the one before
    assert seen.light[50, 50] == seen.light[50, 10] == 1


def test_a_picture_has_the_colors_of_its_points():
    picture = draw_seen(splat([[0.0, 0, 0]]), np.array([[10, 20, 30]], np.uint8))
    assert (picture == (10, 20, 30)).all(axis=2).sum() == 1
    assert (picture == PAPER).all(axis=2).sum() == picture[..., 0].size - 1


def test_thinning_is_even():
    cloud = cloud_of(np.arange(3000.0).reshape(-1, 3))
    thinned = thin_cloud(cloud, 100)
    assert len(thinned) == 100
    assert np.ptp(np.diff(thinned.points_m[:, 0])) <= 6
    assert thin_cloud(cloud, 1000) is cloud


# Scale


@given(length_m=st.floats(1e-6, 1e6))
def test_round_lengths_are_round(length_m):
    length = round_length(length_m)
    assert length <= length_m * (1 + 1e-6)
    assert length > 0.39 * length_m
    assert float(f"{length:.0e}"[0]) in (1, 2, 5)


def test_a_scale_bar_is_as_long_as_its_label():
    picture = np.zeros((100, 300, 3), np.uint8)
    window = Window(left_m=0, bottom_m=0, width_m=3, height_m=1, px_per_m=100)
    wide = replace(window, width_m=30)
    assert bar_length([wide, window]) == 0.5
    draw_scale_bar(picture, 0.5, window.px_per_m)
    dark = (picture == (60, 60, 60)).all(axis=2)
    assert dark.any(axis=0).sum() == 50
