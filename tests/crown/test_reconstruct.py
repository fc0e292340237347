"""A whole captured crown, from points and pictures to a model."""

from dataclasses import replace

import numpy as np
import pytest
from usdfoliage.crown.reconstruct import CapturedCrownSettings, reconstruct_captured_crown
from usdfoliage.errors import FitError
from usdfoliage.geometry.cubemap import share_borders

from tests.support.captured_crowns import CENTER_M, look_at, lumpy, ring, surface_points, true_radius, views_of

SETTINGS = CapturedCrownSettings(size=32)


@pytest.fixture(scope="module")
def views():
    return views_of(ring(8), lumpy)


@pytest.fixture(scope="module")
def made(views):
    return reconstruct_captured_crown(surface_points(lumpy, 8000), views, SETTINGS)


def test_the_model_keeps_its_promises(made):
    model, measures = made

    assert (model.radius_m.shape, model.radius_m.dtype) == ((6, 32, 32), np.float32)
    assert (model.color.shape, model.color.dtype) == ((6, 32, 32, 3), np.float32)
    assert (model.radius_m > 0).all()
    assert np.isfinite(model.color).all()
    assert (model.color >= 0).all()
    np.testing.assert_array_equal(model.radius_m, share_borders(model.radius_m))
    np.testing.assert_array_equal(model.color, share_borders(model.color))
    assert np.abs(model.radius_m - true_radius(lumpy, model.center_m, 32)).mean() < 0.04
    assert measures.known > 0.99
    assert min(view.mask_iou for view in measures.views) > 0.93
    assert measures.volume_m3 == pytest.approx(4.19, rel=0.15)


def test_the_same_input_gives_the_same_model(made, views):
    again, _ = reconstruct_captured_crown(surface_points(lumpy, 8000), views, SETTINGS)

    np.testing.assert_array_equal(again.radius_m, made[0].radius_m)
    np.testing.assert_array_equal(again.color, made[0].color)


def test_every_photograph_is_read_once_and_one_without_the_crown_is_reported(views):
    reads = []

    def counted(view):
        return replace(view, read=lambda: reads.append(view.name) or view.read())

    away = replace(
        views[0], name="away.png", camera=look_at(CENTER_M + np.array([0, 0, 4.0]), CENTER_M + np.array([0, 0, 9.0]))
    )
    _, measures = reconstruct_captured_crown(
        surface_points(lumpy, 4000), [*map(counted, views), counted(away)], SETTINGS
    )

    assert sorted(reads) == [view.name for view in views]
    assert "1 of 9 photographs do not show the crown" in measures.remarks[0].text


def test_no_photograph_at_all_is_refused():
    with pytest.raises(FitError, match="none of 0 photographs"):
        reconstruct_captured_crown(surface_points(lumpy, 4000), [], SETTINGS)


def test_points_must_be_finite_and_flags_as_many(views):
    points_m = surface_points(lumpy, 500)
    with pytest.raises(ValueError, match="foliage"):
        reconstruct_captured_crown(points_m, views, SETTINGS, foliage=np.ones(3, bool))
    points_m[0] = np.nan
    with pytest.raises(ValueError, match="finite"):
        reconstruct_captured_crown(points_m, views, SETTINGS)
