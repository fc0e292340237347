"""How far what a video shows has moved since its beginning.

Our own: corners are followed from one frame, by the pyramids of Lucas and Kanade (OpenCV), until they have moved by one
stretch, or most of them are lost; then from there. So what a hand shakes does not add up, as it would from frame to
frame. After a cut nothing can be followed, and what is seen counts as moved by one stretch.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

SIDE_PX = 480  # of the pictures that are compared
_CORNERS, _MIN_CORNERS = 300, 12
_MIN_FOLLOWED = 0.35  # share of the corners
_MAX_BACK_PX = 1.0  # from a corner to where it ends when it is followed there and back
_WINDOW_PX, _LEVELS = 21, 4


class MotionFollower:
    """Adds up how far the picture has moved, frame by frame."""

    def __init__(self, stretch: float) -> None:
        """stretch: a share of the longer side, by which a cut counts."""
        self._stretch = stretch
        self._motion = 0.0  # up to the frame that corners are followed from
        self._from: NDArray[np.uint8] | None = None
        self._last: NDArray[np.uint8] | None = None
        self._moved_to_last = 0.0
        self._corners = np.zeros((0, 1, 2), np.float32)
        self._places = self._corners

    def add(self, gray: NDArray[np.uint8]) -> float:
        """The motion up to the next frame (H, W), all of one size, as a share of the longer side."""
        if self._from is None or self._last is None:
            self._begin_at(gray)
            return self._motion
        moved = self._follow(gray)
        if moved is None and self._last is not self._from:
            self._motion += self._moved_to_last
            self._begin_at(self._last)
            moved = self._follow(gray)
        if moved is None:
            had_corners = len(self._corners) >= _MIN_CORNERS
            self._motion += self._stretch if had_corners else 0.0  # else nothing is seen that could move
            self._begin_at(gray)
            return self._motion
        self._last, self._moved_to_last = gray, moved
        if moved >= self._stretch:
            self._motion += moved
            self._begin_at(gray)
            return self._motion
        return self._motion + moved

    def _begin_at(self, gray: NDArray[np.uint8]) -> None:
        found = cv2.goodFeaturesToTrack(gray, _CORNERS, 0.01, 8)
        self._corners = np.zeros((0, 1, 2), np.float32) if found is None else np.asarray(found, np.float32)
        self._places = self._corners
        self._from = self._last = gray
        self._moved_to_last = 0.0

    def _follow(self, gray: NDArray[np.uint8]) -> float | None:
        """How far the median corner has moved; None where too few are found again."""
        if len(self._corners) < _MIN_CORNERS:
            return None
        assert self._from is not None
        places, there = _flow(self._from, gray, self._corners, self._places)
        back, again = _flow(gray, self._from, places, self._corners)
        off_px = np.linalg.norm((back - self._corners)[:, 0], axis=1)
        good = there & again & (off_px <= _MAX_BACK_PX)
        if np.count_nonzero(good) < max(_MIN_CORNERS, _MIN_FOLLOWED * len(self._corners)):
            return None
        self._places = np.where(good[:, None, None], places, self._places).astype(np.float32)
        moved_px = np.linalg.norm((places - self._corners)[good, 0], axis=1)
        return float(np.median(moved_px)) / max(gray.shape)


def _flow(
    first: NDArray[np.uint8], second: NDArray[np.uint8], places: NDArray[np.float32], guess: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where places (N, 1, 2) of the first picture are in the second, and which of them were found."""
    found, is_there, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        places,
        guess.copy(),
        winSize=(_WINDOW_PX, _WINDOW_PX),
        maxLevel=_LEVELS,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(found, np.float32), np.asarray(is_there)[:, 0] > 0
