"""Which points are crown: trunks, bushes, layers on the ground, leaves, and the centre."""

import numpy as np
import pytest
from usdfoliage.crown.crown_points import CrownPointSettings, choose_crown_points, find_crown_center
from usdfoliage.crown.leaf_colors import find_green_points
from usdfoliage.errors import FitError

from tests.support.captured_crowns import CENTER_M, ellipsoid, sphere, surface_points


def trunk(top_m, count=1500, radius_m=0.08, seed=1):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, count)
    return np.column_stack(
        [
            CENTER_M[0] + radius_m * np.cos(angle),
            rng.uniform(0, top_m, count),
            CENTER_M[2] + radius_m * np.sin(angle),
        ]
    )


def test_a_trunk_is_no_crown():
    crown_m, trunk_m = surface_points(sphere, 8000), trunk(1.0)

    chosen = choose_crown_points(np.concatenate([crown_m, trunk_m]))

    assert chosen.base_m == pytest.approx(1.0, abs=0.1)
    assert chosen.chosen[:8000].mean() > 0.98
    assert chosen.chosen[8000:].mean() < 0.05


def test_a_bush_is_crown_down_to_the_ground():
    bush_m = surface_points(ellipsoid, 8000)
    bush_m = bush_m[bush_m[:, 1] > CENTER_M[1]]  # its widest place is the ground

    chosen = choose_crown_points(bush_m)

    assert chosen.base_m == pytest.approx(bush_m[:, 1].min(), abs=0.01)
    assert chosen.chosen.mean() > 0.98


def test_a_layer_on_the_ground_is_no_crown():
    rng = np.random.default_rng(2)
    meadow_m = np.column_stack([rng.uniform(-6, 6, 6000), rng.uniform(0, 0.05, 6000), rng.uniform(-6, 6, 6000)])
    crown_m = surface_points(sphere, 8000)

    chosen = choose_crown_points(np.concatenate([crown_m, trunk(1.0), meadow_m]))

    assert chosen.base_m == pytest.approx(1.0, abs=0.1)
    assert not chosen.chosen[-6000:].any()


def test_with_leaves_the_crown_is_made_of_them():
    crown_m = surface_points(sphere, 8000)
    wall_m = np.column_stack([*np.random.default_rng(3).uniform(-3, 3, (2, 6000)), np.full(6000, -2.0)])
    wall_m[:, 1] += 3
    foliage = np.repeat([True, False], [8000, 6000])

    chosen = choose_crown_points(np.concatenate([crown_m, wall_m]), foliage=foliage)

    assert chosen.chosen[:8000].mean() > 0.98
    assert not chosen.chosen[8000:].any()


def test_too_few_points_are_refused():
    with pytest.raises(FitError, match="20 points of the plant, 100 needed"):
        choose_crown_points(surface_points(sphere, 20))


def test_the_centre_of_a_ball_is_its_middle():
    center = find_crown_center(surface_points(sphere, 20_000))

    assert center.center_m == pytest.approx(CENTER_M, abs=0.05)
    assert 0 < center.filled <= 1


def test_the_centre_of_a_mushroom_is_in_its_cap():
    cap_m = surface_points(sphere, 20_000)
    cap_m = cap_m[cap_m[:, 1] > CENTER_M[1]]
    stem_m = trunk(CENTER_M[1], 3000, radius_m=0.3)  # so wide that it is no trunk

    center = find_crown_center(np.concatenate([cap_m, stem_m]))

    middle_m = CENTER_M[1] + 0.5 - 1.0
    assert center.center_m[1] > middle_m


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="trunk_width"):
        CrownPointSettings(trunk_width=1.0)


def test_green_points_are_leaves_unless_they_are_few_or_low():
    points_m = np.column_stack([np.zeros(1000), np.linspace(0, 5, 1000), np.zeros(1000)])
    green, grey = (60, 110, 40), (90, 85, 80)

    upper = np.where(points_m[:, 1:2] > 2, green, grey)
    np.testing.assert_array_equal(find_green_points(points_m, upper), points_m[:, 1] > 2)
    meadow = np.where(points_m[:, 1:2] < 1, green, grey)
    assert find_green_points(points_m, meadow) is None
    assert find_green_points(points_m, np.broadcast_to(grey, (1000, 3))) is None
