"""Pairs that agree: cameras on a ring in a room with four equal walls, whose turns are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.capture.poses.view_graph import PairTurns, average_turns

PHOTOS = 20


def find_consistent_pairs(pairs: PairTurns, photos: int) -> np.ndarray:
    """Which pairs agree: none where the photographs do not hang together."""
    found = average_turns(pairs, photos)
    return np.zeros(len(pairs.first), bool) if found is None else found.off_rad < found.limit_rad


def ring(seed: int = 0, noise_deg: float = 0.3) -> tuple[PairTurns, np.ndarray]:
    """Pairs of cameras around a plant, and which are right: every second camera sees walls that look the same."""
    rng = np.random.default_rng(seed)
    azimuth = np.radians(360 / PHOTOS) * np.arange(PHOTOS)
    tilt = np.where(np.arange(PHOTOS) % 2, np.radians(40), np.radians(12))
    cameras = Rotation.from_euler("x", tilt[:, None]) * Rotation.from_euler("y", azimuth[:, None])
    quarter = Rotation.from_euler("y", np.round(azimuth / (np.pi / 2))[:, None] * np.pi / 2)  # to one wall
    first, second, turns, matches, right = [], [], [], [], []
    for i in range(PHOTOS):
        for j in range(i + 1, PHOTOS):
            apart = min(j - i, PHOTOS - j + i)
            walls = i % 2 == j % 2 == 0
            if not walls and apart > 4:
                continue
            true = cameras[j] * cameras[i].inv()
            turn = (cameras[j] * quarter[j].inv()) * (cameras[i] * quarter[i].inv()).inv() if walls else true
            turns.append((Rotation.from_rotvec(rng.normal(0, np.radians(noise_deg), 3)) * turn).as_matrix())
            matches.append(500 if walls else 150)
            right.append((turn * true.inv()).magnitude() < 0.02)
            first.append(i)
            second.append(j)
    pairs = PairTurns(
        first=np.array(first), second=np.array(second), turn=np.array(turns), matches=np.array(matches, float)
    )
    return pairs, np.array(right)


@pytest.mark.parametrize("seed", range(4))
def test_pairs_of_equal_walls_are_left_out(seed):
    pairs, right = ring(seed)
    assert 0.2 < right.mean() < 0.9
    np.testing.assert_array_equal(find_consistent_pairs(pairs, PHOTOS), right)


@pytest.mark.parametrize("seed", range(4))
def test_pairs_that_mislead_by_two_degrees_are_left_out(seed):
    """They have five times the matches of the others, and one in five is such a pair."""
    pairs, right = ring(seed, noise_deg=0.05)
    rng = np.random.default_rng(seed)
    near = right & (rng.random(len(right)) < 0.2)
    axis = rng.normal(size=(near.sum(), 3))
    axis *= np.radians(2) / np.linalg.norm(axis, axis=1, keepdims=True)
    turn, matches = pairs.turn.copy(), pairs.matches.copy()
    turn[near] = (Rotation.from_rotvec(axis) * Rotation.from_matrix(turn[near])).as_matrix()
    matches[near] = 750
    changed = PairTurns(first=pairs.first, second=pairs.second, turn=turn, matches=matches)
    np.testing.assert_array_equal(find_consistent_pairs(changed, PHOTOS), right & ~near)


def test_the_limit_is_that_of_the_noise():
    """Turns that are known less well do not make pairs contradict each other."""
    exact, rough = (average_turns(ring(noise_deg=noise_deg)[0], PHOTOS) for noise_deg in (0.01, 0.5))
    assert np.degrees(exact.limit_rad) == pytest.approx(0.6)
    assert 1.5 < np.degrees(rough.limit_rad) < 5


def test_photographs_that_do_not_hang_together_have_no_pairs():
    pairs, _ = ring()
    assert not find_consistent_pairs(pairs, PHOTOS + 1).any()
