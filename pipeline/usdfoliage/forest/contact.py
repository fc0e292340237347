"""How dark the ground is under plants: the part of the sky that their crowns leave open."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.forest.raster import Raster, to_pixels

Floats = NDArray[np.float64]

BATCH = 1 << 21  # texels that are computed at once
MIN_TEXELS = 0.75  # radius of the smallest crown that is drawn; smaller ones are as wide, and fainter


@dataclass(frozen=True, kw_only=True)
class ContactSettings:
    """How much of the sky a crown takes away."""

    opacity: float = 0.8  # of a crown, to the light of the sky
    base_share: float = 0.3  # height of a crown above the ground, as a part of the plant's
    reach: float = 3.0  # radii of a crown, from where on nothing is darker

    def __post_init__(self) -> None:
        if not 0 <= self.opacity <= 1:
            raise ValueError(f"opacity must be 0 to 1, not {self.opacity:g}")
        if not 0 < self.base_share < 1:
            raise ValueError(f"base_share must be above 0 and below 1, not {self.base_share:g}")
        if not 1 < self.reach < np.inf:
            raise ValueError(f"reach must be above 1, not {self.reach:g}")


def open_sky(
    onto: Raster,
    ground_m: Floats,
    radius_m: Floats,
    height_m: Floats,
    settings: ContactSettings = ContactSettings(),
) -> NDArray[np.float32]:
    """(H, W) the part of the sky's light that reaches level ground below plants (N,), 1 where none is near.

    The thesis' section 6.4.4 has shadow maps, which a renderer makes; this is what stays of them under any light. Our
    own: a crown takes away what a disc of its radius does, which hangs at the height of its base. Several take away one
    after the other, as if none knew of the others.

    Args:
        onto: Whose pixels are computed; its values do not matter. Where these are no squares, discs are ellipses.
        ground_m: (N, 2) easting and northing of the plants.
        radius_m: (N,) of their crowns.
        height_m: (N,) of the plants.
        settings: How much.
    """
    rows, columns = onto.values.shape[:2]
    lost = np.zeros(rows * columns)  # logarithm of what is left
    if not len(ground_m):
        return np.ones((rows, columns), np.float32)
    place = to_pixels(onto, ground_m)
    wide_m = np.maximum(radius_m, MIN_TEXELS * onto.cell_m)
    faint = settings.opacity * (radius_m / wide_m) ** 2
    base_m = settings.base_share * height_m
    # Pixels across and down that a circle of a metre covers.
    per_m = np.linalg.norm(np.linalg.inv(onto.ground_from_pixel[:, :2]), axis=1)
    half = np.ceil(settings.reach * wide_m[:, None] * per_m).astype(np.int64)  # (N, 2)
    sizes, which = np.unique(half, axis=0, return_inverse=True)
    for number, (across, down) in enumerate(sizes.tolist()):
        row, column = np.mgrid[-down : down + 1, -across : across + 1].reshape(2, -1)
        offset_m = (np.stack([column, row], axis=-1) + 0.5) @ onto.ground_from_pixel[:, :2].T  # of texels from a corner
        own = np.flatnonzero(which.reshape(-1) == number)
        for some in np.array_split(own, max(1, -(-len(own) * len(row) // BATCH))):
            first = np.floor(place[some]).astype(np.int64)
            within_m = (place[some] - first) @ onto.ground_from_pixel[:, :2].T
            square = (offset_m[:, 0] - within_m[:, :1]) ** 2
            square += (offset_m[:, 1] - within_m[:, 1:]) ** 2
            square /= wide_m[some, None] ** 2
            share = disc_share(square, ((base_m / wide_m)[some, None]) ** 2)
            square /= -(settings.reach**2)
            square += 1
            share *= np.maximum(square, 0) ** 2  # nothing beyond the reach, without an edge
            x, y = first[:, :1] + column, first[:, 1:] + row  # (K, texels)
            inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows) & (share > 0)
            left = np.log1p(np.maximum(-faint[some, None] * share, 1e-6 - 1))
            np.add.at(lost, (y * columns + x)[inside], left[inside])
    return np.exp(lost).astype(np.float32).reshape(rows, columns)


def count_texels(texel_m: float, radius_m: Floats, settings: ContactSettings = ContactSettings()) -> float:
    """About how many texels open_sky computes for square ones of this side and crowns (N,)."""
    wide = np.maximum(radius_m / texel_m, MIN_TEXELS)
    return float(((2 * np.ceil(settings.reach * wide) + 1) ** 2).sum())


def disc_share(away_squared: Floats, height_squared: Floats) -> Floats:
    """The part of an even sky's light on level ground that a disc overhead keeps off, 0 to 1.

    Args:
        away_squared: Square of the way from the place below the disc's middle, in radii of the disc; any shape.
        height_squared: Square of the disc's height, in radii, above 0; the same shape or one that spreads to it.

    Source:
        J. R. Howell, A catalog of radiation heat transfer configuration factors, B-13: an element parallel to a disc.
    """
    beyond = away_squared + height_squared - 1
    return np.asarray(0.5 * (1 - beyond / np.sqrt(np.maximum(beyond**2 + 4 * height_squared, 1e-30))))
