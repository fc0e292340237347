"""Pictures (400, 300, 3) of what has no leaves."""

import cv2
import numpy as np


def noisy(picture: np.ndarray, sigma: float, seed: int = 0) -> np.ndarray:
    """The picture with normal noise."""
    rng = np.random.default_rng(seed)
    return np.clip(picture + rng.normal(0, sigma, picture.shape), 0, 255).astype(np.uint8)


def road() -> np.ndarray:
    """Grey stone with coarse and fine grain, and a darker place where it was mended."""
    rng = np.random.default_rng(1)
    grain = cv2.resize(rng.normal(0, 6, (40, 30)), (300, 400), interpolation=cv2.INTER_CUBIC)
    picture = np.full((400, 300, 3), (118, 117, 112), float) + grain[..., None]
    mended = cv2.GaussianBlur(cv2.circle(np.zeros((400, 300)), (150, 170), 75, 1, -1), (0, 0), 3)
    picture -= 30 * mended[..., None]
    picture[:50] = (150, 190, 240)  # without which the road is as smooth as a sky
    return noisy(picture, 3)


def bricks() -> np.ndarray:
    """A wall of red bricks with light joints."""
    picture = np.full((400, 300, 3), (165, 85, 62), float)
    for row, y in enumerate(range(0, 400, 16)):
        picture[y : y + 3] = (200, 195, 185)
        for x in range(row % 2 * 18, 300, 36):
            picture[y : y + 16, x : x + 3] = (200, 195, 185)
    return noisy(picture, 8)
