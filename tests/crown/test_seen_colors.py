"""Colours of a captured crown: the truth where it is seen, no gaps elsewhere, none of what is behind."""

import numpy as np
import pytest
from usdfoliage.crown.seen_colors import SeenColorSettings, fill_unseen, gather_colors
from usdfoliage.crown.views import reduce_view
from usdfoliage.errors import FitError
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.geometry.cubemap import face_directions, share_borders

from tests.support.captured_crowns import BACKGROUND, CENTER_M, ring, sphere, true_color, views_of

SIZE = 32
RADIUS_M = np.ones((6, SIZE, SIZE))


@pytest.fixture(scope="module")
def views():
    made = views_of(ring(8), sphere)
    return [reduce_view(view, CENTER_M, 1.1, 128) for view in made]


def test_seen_texels_have_their_colour_and_the_underside_has_none(views):
    colors = gather_colors(RADIUS_M, CENTER_M, views)

    directions = face_directions(SIZE)
    error = np.abs(colors.color - true_color(directions)).max(axis=-1)[colors.seen]
    assert np.median(error) < 0.005
    assert np.quantile(error, 0.98) < 0.03
    assert colors.seen[directions[..., 1] > 0].mean() > 0.98
    assert not colors.seen[directions[..., 1] < -0.95].any()
    assert (colors.texels > 500).all()


def test_a_texel_is_not_seen_through_the_crown(views):
    one = gather_colors(RADIUS_M, CENTER_M, views[:1])

    toward = views[0].camera.position_m - CENTER_M
    toward /= np.linalg.norm(toward)
    facing = face_directions(SIZE) @ toward
    assert one.seen[facing > 0.6].all()
    assert not one.seen[facing < 0.2].any()


def test_a_photograph_that_disagrees_is_not_believed(views):
    false = views_of(ring(8)[3:4], sphere, color=lambda d: np.full((*d.shape[:-1], 3), 0.9))
    wrong = reduce_view(false[0], CENTER_M, 1.1, 128)

    right = gather_colors(RADIUS_M, CENTER_M, views)
    mixed = gather_colors(RADIUS_M, CENTER_M, [*views[:3], wrong, *views[4:]])

    # Where at least three others show a place, its mean tone stays.
    level = right.seen & (face_directions(SIZE)[..., 1] > 0.6)
    assert np.median(np.abs(mixed.color - right.color)[level]) < 0.02  # the false one differs by 0.6


def test_what_is_unseen_is_filled_with_what_is_seen(views):
    colors = gather_colors(RADIUS_M, CENTER_M, views)

    filled, summary = fill_unseen(colors, RADIUS_M, CENTER_M, views, np.random.default_rng(0))

    assert np.isfinite(filled).all()
    assert (filled >= 0).all()
    np.testing.assert_array_equal(filled, share_borders(filled))
    assert "seen by no photograph" in summary
    under = filled[face_directions(SIZE)[..., 1] < -0.9]
    low, high = (np.quantile(colors.color[colors.seen], share, axis=0) for share in (0.0, 1.0))
    assert (np.median(under, axis=0) > 0.8 * low).all()
    assert (np.median(under, axis=0) < 1.2 * high).all()
    again, _ = fill_unseen(colors, RADIUS_M, CENTER_M, views, np.random.default_rng(0))
    np.testing.assert_array_equal(filled, again)


def test_nothing_of_the_background_is_seen(views):
    large = 1.05 * RADIUS_M  # beyond the plant, so that its edge lies over the background
    settings = SeenColorSettings()

    colors = gather_colors(large, CENTER_M, views, settings)

    blue = decode_srgb(np.array(BACKGROUND) / 255)
    assert np.linalg.norm(colors.color[colors.seen] - blue, axis=-1).min() > 0.2


def test_a_crown_that_no_photograph_shows_is_refused():
    elsewhere = [reduce_view(view, CENTER_M, 1.1, 128) for view in views_of(ring(1), sphere)]
    colors = gather_colors(RADIUS_M, CENTER_M + np.array([0, 0, 50.0]), elsewhere)  # beside the picture

    assert not colors.seen.any()
    with pytest.raises(FitError, match="no photograph shows the crown"):
        fill_unseen(colors, RADIUS_M, CENTER_M, elsewhere, np.random.default_rng(0))
