"""Depth maps of known surfaces, made to agree."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.segmentation.dense.coherence import (
    CoherenceSettings,
    make_depth_coherent,
    measure_noise,
    nearest_views,
)

from tests.support.leaves.views import camera

FOOTPRINT_M = 0.001  # at 1 m


def wall(cam: Pinhole, scale: float = 1.0) -> np.ndarray:
    """Depth of a plane through (0, 0, 1), tilted."""
    normal = np.array([0.3, -0.2, 1.0])
    return (scale - cam.position_m @ normal) / (cam.rays() @ normal)


def square(cam: Pinhole, half: float = 0.03, z: float = 0.8, scale: float = 1.0) -> np.ndarray:
    """Depth of an upright square before the wall, infinite beside it."""
    rays = cam.rays()
    place = (cam.position_m + rays * (z * scale))[..., :2]
    return np.where((abs(place) < half * scale).all(axis=-1), z * scale, np.inf)


def view(cam: Pinhole, depth: np.ndarray) -> View:
    return View(
        name="drawn.png", camera=cam, srgb=np.zeros((*depth.shape, 3), np.uint8), depth_m=depth.astype(np.float32)
    )


def views_of_wall(
    count: int, noise_m: float = 0.0, scale: float = 1.0, front: bool = False
) -> tuple[list[View], list[np.ndarray]]:
    """Views beside each other; their exact depth."""
    rng = np.random.default_rng(0)
    cameras = [camera(200, 150, x=0.01 * (k - count // 2), scale=scale) for k in range(count)]
    exact = [np.minimum(wall(cam, scale), square(cam, scale=scale) if front else np.inf) for cam in cameras]
    noisy = [depth + rng.normal(0, noise_m * scale, depth.shape) for depth in exact]
    return [view(cam, depth) for cam, depth in zip(cameras, noisy, strict=True)], exact


def test_one_view_stays_as_it_is():
    (only,), _ = views_of_wall(1, 0.001)
    result = make_depth_coherent([only])
    assert np.array_equal(result.depth_m[0], only.depth_m)
    assert result.noise_m == result.raw_noise_m
    assert result.filled_px == result.replaced_px == result.removed_px == (0,)


def test_views_of_other_places_stay_as_they_are():
    here, there = camera(120, 90), camera(120, 90, x=-5.0)
    views = [view(cam, wall(cam)) for cam in (here, there)]
    result = make_depth_coherent(views)
    for one, depth in zip(views, result.depth_m, strict=True):
        assert np.array_equal(depth, one.depth_m)


def test_no_views_no_depth():
    assert make_depth_coherent([]).depth_m == ()
    cam = camera(40, 30)
    result = make_depth_coherent([view(cam, np.zeros((30, 40))), view(cam, np.zeros((30, 40)))])
    assert not result.depth_m[0].any()
    assert result.noise_m == (0.0, 0.0)


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_noise_is_averaged_out(scale):
    views, exact = views_of_wall(5, 0.002, scale)
    result = make_depth_coherent(views)
    for depth, raw, true in zip(result.depth_m, views, exact, strict=True):
        inner = np.s_[20:-20, 40:-40]  # that all of them see
        assert np.std((depth - true)[inner]) < 0.55 * np.std((raw.depth_m - true)[inner])
        assert abs(np.mean((depth - true)[inner])) < 0.0003 * scale
    assert result.noise_m[2] < 0.6 * result.raw_noise_m[2]


def test_holes_are_filled_and_outliers_replaced():
    views, exact = views_of_wall(5, 0.0005)
    raw = views[2].depth_m.copy()
    raw[40:50, 90:110] = 0
    raw[90:95, 90:95] = 0.7
    views[2] = view(views[2].camera, raw)
    result = make_depth_coherent(views)
    assert abs(result.depth_m[2] - exact[2])[20:-20, 40:-40].max() < 0.004
    assert result.filled_px[2] >= 200
    assert result.replaced_px[2] >= 25


def test_what_lies_behind_does_not_shine_through():
    views, exact = views_of_wall(5, 0.0005, front=True)
    result = make_depth_coherent(views)
    for depth, true in zip(result.depth_m, exact, strict=True):
        on_square = true < 0.81
        assert on_square.sum() > 5000
        assert abs(depth - true)[on_square].max() < 0.004
        # and the square does not grow by more than the pixel at its edge that a point falls on
        wrong = (abs(depth - true) > 0.01) & (depth > 0) & ~on_square
        assert wrong.sum() < 0.02 * on_square.sum()


def test_depth_that_others_look_through_is_removed():
    views, _ = views_of_wall(2)
    raw = views[0].depth_m.copy()
    raw[60:80, 90:110] = 0.5
    result = make_depth_coherent([view(views[0].camera, raw), views[1]])
    assert not result.depth_m[0][62:78, 92:108].any()  # one other view is not enough to fill it
    assert result.removed_px[0] == pytest.approx(400, abs=40)


def test_a_view_without_depth_gets_what_the_others_see():
    views, exact = views_of_wall(5, 0.0005)
    empty = view(views[2].camera, np.zeros_like(exact[2]))
    result = make_depth_coherent([*views[:2], empty, *views[3:]])
    inner = np.s_[20:-20, 40:-40]
    assert (result.depth_m[2][inner] > 0).mean() > 0.95
    assert result.raw_noise_m[2] == 0


def test_order_and_threads_do_not_matter():
    views, _ = views_of_wall(4, 0.001, front=True)
    done = []
    forward = make_depth_coherent(views, progress=lambda k, n: done.append((k, n)), threads=1)
    backward = make_depth_coherent(views[::-1], threads=3)
    for a, b in zip(forward.depth_m, backward.depth_m[::-1], strict=True):
        assert a == pytest.approx(b, abs=1e-6)
    again = make_depth_coherent(views, threads=3)
    assert all(np.array_equal(a, b) for a, b in zip(forward.depth_m, again.depth_m, strict=True))
    assert forward.noise_m == again.noise_m
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]


@given(sigma=st.floats(0.0002, 0.004), exponent=st.floats(-2, 2))
@settings(max_examples=15, deadline=None)
def test_noise_is_measured(sigma, exponent):
    scale = 10.0**exponent
    (one,), _ = views_of_wall(1, sigma, scale)
    assert measure_noise(one) == pytest.approx(sigma * scale, rel=0.3)


def test_steps_of_rounded_depth_count_as_noise():
    (one,), exact = views_of_wall(1)
    step = 4 * FOOTPRINT_M / 3
    rounded = view(one.camera, np.round(exact[0] / step) * step)
    assert 0.15 * step < measure_noise(rounded) < 0.6 * step
    assert measure_noise(one) < 1e-5


def test_a_coarse_wall_behind_does_not_hide_the_noise():
    cam = camera(200, 150)
    rng = np.random.default_rng(0)
    front = square(cam, half=0.02)
    behind = np.round((wall(cam) + rng.normal(0, 0.001, front.shape)) / 0.02) * 0.02
    one = view(cam, np.where(np.isfinite(front), front + rng.normal(0, 0.001, front.shape), behind))
    assert measure_noise(one) == pytest.approx(0.001, rel=0.3)


def test_nearest_views_look_in_the_same_direction():
    turned = np.diag([-1.0, 1.0, -1.0])
    back = Pinhole(
        width_px=40,
        height_px=30,
        focal_px=(100, 100),
        center_px=(20, 15),
        cam_from_world=np.column_stack([turned, np.zeros(3)]),
    )
    cameras = [camera(40, 30, x=x) for x in (0.0, 0.3, 0.1, -0.2)] + [back]
    assert nearest_views(cameras, 0, range(5), 1.0, 3) == [2, 3, 1]
    assert nearest_views(cameras, 0, [0, 1, 4], 1.0, 10) == [1, 4]
    assert nearest_views(cameras, 0, range(5), 1.0, 0) == []


@pytest.mark.parametrize("wrong", [{"neighbors": -1}, {"min_own": 1}, {"footprints": -1.0}, {"noise_samples": 0}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValueError, match="not"):
        CoherenceSettings(**wrong)
