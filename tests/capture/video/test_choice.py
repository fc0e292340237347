"""Which frames are taken."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from usdfoliage.capture.video.choice import SurveyedVideo, choose_frames
from usdfoliage.capture.video.settings import VideoSettings


def surveyed(motion, sharpness=None) -> SurveyedVideo:
    motion = np.asarray(motion, float)
    count = len(motion)
    sharp = np.ones(count) if sharpness is None else np.asarray(sharpness, float)
    return SurveyedVideo(numbers=np.arange(count), seconds=np.arange(count) / 10, motion=motion, sharpness=sharp)


def test_the_sharpest_of_each_stretch():
    motion = np.linspace(0, 0.199, 20)  # two stretches of ten
    sharpness = np.ones(20)
    sharpness[3], sharpness[14] = 2.0, 3.0
    assert choose_frames(surveyed(motion, sharpness), VideoSettings(min_motion=0.1)).places.tolist() == [3, 14]


def test_of_equal_ones_the_first():
    assert choose_frames(surveyed([0, 0, 0.1, 0.1]), VideoSettings(min_motion=0.1)).places.tolist() == [0, 2]


def test_no_frame_is_taken_where_the_camera_rests():
    motion = [0, 0.1, 0.1, 0.1, 0.1, 0.4]
    assert choose_frames(surveyed(motion), VideoSettings(min_motion=0.1)).places.tolist() == [0, 1, 5]


def test_cuts_of_one_stretch_are_a_frame_each():
    motion = np.repeat(np.cumsum(np.full(20, 0.05)), 7)
    places = choose_frames(surveyed(motion), VideoSettings(min_motion=0.05)).places
    assert places.tolist() == list(range(0, 140, 7))


def test_a_camera_that_does_not_move_by_one_stretch_gives_none():
    assert len(choose_frames(surveyed([0, 0.04]), VideoSettings(min_motion=0.05)).places) == 0
    assert len(choose_frames(surveyed([])).places) == 0


@given(
    st.lists(st.floats(0, 0.3), min_size=2, max_size=80),
    st.integers(2, 20),
    st.floats(0.01, 0.2),
)
def test_never_more_than_the_limit_and_stretches_never_shorter(steps, limit, min_motion):
    motion = np.cumsum(steps)
    chosen = choose_frames(surveyed(motion), VideoSettings(min_motion=min_motion, max_frames=limit))
    assert len(chosen.places) <= limit
    assert chosen.stretch >= min_motion
    assert np.all(np.diff(chosen.places) > 0)
    if motion[-1] - motion[0] >= min_motion:
        assert len(chosen.places) >= 2


@pytest.mark.parametrize(
    "wrong", [{"min_motion": 0}, {"min_motion": 0.6}, {"max_frames": 1}, {"max_rate_hz": 0}, {"max_minutes": 0}]
)
def test_settings_that_cannot_be(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        VideoSettings(**wrong)
