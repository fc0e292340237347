"""Depth of textured planes, photographed by cameras side by side, where it is known exactly."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy import ndimage
from usdfoliage import _native
from usdfoliage.capture.mvs.plane_sweep import (
    PlaneSweepSettings,
    choose_neighbors,
    depth_range_m,
    sweep_depth,
    sweep_depths,
)
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.pinhole import Pinhole

WIDTH, HEIGHT, FOCAL = 160, 120, 150.0
RANGE_M = 0.6, 1.8


def camera(x_m, y_m=0.0, turn_deg=0.0):
    """Looks along z, from x, y, 0, turned about the vertical."""
    turn = np.radians(turn_deg)
    rotation = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    position = np.array([x_m, y_m, 0.0])
    return Pinhole(
        width_px=WIDTH,
        height_px=HEIGHT,
        focal_px=(FOCAL, FOCAL),
        center_px=(WIDTH / 2, HEIGHT / 2),
        cam_from_world=np.column_stack([rotation, -rotation @ position]),
    )


CAMERAS = [camera(-0.2, 0.02, 6), camera(-0.1, -0.01, 3), camera(0.0), camera(0.1, 0.01, -3), camera(0.2, -0.02, -6)]


def plane(normal, distance_m, half_m=np.inf, seed=0):
    """A plane normal·x = distance with a texture over x and y; as a square of 2 half_m around the z axis."""
    rng = np.random.default_rng(seed)
    texture = ndimage.gaussian_filter(rng.uniform(size=(600, 600)), 1.5)
    texture = 255 * (texture - texture.min()) / np.ptp(texture)
    return np.array(normal, float), distance_m, half_m, texture


def shoot(seen_by, planes):
    """A view of the planes, and its true depth (H, W)."""
    rays = seen_by.rays() @ seen_by.cam_from_world[:, :3]
    depth, gray = np.full((HEIGHT, WIDTH), np.inf), np.zeros((HEIGHT, WIDTH))
    for normal, distance, half, texture in planes:
        t = (distance - normal @ seen_by.position_m) / (rays @ normal)
        points = seen_by.position_m + t[..., None] * rays
        hit = (t > 0) & (t < depth) & (np.abs(points[..., :2]).max(axis=-1) < half)
        value = ndimage.map_coordinates(texture, np.moveaxis(points[..., :2], -1, 0) * 250 + 300, order=1, mode="wrap")
        depth[hit], gray[hit] = t[hit], value[hit]
    pixels = np.rint(gray).astype(np.uint8)
    view = View(
        name=f"{seen_by.position_m[0]:.3f}.png",
        camera=seen_by,
        srgb=np.repeat(pixels[..., None], 3, axis=2),
        depth_m=np.zeros((HEIGHT, WIDTH), np.float32),
    )
    return view, depth


def shoot_all(planes, cameras=CAMERAS):
    views, depths = zip(*[shoot(each, planes) for each in cameras], strict=True)
    return list(views), list(depths)


def points_of(view, depth):
    places = np.stack(np.meshgrid(np.arange(4, WIDTH, 8) + 0.5, np.arange(4, HEIGHT, 8) + 0.5), -1).reshape(-1, 2)
    return view.camera.unproject(places, depth[places[:, 1].astype(int), places[:, 0].astype(int)])


SLANTED = [plane((0.35, -0.25, 1.0), 1.0)]
TWO = [plane((0, 0, 1), 1.5, seed=1), plane((0.1, 0.1, 1.0), 0.9, half_m=0.15, seed=2)]


@pytest.fixture(scope="module")
def two_planes():
    views, truths = shoot_all(TWO)
    return views, truths, sweep_depths(views, points_of(views[2], truths[2])).depths_m


def test_a_slanted_plane_is_found_to_a_fraction_of_the_step():
    views, truths = shoot_all(SLANTED)
    swept = sweep_depth(views, 2, [1, 3, 0, 4], RANGE_M)
    error = np.abs(swept.depth_m - truths[2])[8:-8, 8:-8]
    assert np.median(error / swept.step_m[8:-8, 8:-8]) < 0.2
    assert np.mean(error < swept.step_m[8:-8, 8:-8]) > 0.97


def test_median_of_views_is_more_exact_than_each():
    views, truths = shoot_all(SLANTED)
    points = points_of(views[2], truths[2])
    chosen = choose_neighbors(CAMERAS, 2, depth_range_m(CAMERAS, 2, points))
    alone = sweep_depth(views, 2, chosen, depth_range_m(CAMERAS, 2, points)).depth_m
    together = sweep_depths(views, points).depths_m[2]
    known = together > 0
    assert known.mean() > 0.85
    assert np.median(np.abs(together - truths[2])[known]) < np.median(np.abs(alone - truths[2])[known])


def test_nothing_wild_beside_and_behind_what_stands_in_front(two_planes):
    views, truths, depths = two_planes
    for view, truth, depth in zip(views, truths, depths, strict=True):
        known = depth > 0
        back = shoot(view.camera, TWO[:1])[1]
        assert known.mean() > 0.7
        assert np.mean(np.abs(depth - truth)[known] < 0.03) > 0.95
        either = np.minimum(np.abs(depth - truth), np.abs(depth - back))
        near = np.minimum(either, np.abs(depth - 0.9))
        assert np.mean(near[known] < 0.1) > 0.995


def test_both_planes_are_found(two_planes):
    _, truths, depths = two_planes
    front = truths[2] < 1.2
    inside = cv2.erode(front.astype(np.uint8), np.ones((7, 7))) > 0
    assert np.mean(depths[2][inside] > 0) > 0.95
    outside = cv2.dilate(front.astype(np.uint8), np.ones((31, 31))) == 0
    assert np.mean(depths[2][outside] > 0) > 0.75


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_change_nothing(two_planes, threads):
    views, truths, depths = two_planes
    again = sweep_depths(views, points_of(views[2], truths[2]), PlaneSweepSettings(threads=threads)).depths_m
    for first, second in zip(depths, again, strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_depth_scales_with_the_world(two_planes, scale):
    views, truths, depths = two_planes
    poses = [np.column_stack([v.camera.cam_from_world[:, :3], v.camera.cam_from_world[:, 3] * scale]) for v in views]
    scaled = [
        replace(view, camera=replace(view.camera, cam_from_world=pose)) for view, pose in zip(views, poses, strict=True)
    ]
    again = sweep_depths(scaled, points_of(views[2], truths[2]) * scale).depths_m
    for first, second in zip(depths, again, strict=True):
        same = np.isclose(first * scale, second, rtol=1e-4)  # rounding may turn a tie
        assert same.mean() > 0.999


def test_brightness_of_a_photograph_does_not_matter(two_planes):
    views, truths, depths = two_planes
    darker = [
        replace(view, srgb=(view.srgb * gain).astype(np.uint8))
        for view, gain in zip(views, [0.7, 1.0, 0.9, 0.6, 0.8], strict=True)
    ]
    again = sweep_depths(darker, points_of(views[2], truths[2])).depths_m[2]
    known = (depths[2] > 0) & (again > 0)
    assert known.mean() > 0.7
    assert np.median(np.abs(again - truths[2])[known]) < 0.01  # a plane step is 0.05


def test_reduced_photographs_give_depth_of_full_size():
    views, truths = shoot_all(SLANTED)
    depth = sweep_depths(views, points_of(views[2], truths[2]), PlaneSweepSettings(max_side_px=100)).depths_m[2]
    known = depth > 0
    assert depth.shape == truths[2].shape
    assert known.mean() > 0.6
    assert np.median(np.abs(depth - truths[2])[known]) < 0.005


def test_masked_pixels_get_no_depth(two_planes):
    views, truths, _ = two_planes
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[:, 80:] = True
    masked = [replace(view, mask=mask) for view in views]
    depth = sweep_depths(masked, points_of(views[2], truths[2])).depths_m[2]
    assert not depth[~mask].any()
    assert depth[mask].any()


def test_a_view_without_neighbors_gets_no_depth_and_a_remark(two_planes):
    views, truths, _ = two_planes
    far = shoot(camera(0.0, turn_deg=150), TWO)[0]
    swept = sweep_depths([*views, replace(far, name="far.png")], points_of(views[2], truths[2]))
    assert not swept.depths_m[5].any()
    assert swept.depths_m[2].any()
    (one_remark,) = swept.remarks
    assert (one_remark.code, one_remark.subject) == ("photographs-without-companion", "far.png")
    assert "1 of 6 views" in one_remark.text


def test_no_two_views_of_one_place_are_refused():
    views = [shoot(camera(0.0), TWO)[0], shoot(camera(0.001), TWO)[0]]
    with pytest.raises(CaptureError, match="no two of 2 photographs"):
        sweep_depths(views)


def test_neighbors_are_the_nearest_at_usable_angles():
    cameras = [camera(x, turn_deg=-np.degrees(np.arctan(x))) for x in (0.0, 0.01, 0.1, -0.2, 0.3, 2.0)]
    assert choose_neighbors(cameras, 0, (0.8, 1.3)) == [2, 3, 4]
    assert choose_neighbors(cameras, 0, (0.8, 1.3), PlaneSweepSettings(neighbors=1)) == [2]


def test_range_is_that_of_the_points_seen():
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-0.2, 0.2, (500, 2)), rng.uniform(0.8, 1.2, 500)])
    behind = points * (1, 1, -1)
    near, far = depth_range_m(CAMERAS, 2, np.concatenate([points, behind]))
    assert 0.7 < near < 0.81
    assert 1.19 < far < 1.35


def test_range_without_points_is_around_what_all_look_at():
    cameras = [camera(x, turn_deg=-np.degrees(np.arctan(x))) for x in (-0.3, 0.0, 0.3)]
    assert depth_range_m(cameras, 1) == pytest.approx((0.5, 2.0))


def test_cameras_that_look_at_nothing_need_points():
    away = [camera(x, turn_deg=np.degrees(np.arctan(x))) for x in (-0.3, 0.0, 0.3)]
    with pytest.raises(CaptureError, match="give points3D"):
        depth_range_m(away, 1)


@pytest.mark.parametrize(
    "wrong",
    [
        {"max_side_px": 4},
        {"neighbors": 0},
        {"min_angle_deg": 40.0},
        {"best_share": 0.0},
        {"step_px": float("nan")},
        {"small_step_cost": 300},
    ],
)
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must be|<="):
        PlaneSweepSettings(**wrong)


def test_wrong_arguments_are_refused(two_planes):
    views = two_planes[0]
    with pytest.raises(ValueError, match="other than itself"):
        sweep_depth(views, 2, [2], RANGE_M)
    with pytest.raises(ValueError, match="near < far"):
        sweep_depth(views, 2, [1], (1.0, 0.5))


def census_cost(photo, other, radius, tolerance):
    """Cost (H, W) of a photograph against one of the same pixels, as sweep_cost defines it; inner pixels only."""
    height, width = photo.shape
    inner = np.s_[radius : height - radius, radius : width - radius]
    cost = np.zeros(photo[inner].shape, int)
    count = 0
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            if dx or dy:
                beside = np.s_[radius + dy : height - radius + dy, radius + dx : width - radius + dx]
                states = []
                for picture in (photo.astype(int), other.astype(int)):
                    difference = picture[beside] - picture[inner]
                    states.append((difference > tolerance).astype(int) - (difference < -tolerance))
                cost += np.abs(states[0] - states[1])
                count += 1
    return (cost * int(256 * 127 / (2 * count)) + 128) // 256


def sweep_cost(photo, others, homographies, radius, tolerance, best_share=1.0):
    settings = _native.SweepCostSettings(window_px=radius, tolerance_64ths=tolerance, best_share=best_share)
    return _native.sweep_cost(photo, others, homographies=homographies, settings=settings, threads=2)


def aside(shift_px):
    return np.array([[1.0, 0, shift_px], [0, 1, 0], [0, 0, 1]])


def test_cost_is_the_census_of_each_plane():
    rng = np.random.default_rng(4)
    photo, other = (rng.integers(0, 16320, (30, 40)).astype(np.int16) for _ in range(2))
    shifts = np.stack([aside(shift) for shift in (0, 3)])
    cost = sweep_cost(photo, [other], shifts[None].copy(), 2, 3000)
    assert cost.shape == (30, 40, 2)
    # The last row and column of a photograph are not between pixels.
    np.testing.assert_array_equal(cost[2:-3, 2:-3, 0], census_cost(photo, other, 2, 3000)[:-1, :-1])
    shifted = np.roll(other, -3, axis=1)
    np.testing.assert_array_equal(cost[2:-3, 2:-6, 1], census_cost(photo, shifted, 2, 3000)[:-1, :-4])
    assert (cost[:, -3:, 1] == 127).all()


def test_cost_is_the_mean_of_the_best():
    rng = np.random.default_rng(5)
    photo, *others = (rng.integers(0, 16320, (20, 30)).astype(np.int16) for _ in range(4))
    stay = np.eye(3)[None, None]
    each = np.stack([sweep_cost(photo, [other], stay, 1, 0)[..., 0] for other in others], -1)
    best = np.sort(each.astype(int), axis=-1)[..., :2].sum(axis=-1)
    together = sweep_cost(photo, others, np.repeat(stay, 3, axis=0), 1, 0, 2 / 3)[..., 0]
    np.testing.assert_array_equal(together[:-1, :-1], ((2 * best + 2) // 4)[:-1, :-1])


def test_photographs_that_do_not_see_a_pixel_do_not_count():
    rng = np.random.default_rng(6)
    photo, other = (rng.integers(0, 16320, (20, 30)).astype(np.int16) for _ in range(2))
    stay, away = np.eye(3), aside(1000)
    alone = sweep_cost(photo, [other], stay[None, None], 1, 0)
    both = sweep_cost(photo, [other, other], np.stack([stay, away])[:, None].copy(), 1, 0)
    np.testing.assert_array_equal(alone, both)


def semiglobal_planes(cost, photo, small, large, edge):
    """The plane with the lowest sum over eight directions, by the equations, one pixel after another."""
    height, width, planes = cost.shape
    total = np.zeros(cost.shape, int)
    for dy, dx in [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]:
        path_cost = np.zeros(cost.shape, int)
        for row in range(height)[:: -1 if dy < 0 else 1]:
            for column in range(width)[:: -1 if dx < 0 else 1]:
                path_cost[row, column] = cost[row, column]
                before = row - dy, column - dx
                if 0 <= before[0] < height and 0 <= before[1] < width:
                    last = path_cost[before]
                    difference = abs(int(photo[row, column]) - int(photo[before]))
                    jump = max(small + 1, int(large * edge / (edge + difference)))
                    beside = np.full(planes + 2, 10**6)
                    beside[1:-1] = last
                    cheapest = np.minimum.reduce(
                        [last, beside[:-2] + small, beside[2:] + small, np.full(planes, last.min() + jump)]
                    )
                    path_cost[row, column] += cheapest - last.min()
        total += path_cost
    return total


def test_planes_are_picked_by_the_equations():
    rng = np.random.default_rng(7)
    cost = rng.integers(0, 128, (9, 11, 6)).astype(np.uint8)
    photo = rng.integers(0, 16320, (9, 11)).astype(np.int16)
    settings = _native.SemiglobalSettings(small_step_cost=10, large_step_cost=60, edge_64ths=1000.0)
    picks = _native.pick_planes(cost, photo, settings=settings, threads=2)
    total = semiglobal_planes(cost, photo, 10, 60, 1000.0)
    best = total.argmin(axis=2)
    assert np.abs(picks.plane - best).max() <= 0.5
    others = np.where(np.abs(np.arange(6) - best[..., None]) > 2, total, 10**6).min(axis=2)
    np.testing.assert_allclose(picks.uniqueness, 1 - total.min(axis=2) / np.minimum(others, 65535), atol=1e-6)
