"""Crowns whose answers are known in closed form."""

import numpy as np
from numpy.typing import NDArray
from usdfoliage.geometry.cubemap import face_directions


def disc_mask(radius_px: float, size_px: int = 300, center_px: tuple[float, float] | None = None) -> NDArray[np.bool_]:
    """A disc in a square picture; pixel centres lie at half integers."""
    x, y = center_px or (size_px / 2, size_px / 2)
    row, column = np.mgrid[:size_px, :size_px] + 0.5
    return np.asarray(np.hypot(column - x, row - y) < radius_px)


def ellipse_mask(half_width_px: float, half_height_px: float, size_px: int = 300) -> NDArray[np.bool_]:
    row, column = np.mgrid[:size_px, :size_px] + 0.5 - size_px / 2
    return np.asarray((column / half_width_px) ** 2 + (row / half_height_px) ** 2 < 1)


def ellipsoid_radius(half_axes: tuple[float, float, float], size: int) -> NDArray[np.float64]:
    """Radius cubemap of an ellipsoid about its centre."""
    directions = face_directions(size)
    return np.asarray(1 / np.linalg.norm(directions / np.array(half_axes), axis=-1))


def foliage(shape: tuple[int, int], seed: int = 0) -> NDArray[np.float32]:
    """Linear colours that pass for leaves: blotches of greens of several sizes."""
    import cv2

    rng = np.random.default_rng(seed)
    grain = np.zeros(shape, np.float32)
    for sigma in (1.0, 2.5, 6.0):
        noise = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), sigma)
        grain += noise / noise.std()
    bright = 0.15 * np.exp(0.35 * grain)
    return np.asarray(bright[..., None] * np.array([0.7, 1.0, 0.3], np.float32), dtype=np.float32)
