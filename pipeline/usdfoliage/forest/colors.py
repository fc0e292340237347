"""Colours of an orthophoto: the mean colour of each crown, and which are of no leaves."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.forest.raster import Raster, sample_bilinear

Floats = NDArray[np.float64]

RINGS = (0.25, 0.5, 0.7)  # of a crown's radius, on which its colour is read
PER_RING = 12
BLUEST = 0.8  # blue of leaves over the greater of their red and green; roads and shadows on them have more


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


def are_of_leaves(colors: Floats) -> NDArray[np.bool_]:
    """(N,) whether mean linear colours (N, 3) can be those of leaves of any season; roads and water have more blue."""
    return np.asarray(colors[:, 2] < BLUEST * np.maximum(colors[:, 0], colors[:, 1]))
