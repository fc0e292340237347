"""Which frames of a video are taken: the sharpest of each stretch. Our own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.video.settings import VideoSettings

_WIDER = 1.02  # factor by which stretches are lengthened until there are few enough


@dataclass(frozen=True, kw_only=True, eq=False)
class SurveyedVideo:
    """What is known of the frames that were looked at."""

    numbers: NDArray[np.int64]  # (N,) of frames, counted from 0 through the whole file
    seconds: NDArray[np.float64]  # (N,) since the beginning, rising
    motion: NDArray[np.float64]  # (N,) that the picture has made, as a share of its longer side, not falling
    sharpness: NDArray[np.float64]  # (N,) as measure_sharpness


@dataclass(frozen=True, kw_only=True, eq=False)
class ChosenFrames:
    """Places among the frames that were looked at."""

    places: NDArray[np.int64]  # (K,), rising; none where the camera does not move by one stretch
    stretch: float  # share of the picture's longer side that each stands for


def choose_frames(video: SurveyedVideo, settings: VideoSettings = VideoSettings()) -> ChosenFrames:
    """The sharpest frame of each stretch in which the picture moves by min_motion, or by more for fewer frames."""
    stretch = settings.min_motion
    if not len(video.motion) or video.motion[-1] - video.motion[0] < stretch:
        return ChosenFrames(places=np.zeros(0, np.int64), stretch=stretch)
    while True:
        # A cut counts as exactly one stretch: what rounding takes off must not put it into the one before.
        stretches = np.floor((video.motion - video.motion[0]) / stretch + 1e-6).astype(np.int64)
        if len(np.unique(stretches)) <= settings.max_frames:
            break
        stretch *= _WIDER
    order = np.lexsort((np.arange(len(stretches)), -video.sharpness, stretches))
    first = np.flatnonzero(np.diff(stretches[order], prepend=-1))
    return ChosenFrames(places=np.sort(order[first]), stretch=stretch)
