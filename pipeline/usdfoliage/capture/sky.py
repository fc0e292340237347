"""The sky of a photograph: smooth, not green, and open to the top."""

import cv2
import numpy as np
from numpy.typing import NDArray

_SMOOTH_STD = 4.0  # standard deviation of lightness (0 to 100) that clouds stay below and foliage does not
_PALETTE = 8  # colours of a sky, from the zenith to the haze and the clouds
_COLOR_STD = np.array([6.0, 4.0, 4.0], np.float32)  # of one such colour, in L, a, b


def segment_sky(lab: NDArray[np.float32], texture: NDArray[np.float32], seed: int) -> NDArray[np.bool_]:
    """Which pixels are sky, the gaps in the foliage included.

    Smooth regions that reach the top, or lie in the upper half, give the sky's colours; whatever has one of them above
    the lowest of these regions is sky. Our own.

    Args:
        lab: (H, W, 3) CIE Lab, L in [0, 100].
        texture: (H, W) standard deviation of L around each pixel.
        seed: For the palette.

    Returns:
        (H, W); nothing is set where no sky is seen.
    """
    height, width = texture.shape
    calm: NDArray[np.float32] = cv2.GaussianBlur(lab, (0, 0), 1)
    lightness, a, b = (calm[..., k] for k in range(3))
    smooth = texture < _SMOOTH_STD
    candidate = smooth & (lightness > 25) & ~((a < -8) & (b > 10))  # the last is green
    _, labels, stats, _ = cv2.connectedComponentsWithStats(candidate.astype(np.uint8), connectivity=4)

    top, area = stats[:, cv2.CC_STAT_TOP], stats[:, cv2.CC_STAT_AREA] / texture.size
    middle = top + stats[:, cv2.CC_STAT_HEIGHT] / 2
    is_sky = ((top < 0.04 * height) & (area > 0.002)) | ((middle < 0.5 * height) & (area > 0.003))
    is_sky[0] = False
    reaches_top = is_sky & (top < 0.04 * height)
    if area[reaches_top].sum() < 0.01:
        return np.zeros((height, width), np.bool_)
    sure = is_sky[labels]

    samples = calm[reaches_top[labels]]
    samples = samples[:: max(1, len(samples) // 10_000)]
    cv2.setRNGSeed(seed)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.5)
    _, _, palette = cv2.kmeans(samples, min(_PALETTE, len(samples)), None, stop, 2, cv2.KMEANS_PP_CENTERS)
    distance = np.full((height, width), np.inf, np.float32)
    for color in palette:
        distance = np.minimum(distance, np.sum(((calm - color) / _COLOR_STD) ** 2, axis=2))
    similar = (distance < 3) | (smooth & (distance < 12))
    lowest = int(np.nonzero(np.count_nonzero(sure, axis=1) > 0.03 * width)[0].max(initial=0))
    similar[lowest + int(0.02 * height) :] = False
    return np.asarray(similar | sure)
