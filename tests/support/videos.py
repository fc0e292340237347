"""Videos of a textured plane that a camera moves along, written by OpenCV."""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT, RATE_HZ = 320, 240, 30


def texture(seed: int = 0, width: int = 1600, height: int = 400) -> np.ndarray:
    """(H, W, 3) uint8, detail of several sizes."""
    rng = np.random.default_rng(seed)
    layers = [cv2.resize(rng.normal(0, 30, (height // n, width // n, 3)), (width, height)) for n in (4, 8, 16, 32)]
    return np.clip(128 + sum(layers), 0, 255).astype(np.uint8)


def seen_from(plane: np.ndarray, left_px: float, top_px: float = 80.0) -> np.ndarray:
    """What a camera at that place sees, to parts of a pixel."""
    return cv2.getRectSubPix(plane, (WIDTH, HEIGHT), (left_px + WIDTH / 2, top_px + HEIGHT / 2))


def write_video(path: Path, frames: Iterable[np.ndarray], rate_hz: float = RATE_HZ, code: str = "mp4v") -> Path:
    """Write frames (H, W, 3), blue, green, red, all of one size."""
    listed = list(frames)
    height, width = listed[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), rate_hz, (width, height))
    assert writer.isOpened()
    for frame in listed:
        writer.write(frame)
    writer.release()
    return path


def write_pan(path: Path, speed_px: float = 2.0, count: int = 120, seed: int = 0) -> Path:
    """A camera that moves evenly to the right, by so many pixels a frame."""
    plane = texture(seed)
    return write_video(path, (seen_from(plane, 10 + speed_px * k) for k in range(count)))
