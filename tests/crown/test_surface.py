import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.crown.silhouette import StarSilhouette, fit_star_silhouette
from usdfoliage.crown.surface import SPHERE_TANGENT, SurfaceSettings, inflate_silhouette
from usdfoliage.errors import FitError

from tests.support.crown_shapes import disc_mask, ellipse_mask


def circle(radius_px: float, angles: int = 1024) -> StarSilhouette:
    return StarSilhouette(center_px=np.array([0.0, 0.0]), radius_px=np.full(angles, radius_px), lost_share=0.0, iou=1.0)


def test_a_circle_with_the_sphere_tangent_meets_the_closed_form():
    surface = inflate_silhouette(circle(100), SurfaceSettings(grid=160, tangent=SPHERE_TANGENT, smoothing=0.01))

    points = surface.points * surface.cell_px / 100
    # (R (3ρ − ρ³)/2, R k (1 − ρ²)/2): invert the first for ρ and compare the second.
    share = np.linspace(0, 1, 2001)
    rho = np.interp(np.hypot(points[:, 0], points[:, 1]), (3 * share - share**3) / 2, share)
    assert points[:, 2] == pytest.approx(1 - rho**2, abs=0.025)


@pytest.mark.parametrize("size_px", [64, 150, 300])
def test_a_disc_becomes_a_ball_by_the_automatic_tangent(size_px):
    mask = disc_mask(0.42 * size_px, size_px=size_px)

    surface = inflate_silhouette(fit_star_silhouette(mask))

    radius = np.linalg.norm(surface.points, axis=1) * surface.cell_px
    assert radius == pytest.approx(np.full(len(radius), 0.42 * size_px), rel=0.03)


def test_a_tall_ellipse_becomes_as_deep_as_wide():
    surface = inflate_silhouette(fit_star_silhouette(ellipse_mask(60, 110)))

    depth = surface.points[:, 2].max() * surface.cell_px
    assert depth == pytest.approx(60, rel=0.06)


def test_depth_grows_with_the_tangent_and_the_silhouette_stays():
    silhouette = fit_star_silhouette(disc_mask(100))
    flat, deep = (inflate_silhouette(silhouette, SurfaceSettings(grid=100, tangent=k)) for k in (1.0, 3.0))

    assert deep.points[:, 2].max() == pytest.approx(3 * flat.points[:, 2].max(), rel=1e-6)  # z is linear in k
    assert deep.points[:, :2] == pytest.approx(flat.points[:, :2])
    rim = flat.points[:, 2] == 0
    assert np.linalg.norm(flat.points[rim], axis=1) * flat.cell_px == pytest.approx(np.full(rim.sum(), 100), abs=1.2)


def test_a_tangent_map_acts_where_it_is_set():
    silhouette = fit_star_silhouette(disc_mask(100))
    upper_steep = np.full((2, 1), 1.0)
    upper_steep[0] = 3.0  # row 0 is the upper half of the picture

    surface = inflate_silhouette(silhouette, SurfaceSettings(grid=100), tangent_map=upper_steep)

    above, below = (surface.points[side * surface.points[:, 1] > 20][:, 2].mean() for side in (1, -1))
    assert above > 1.5 * below


def test_a_constant_tangent_map_equals_the_number():
    silhouette = fit_star_silhouette(ellipse_mask(80, 100))
    by_map = inflate_silhouette(silhouette, SurfaceSettings(grid=64), tangent_map=np.full((5, 7), 1.7))
    by_number = inflate_silhouette(silhouette, SurfaceSettings(grid=64, tangent=1.7))

    assert by_map.points == pytest.approx(by_number.points)


def test_triangles_face_the_camera_and_cover_the_silhouette():
    surface = inflate_silhouette(fit_star_silhouette(disc_mask(100)), SurfaceSettings(grid=80))

    a, b, c = (surface.points[surface.triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)[:, 2] / 2 * surface.cell_px**2
    assert area.sum() == pytest.approx(np.pi * 100**2, rel=0.03)
    assert np.mean(area > 0) > 0.99


@settings(max_examples=8, deadline=None)
@given(scale=st.floats(0.3, 8.0))
def test_shape_does_not_depend_on_the_photographs_resolution(scale):
    radius = 100 + 12 * np.cos(3 * 2 * np.pi * np.arange(512) / 512)
    silhouette = StarSilhouette(center_px=np.zeros(2), radius_px=radius, lost_share=0.0, iou=1.0)
    larger = StarSilhouette(center_px=np.zeros(2), radius_px=radius * scale, lost_share=0.0, iou=1.0)
    one, other = (inflate_silhouette(s, SurfaceSettings(grid=64)) for s in (silhouette, larger))

    assert other.points[:, 2].max() == pytest.approx(one.points[:, 2].max(), rel=0.05)
    assert other.cell_px == pytest.approx(one.cell_px * scale)


def test_a_hair_is_refused():
    radius = np.full(512, 0.4)
    radius[0] = 100
    thin = StarSilhouette(center_px=np.zeros(2), radius_px=radius, lost_share=0.0, iou=1.0)
    with pytest.raises(FitError, match="thin"):
        inflate_silhouette(thin, SurfaceSettings(grid=64))


@pytest.mark.parametrize("wrong", [np.zeros((2, 2)), np.full((2, 2), np.nan), np.ones(3)])
def test_a_tangent_map_must_be_positive_numbers(wrong):
    with pytest.raises(ValueError, match="tangent_map"):
        inflate_silhouette(circle(50), SurfaceSettings(grid=32), tangent_map=wrong)


@pytest.mark.parametrize("wrong", [{"grid": 8}, {"tangent": 0.0}, {"tangent": np.inf}, {"tangent_nodes": 1}])
def test_settings_are_checked(wrong):
    with pytest.raises(ValueError, match="must be"):
        SurfaceSettings(**wrong)
