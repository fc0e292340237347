"""How far what a video shows has moved."""

import cv2
import numpy as np
import pytest
from usdfoliage.capture.video.motion import MotionFollower

from tests.support.videos import HEIGHT, WIDTH, seen_from, texture

PLANE = cv2.cvtColor(texture(), cv2.COLOR_BGR2GRAY)


def follow(places, stretch=0.05) -> list[float]:
    follower = MotionFollower(stretch)
    return [follower.add(np.asarray(seen_from(PLANE, *place))) for place in places]


@pytest.mark.parametrize("speed_px", [0.7, 3.0, 11.0])
def test_an_even_motion_is_measured(speed_px):
    motion = follow([(20 + speed_px * k, 80) for k in range(40)])
    np.testing.assert_allclose(motion, speed_px * np.arange(40) / WIDTH, atol=0.003)


def test_a_hand_that_shakes_does_not_add_up():
    rng = np.random.default_rng(1)
    motion = follow([(200 + 4 * rng.uniform(-1, 1), 80 + 4 * rng.uniform(-1, 1)) for _ in range(100)])
    assert max(motion) < 0.03


def test_a_path_forth_and_back_counts_twice():
    there = [(20 + 4 * k, 80) for k in range(41)]
    assert follow([*there, *there[::-1]])[-1] == pytest.approx(
        2 * 160 / WIDTH, abs=0.11
    )  # less where it turns within a stretch


def test_a_cut_counts_as_one_stretch():
    follower = MotionFollower(0.08)
    others = [cv2.cvtColor(texture(seed), cv2.COLOR_BGR2GRAY) for seed in range(4)]
    motion = [follower.add(np.asarray(seen_from(other, 50))) for other in others for _ in range(3)]
    np.testing.assert_allclose(motion, np.repeat([0, 0.08, 0.16, 0.24], 3), atol=1e-6)


def test_where_nothing_can_be_seen_nothing_moves():
    follower = MotionFollower(0.05)
    assert [follower.add(np.full((HEIGHT, WIDTH), 90, np.uint8)) for _ in range(5)] == [0.0] * 5
