"""Which points are leaves by their colour: green ones, and what of the black ones is among these."""

import numpy as np
import pytest
from usdfoliage.crown.leaf_colors import find_green_points, have_color

GREEN, BROWN = (60, 120, 40), (90, 70, 50)


def tree(count=4000, seed=0):
    """A green ball on a brown stem: points, colours, and which are of the ball."""
    rng = np.random.default_rng(seed)
    toward = rng.normal(size=(count, 3))
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    stem = np.column_stack([np.zeros(count // 4), rng.uniform(0, 2, count // 4), np.zeros(count // 4)])
    points = np.concatenate([toward + np.array([0.0, 3.0, 0.0]), stem])
    of_ball = np.arange(len(points)) < count
    return points, np.where(of_ball[:, None], GREEN, BROWN), of_ball


def test_leaves_are_what_is_green():
    points, colors, of_ball = tree()

    np.testing.assert_array_equal(find_green_points(points, colors), of_ball)
    assert find_green_points(points, np.full_like(colors, 128)) is None


@pytest.mark.parametrize("share", [0.1, 0.5, 0.85])
def test_black_points_are_as_the_coloured_ones_nearest_to_them(share):
    points, colors, of_ball = tree()
    colors[np.random.default_rng(1).random(len(points)) < share] = 0

    green = find_green_points(points, colors)

    assert (green == of_ball).mean() > 0.97  # where the stem goes into the ball they are mixed


def test_a_side_without_photograph_is_not_lost():
    points, colors, of_ball = tree()
    colors[points[:, 0] > 0.1] = 0

    green = find_green_points(points, colors)

    np.testing.assert_array_equal(green[of_ball], True)
    assert green[~of_ball].mean() < 0.1


def test_a_few_coloured_points_do_not_speak_for_all():
    points, colors, _ = tree()
    colors[np.arange(len(colors)) % 20 != 0] = 0

    assert have_color(colors).mean() == pytest.approx(0.05)
    assert find_green_points(points, colors) is None
