"""Colours of an orthophoto: where crowns stand out, and the mean colour of each crown."""

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.forest.raster import Raster, sample_bilinear
from usdfoliage.geometry.color import encode_srgb

Floats = NDArray[np.float64]

RINGS = (0.25, 0.5, 0.7)  # of a crown's radius, on which its colour is read
PER_RING = 12
BLUE = -6.0  # b* of CIE L*a*b*, below which a colour is blue


def crown_contrast(linear: Raster) -> Raster:
    """(H, W) a picture in which crowns are bright: the chroma of CIE L*a*b*, which shadows hardly change.

    What is blue, as water and the shadows on a road, is dark: leaves of no season are.

    Args:
        linear: (H, W, 3) colours of the orthophoto.
    """
    encoded = np.asarray(encode_srgb(np.clip(np.nan_to_num(linear.values), 0, 1)), np.float32)
    lab = cv2.cvtColor(encoded, cv2.COLOR_RGB2Lab)
    chroma = np.where(lab[..., 2] > BLUE, np.hypot(lab[..., 1], lab[..., 2]), 0.0)
    return Raster(values=chroma, ground_from_pixel=linear.ground_from_pixel, crs=linear.crs)


def crown_colors(linear: Raster, ground_m: Floats, radius_m: Floats) -> Floats:
    """(N, 3) the mean colour over each crown.

    Args:
        linear: (H, W, 3) colours of the orthophoto.
        ground_m: (N, 2) the crowns' middles.
        radius_m: (N,) their radii.
    """
    angle = np.linspace(0, 2 * np.pi, PER_RING, endpoint=False)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    disc = np.concatenate([[(0.0, 0.0)], *(share * around for share in RINGS)])
    places_m = ground_m[:, None] + radius_m[:, None, None] * disc
    colors = sample_bilinear(linear, places_m.reshape(-1, 2)).reshape(len(ground_m), len(disc), 3)
    return np.asarray(colors.mean(axis=1))
