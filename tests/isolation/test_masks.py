"""Where in photographs the plant is."""

import numpy as np
import pytest
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.isolation.masks import draw_plant_mask, expect_plant, make_plant_grid

from tests.support.captures import look_at

RADIUS_M = 0.3
MIDDLE_M = np.array([0.0, 0.5, 0.0])
SIZE = (240, 180)


def camera_at(turn_rad: float) -> Pinhole:
    place = (2 * np.cos(turn_rad), 1.2, 2 * np.sin(turn_rad))
    return Pinhole(
        width_px=SIZE[0], height_px=SIZE[1], focal_px=(260, 260), center_px=(120, 90),
        cam_from_world=look_at(place, MIDDLE_M),
    )  # fmt: skip


def see(camera: Pinhole) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A green ball over a grey floor: colours, points (NaN for sky), and which pixels are the ball."""
    rotation = camera.cam_from_world[:, :3]
    rays = camera.rays() @ rotation
    origin = camera.position_m
    to_middle = origin - MIDDLE_M
    a, b = np.sum(rays**2, axis=2), rays @ to_middle
    under = b**2 - a * (to_middle @ to_middle - RADIUS_M**2)
    ball = (under > 0) & (b < 0)
    depth_m = np.where(ball, (-b - np.sqrt(np.maximum(under, 0))) / a, np.nan)
    floor = ~ball & (rays[..., 1] < -0.05)
    depth_m[floor] = -origin[1] / rays[..., 1][floor]
    srgb = np.full((*ball.shape, 3), (150, 190, 240), np.uint8)
    srgb[ball], srgb[floor] = (60, 150, 40), (110, 108, 104)
    return srgb, origin + rays * depth_m[..., None], ball


@pytest.fixture(scope="module")
def cloud() -> tuple[np.ndarray, np.ndarray]:
    """Points of some views, and which are of the ball."""
    seen = [see(camera_at(turn)) for turn in np.arange(8) * np.pi / 4]
    points = np.concatenate([points[np.isfinite(points[..., 0])] for _, points, _ in seen])
    ball = np.concatenate([ball[np.isfinite(points[..., 0])] for _, points, ball in seen])
    return points, ball


def intersection_over_union(first: np.ndarray, second: np.ndarray) -> float:
    return float((first & second).sum() / (first | second).sum())


def draw(cloud, turn_rad: float, points_m: np.ndarray) -> np.ndarray:
    points, ball = cloud
    camera = camera_at(turn_rad)
    return draw_plant_mask(
        see(camera)[0], points_m, make_plant_grid(points, ball), expect_plant(camera, points[ball], 0.01)
    )


def test_with_depth_everywhere_the_mask_is_exact(cloud) -> None:
    _, points, ball = see(camera_at(0.3))
    assert intersection_over_union(draw(cloud, 0.3, points), ball) > 0.98


def test_where_depth_is_missing_colours_and_points_decide(cloud) -> None:
    """As matching leaves it: nothing at outlines, nothing in places, single pixels of noise."""
    rng = np.random.default_rng(1)
    _, points, ball = see(camera_at(0.3))
    holes = points.copy()
    rows, columns = np.nonzero(ball ^ np.roll(ball, 3, axis=1) | ball ^ np.roll(ball, 3, axis=0))
    holes[rows, columns] = np.nan
    holes[70:95, 100:130] = np.nan
    holes[rng.random(ball.shape) < 0.3] = np.nan
    noise = rng.random(ball.shape) < 0.001
    holes[noise] = MIDDLE_M
    assert intersection_over_union(draw(cloud, 0.3, holes), ball) > 0.95


def test_a_view_without_any_depth_shows_the_plant_where_its_points_are(cloud) -> None:
    _, points, ball = see(camera_at(0.3))
    assert intersection_over_union(draw(cloud, 0.3, np.full_like(points, np.nan)), ball) > 0.9


def test_a_view_past_the_plant_has_an_empty_mask(cloud) -> None:
    points, ball = cloud
    camera = camera_at(0.3)
    away = camera.cam_from_world.copy()
    away[:, :3] = np.diag([-1.0, 1, -1]) @ away[:, :3]
    away[:, 3] = np.diag([-1.0, 1, -1]) @ away[:, 3]
    behind = Pinhole(width_px=SIZE[0], height_px=SIZE[1], focal_px=(260, 260), center_px=(120, 90), cam_from_world=away)
    srgb, seen_m, _ = see(behind)
    expected = expect_plant(behind, points[ball], 0.01)
    assert not expected.any()
    assert not draw_plant_mask(srgb, seen_m, make_plant_grid(points, ball), expected).any()


def test_a_grid_without_a_plant_is_refused() -> None:
    with pytest.raises(ValueError, match="of the plant"):
        make_plant_grid(np.zeros((3, 3)), np.zeros(3, bool))
