"""Colours of a crown from its points, on a ball whose colours are known."""

import numpy as np
import pytest
from usdfoliage.crown.point_colors import LIGHT, SHADE, SHELL, gather_point_colors, shade_points
from usdfoliage.crown.reconstruct import CLOUD_STEPS, CapturedCrownSettings, reconstruct_cloud_crown
from usdfoliage.errors import FitError
from usdfoliage.geometry.cubemap import face_directions, share_borders

from tests.support.captured_crowns import CENTER_M, lumpy, sphere, surface_points, true_color, true_radius

SETTINGS = CapturedCrownSettings(size=32)
PLAIN = (0.1, 0.3, 0.05)


def colors_of(points_m):
    toward = points_m - CENTER_M
    return true_color(toward / np.linalg.norm(toward, axis=1, keepdims=True))


def test_colours_are_those_of_the_outermost_points():
    outer = surface_points(sphere, 20_000)
    inner = CENTER_M + 0.5 * (surface_points(sphere, 20_000, seed=1) - CENTER_M)  # red, and hidden
    points = np.concatenate([outer, inner, CENTER_M[None]])
    colors = np.concatenate([colors_of(outer), np.tile([0.9, 0.0, 0.0], (len(inner) + 1, 1))])

    color, seen = gather_point_colors(np.ones((6, 24, 24)), CENTER_M, points, colors)

    assert seen.all()
    assert np.abs(color - true_color(face_directions(24))).max() < 0.02


def test_where_there_is_no_point_there_is_no_colour():
    points = surface_points(sphere, 5000)
    points = points[points[:, 1] > CENTER_M[1]]
    color, seen = gather_point_colors(np.ones((6, 24, 24)), CENTER_M, points, colors_of(points))
    up = face_directions(24)[..., 1]
    assert seen[up > 0.05].all()
    assert not seen[up < -0.12].any()
    assert not color[~seen].any()
    within = CENTER_M + 0.1 * (points - CENTER_M)
    assert not gather_point_colors(np.ones((6, 24, 24)), CENTER_M, within, colors_of(points))[1].any()


def test_points_without_colours_are_darker_the_deeper_they_lie():
    away = np.array([2 - SHELL, 1.0, (1 + SHELL) / 2, SHELL, 0.1])
    points = CENTER_M + away[:, None] * np.array([0, 0.6, 0.8])
    shaded = shade_points(np.ones((6, 8, 8)), CENTER_M, points, PLAIN)
    middle = (LIGHT + SHADE) / 2
    expected = [LIGHT, middle, (middle + SHADE) / 2, SHADE, SHADE]
    np.testing.assert_allclose(shaded, np.outer(expected, PLAIN), rtol=1e-6)


@pytest.mark.parametrize("has_colors", [True, False])
def test_a_cloud_alone_makes_a_crown(has_colors):
    points = surface_points(lumpy, 8000)
    steps = []
    model, measures = reconstruct_cloud_crown(
        points,
        SETTINGS,
        plain=PLAIN,
        colors=colors_of(points) if has_colors else None,
        progress=lambda step, share: steps.append(step),
    )

    assert np.abs(model.radius_m - true_radius(lumpy, model.center_m, 32)).mean() < 0.04
    np.testing.assert_array_equal(model.radius_m, share_borders(model.radius_m))
    np.testing.assert_array_equal(model.color, share_borders(model.color))
    if has_colors:
        toward = face_directions(32) * model.radius_m[..., None] + model.center_m - CENTER_M
        assert np.abs(model.color - true_color(toward / np.linalg.norm(toward, axis=-1, keepdims=True))).mean() < 0.01
    else:  # one colour, by how far out
        ratio = model.color / np.array(PLAIN)
        assert np.ptp(ratio, axis=-1).max() < 1e-4
        assert ratio.min() >= SHADE - 1e-4
        assert ratio.max() <= LIGHT + 1e-4
    assert min(view.cloud_iou for view in measures.views) > 0.9
    assert [view.name for view in measures.views] == ["front", "right", "back", "left"]
    assert measures.seen > 0.99
    assert set(steps) == set(CLOUD_STEPS) == set(measures.seconds)
    again, _ = reconstruct_cloud_crown(points, SETTINGS, plain=PLAIN, colors=colors_of(points) if has_colors else None)
    np.testing.assert_array_equal(again.color, model.color)


def test_what_is_no_cloud_is_refused():
    with pytest.raises(FitError):
        reconstruct_cloud_crown(np.zeros((3, 3)), SETTINGS, plain=PLAIN)
    points = surface_points(sphere, 500)
    for wrong in ({"colors": np.ones((3, 3))}, {"foliage": np.ones(3, bool)}):
        with pytest.raises(ValueError, match=r"must be \(500"):
            reconstruct_cloud_crown(points, SETTINGS, plain=PLAIN, **wrong)


def test_points_without_colour_leave_the_shape_and_take_what_is_around():
    points = surface_points(lumpy, 8000)
    colors = colors_of(points)
    colors[np.random.default_rng(2).random(len(points)) < 0.5] = np.nan

    whole, _ = reconstruct_cloud_crown(points, SETTINGS, plain=PLAIN, colors=colors_of(points))
    model, measures = reconstruct_cloud_crown(points, SETTINGS, plain=PLAIN, colors=colors)

    np.testing.assert_array_equal(model.radius_m, whole.radius_m)
    assert np.abs(model.color - whole.color).mean() < 0.01
    assert "of 50% of its points" in measures.remarks[0].text or "of 49% of its points" in measures.remarks[0].text
    bare, measures = reconstruct_cloud_crown(points, SETTINGS, plain=PLAIN, colors=np.full_like(colors, np.nan))
    assert "no colours that show leaves" in measures.remarks[0].text
    np.testing.assert_allclose(np.ptp(bare.color / np.array(PLAIN), axis=-1), 0, atol=1e-4)
