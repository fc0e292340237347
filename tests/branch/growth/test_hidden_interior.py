"""What a cloud hides: the inside of a ball, not that of a cage, and nothing of a plane."""

import numpy as np
import pytest
from usdfoliage.branch.growth.hidden_interior import HiddenSettings, blocked_share, find_hidden


def sphere(count: int, seed: int = 0) -> np.ndarray:
    places = np.random.default_rng(seed).normal(size=(count, 3))
    return places / np.linalg.norm(places, axis=1, keepdims=True)


def test_points_inside_a_closed_ball_lie_apart_and_fill_it():
    hidden_m = find_hidden(sphere(20_000), 0.05, 0.02)
    away_m = np.linalg.norm(hidden_m, axis=1)
    assert away_m.max() < 1 - 0.08  # two internodes from the surface, less its roughness
    gaps_m = np.linalg.norm(hidden_m[:, None] - hidden_m[None], axis=2)
    np.fill_diagonal(gaps_m, np.inf)
    assert gaps_m.min() >= 0.1
    probes_m = 0.8 * sphere(500, 1) * np.random.default_rng(2).random((500, 1)) ** (1 / 3)
    nearest_m = np.linalg.norm(probes_m[:, None] - hidden_m[None], axis=2).min(axis=1)
    assert np.quantile(nearest_m, 0.95) < 0.12


def test_a_ball_that_is_seen_through_hides_nothing():
    assert len(find_hidden(sphere(200), 0.05, 0.02)) == 0


def test_half_a_ball_blocks_half_of_the_directions():
    bowl_m = sphere(40_000)
    bowl_m = bowl_m[bowl_m[:, 1] < 0]
    assert blocked_share(np.array([[0.0, 0.1, 0]]), bowl_m, 0.06)[0] == pytest.approx(0.5, abs=0.1)
    assert blocked_share(np.array([[0.0, 5, 0]]), bowl_m, 0.1)[0] < 0.05


def test_a_share_that_matters_is_the_same_when_others_are_given_up():
    bowl_m = sphere(20_000)
    bowl_m = bowl_m[bowl_m[:, 1] < 0.5]
    places_m = 0.9 * sphere(300, 1) * np.random.default_rng(2).random((300, 1))
    whole, given_up = blocked_share(places_m, bowl_m, 0.06), blocked_share(places_m, bowl_m, 0.06, 0.8)
    enough = whole >= 0.8
    assert 30 < enough.sum() < 270
    assert np.array_equal(given_up[enough], whole[enough])
    assert (given_up[~enough] < 0.8).all()


@pytest.mark.parametrize("flat", [np.zeros((3, 3)), np.eye(3)[[0, 1, 0, 1, 0]], np.zeros((0, 3))])
def test_what_has_no_inside_hides_nothing(flat):
    assert find_hidden(flat, 0.1, 0.1).shape == (0, 3)


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="above 0"):
        HiddenSettings(spacing=0)
