import numpy as np
import pytest
from usdfoliage.crown.radius import RadiusSettings, front_outline, render_radius, within_outline
from usdfoliage.crown.silhouette import fit_star_silhouette
from usdfoliage.crown.surface import CrownSurface, SurfaceSettings, inflate_silhouette
from usdfoliage.errors import FitError
from usdfoliage.geometry.cubemap import FACES, face_directions, share_borders

from tests.support.crown_shapes import disc_mask, ellipse_mask, ellipsoid_radius


def half_box(half: float = 1.0) -> CrownSurface:
    """The front half of a cube of side 2: lid and four walls down to z = 0."""
    h = half
    points = np.array([[x, y, z] for z in (0, h) for y in (-h, h) for x in (-h, h)], float)
    quads = [(4, 5, 7, 6), (0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
    return CrownSurface(points=points, triangles=triangles, cell_px=1.0)


def test_a_box_is_met_exactly_in_every_direction():
    radius = render_radius(half_box(), RadiusSettings(size=17))

    on_cube = 1 / np.abs(face_directions(17)).max(axis=-1)
    assert radius == pytest.approx(on_cube, rel=1e-12)


def test_a_disc_gives_a_ball_front_and_back():
    surface = inflate_silhouette(fit_star_silhouette(disc_mask(120)))
    radius = render_radius(surface, RadiusSettings(size=64)) * surface.cell_px

    assert radius == pytest.approx(np.full_like(radius, 120), rel=0.03)
    front, back = radius[FACES.index("+Z")], radius[FACES.index("-Z")]
    assert back[:, ::-1] == pytest.approx(front)


def test_result_does_not_depend_on_the_number_of_threads():
    surface = inflate_silhouette(fit_star_silhouette(ellipse_mask(60, 100)), SurfaceSettings(grid=60))
    one, four = (render_radius(surface, RadiusSettings(size=33, threads=n)) for n in (1, 4))

    assert np.array_equal(one, four)


def test_shared_border_texels_agree():
    surface = inflate_silhouette(fit_star_silhouette(ellipse_mask(60, 100)), SurfaceSettings(grid=60))
    radius = render_radius(surface, RadiusSettings(size=33))

    assert share_borders(radius) == pytest.approx(radius, rel=1e-9)


def test_turned_copies_fill_the_side_and_keep_the_front():
    surface = inflate_silhouette(fit_star_silhouette(disc_mask(100)), SurfaceSettings(grid=80, tangent=1.0))  # flat
    one = render_radius(surface, RadiusSettings(size=48))
    two = render_radius(surface, RadiusSettings(size=48, copies=2))

    # Texels round the depth of the flat ball by half a texel.
    assert two[FACES.index("+Z")].mean() > 1.3 * one[FACES.index("+Z")].mean()
    assert (two >= one - 1e-9).all()
    assert front_outline(two) == pytest.approx(front_outline(one), rel=0.02)


def test_outline_of_an_ellipsoid_is_its_ellipse():
    outline = front_outline(ellipsoid_radius((2.0, 1.0, 3.0), 129))

    angle = 2 * np.pi * np.arange(len(outline)) / len(outline)
    assert outline == pytest.approx(1 / np.hypot(np.cos(angle) / 2, np.sin(angle)), rel=2e-3)


def test_cutting_to_an_outline_shows_that_outline():
    ball = np.full((6, 65, 65), 2.0)
    angle = 2 * np.pi * np.arange(512) / 512
    wanted = 1.5 + 0.2 * np.cos(2 * angle)

    cut = within_outline(ball, wanted)

    outline = front_outline(cut, angles=512)
    assert outline == pytest.approx(wanted, rel=0.02)
    assert (outline <= wanted * 1.002).all()
    facing = face_directions(65)[..., 2] > 0.9
    assert (cut[facing] == 2.0).all()


def test_a_surface_with_a_hole_is_refused():
    box = half_box()
    with pytest.raises(FitError, match="rays"):
        render_radius(CrownSurface(points=box.points, triangles=box.triangles[2:], cell_px=1.0), RadiusSettings(size=9))


@pytest.mark.parametrize("wrong", [{"size": 0}, {"size": 7}, {"copies": 0}, {"copies": 5}])
def test_settings_are_checked(wrong):
    with pytest.raises(ValueError, match="must be from"):
        RadiusSettings(**wrong)
