"""Frames of video, by OpenCV's FFmpeg, which prints nothing on the terminal."""

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # read when the first file is opened: FFmpeg itself is quiet
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # what is wrong is raised, or seen by its results


def require_ffmpeg(path: Path) -> None:
    """Refuse a file that takes FFmpeg where OpenCV was built without it, or cannot read from memory.

    Raises:
        CaptureError: It has none.
    """
    if not cv2.videoio_registry.hasBackend(cv2.CAP_FFMPEG) or not hasattr(cv2, "IStreamReader"):
        raise CaptureError(
            f"{path} needs FFmpeg, and this OpenCV ({cv2.__version__}) has none that reads it",
            "install OpenCV by 'pip install opencv-contrib-python-headless', 4.11 or newer",
        )


@contextmanager
def open_frames(source: Path | bytes, parameters: tuple[int, ...] = ()) -> Iterator["cv2.VideoCapture | None"]:
    """A video that is open, turned upright as it states; None where FFmpeg does not know what it is.

    Args:
        source: A file, or its bytes.
        parameters: Of OpenCV, each followed by its value.
    """
    opened: Any = io.BytesIO(source) if isinstance(source, bytes) else str(source)
    capture = None
    with suppress(cv2.error):
        capture = cv2.VideoCapture(opened, cv2.CAP_FFMPEG, list(parameters))
    try:
        yield capture if capture is not None and capture.isOpened() else None
    finally:
        if capture is not None:
            capture.release()


def read_frames(source: bytes) -> Iterator[NDArray[np.uint8]]:
    """The frames (H, W, 3) of a video in memory, red, green, blue, as far as they can be read."""
    with open_frames(source) as capture:
        while capture is not None:
            there, frame = capture.read()
            if not there or frame is None:
                return
            yield np.ascontiguousarray(frame[..., ::-1])
