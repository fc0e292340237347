"""Pairs that agree: cameras on a ring in a room with four equal walls, whose turns are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.capture.poses.view_graph import PairTurns, find_consistent_pairs

PHOTOS = 20


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


def test_photographs_that_do_not_hang_together_have_no_pairs():
    pairs, _ = ring()
    assert not find_consistent_pairs(pairs, PHOTOS + 1).any()
