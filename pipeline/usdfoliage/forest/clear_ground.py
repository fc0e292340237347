"""The colours of the ground without the crowns that an orthophoto shows over it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.forest.raster import Raster, to_pixels

Colors = NDArray[np.float32]

SHIFT = 4  # bits of a pixel's fraction where circles are drawn
MIN_KNOWN = 0.002  # of the pixels; where crowns leave less, nothing shows what the ground is like
EPSILON = 1e-6


@dataclass(frozen=True, kw_only=True)
class ClearGroundSettings:
    """What is taken for a crown, and how it is replaced."""

    wider: float = 1.2  # times the radius of a crown, with the rest of it that is not round
    soft: float = 0.15  # of the median radius, over which the ground beside a crown's place is blended with it
    max_side_px: int = 4096  # of the picture in which colours are found; of a larger one it is a smaller copy

    def __post_init__(self) -> None:
        if not 0 < self.wider < np.inf:
            raise ValueError(f"wider must be above 0, not {self.wider:g}")
        if not 0 <= self.soft < np.inf:
            raise ValueError(f"soft must be 0 or more, not {self.soft:g}")
        if self.max_side_px < 16:
            raise ValueError(f"max_side_px must be 16 or more, not {self.max_side_px}")


def clear_crowns(
    photo: Raster,
    ground_m: NDArray[np.float64],
    radius_m: NDArray[np.float64],
    seed: int = 0,
    settings: ClearGroundSettings = ClearGroundSettings(),
) -> Raster:
    """An orthophoto with the ground beside crowns in their places; itself where crowns leave no ground to be seen.

    Planted crowns stand there, and what is seen below them shall be ground. Colours come from a pyramid: a pixel
    without ground has the colour of the finest level that has some, and varies in each level as ground varies there.

    Args:
        photo: (H, W, 3), linear.
        ground_m: (N, 2) easting and northing of the crowns.
        radius_m: (N,) of the crowns.
        seed: Of the variation.
        settings: How.

    Source:
        S. J. Gortler et al., The Lumigraph, SIGGRAPH 1996, section 3.4 (pull, push). The variation is our own.
    """
    height, width = photo.values.shape[:2]
    if not len(ground_m):
        return photo
    cover = crown_cover(photo, ground_m, radius_m, settings)
    seen = (cover == 0).astype(np.float32)
    if seen.mean() < MIN_KNOWN:
        return photo
    factor = min(1.0, settings.max_side_px / max(height, width))
    size = max(1, round(width * factor)), max(1, round(height * factor))
    colors = np.ascontiguousarray(photo.values, np.float32)
    soft_px = settings.soft * float(np.median(radius_m)) / photo.cell_m
    blend = np.maximum(cover, cv2.GaussianBlur(cover, (0, 0), max(soft_px, 0.5)))[..., None]
    small = _resize(colors * seen[..., None], size), _resize(seen, size)
    ground = _resize(_fill(*small, np.random.default_rng(seed)), (width, height))
    cleared = colors * (1 - blend) + ground * blend
    return Raster(values=cleared, ground_from_pixel=photo.ground_from_pixel, crs=photo.crs)


def crown_cover(
    onto: Raster, ground_m: NDArray[np.float64], radius_m: NDArray[np.float64], settings: ClearGroundSettings
) -> Colors:
    """(H, W) how much of each pixel shows crowns (N,), 0 to 1."""
    height, width = onto.values.shape[:2]
    cover = np.zeros((height, width), np.uint8)
    place = (to_pixels(onto, ground_m) - 0.5) * (1 << SHIFT)
    radius_px = settings.wider * radius_m / onto.cell_m
    for (x, y), radius in zip(np.rint(place).astype(np.int64).tolist(), radius_px.tolist(), strict=True):
        reach = radius + 1
        if -reach < x / (1 << SHIFT) < width + reach and -reach < y / (1 << SHIFT) < height + reach:
            cv2.circle(cover, (x, y), round(radius * (1 << SHIFT)), 255, cv2.FILLED, cv2.LINE_AA, SHIFT)
    return np.asarray(cover, np.float32) / np.float32(255)


def _fill(weighted: Colors, weight: Colors, rng: np.random.Generator) -> Colors:
    """(H, W, 3) colours of all pixels, of colours times their weights and weights (H, W) from 0 to 1."""
    levels = [(weighted, weight)]
    while max(weight.shape) > 1:
        weighted, weight = cv2.pyrDown(weighted), cv2.pyrDown(weight)
        weighted = weighted.reshape(*weight.shape, 3)
        levels.append((weighted, weight))
    filled = levels[-1][0] / np.maximum(levels[-1][1], EPSILON)[..., None]
    for weighted, weight in reversed(levels[:-1]):
        rows, columns = weight.shape
        coarse = _resize(filled, (columns, rows))
        known = np.clip(weight / 0.5, 0, 1)[..., None]  # from half a pixel of ground on its colour counts alone
        own = weighted / np.maximum(weight, EPSILON)[..., None]
        certain = weight > 0.99
        if certain.any():
            detail = (own[certain] - coarse[certain]).mean(axis=1)
            spread = float(np.median(np.abs(detail - np.median(detail))) / 0.6745)
            relative = spread / max(float(coarse[certain].mean()), EPSILON)
            coarse = coarse * np.maximum(1 + relative * rng.standard_normal((rows, columns, 1), np.float32), 0)
        filled = np.asarray(known * own + (1 - known) * coarse, np.float32)
    return np.asarray(filled, np.float32)


def _resize(values: NDArray[np.floating], size: tuple[int, int]) -> Colors:
    """Values of (width, height) pixels: means where there are fewer, between them linearly where there are more."""
    if values.shape[1::-1] == size:
        return values
    smaller = size[0] < values.shape[1]
    resized = cv2.resize(values, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    return np.asarray(resized, np.float32).reshape(size[1], size[0], *values.shape[2:])
