"""The crown's relief from the luminance of its colour cubemap (thesis section 4.4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.color import encode_srgb, luminance
from usdfoliage.geometry.cube_field import solve_dirichlet, weighted_blurs
from usdfoliage.geometry.cubemap import face_directions

NEUTRAL = 0.5  # the height that displaces nothing


@dataclass(frozen=True, kw_only=True)
class ReliefSettings:
    """How luminance becomes height."""

    weight: float = 0.12  # ρ: the radius varies by up to ± ρ/2
    levels: int = 5  # of the pyramid, blurred twice as wide each
    finest: float = 1 / 256  # blur of the first level, in shares of a face's side
    band_pass: bool = False  # Laplacian instead of Gaussian pyramid

    def __post_init__(self) -> None:
        if not 0 <= self.weight <= 1:
            raise ValueError(f"the relief's weight must be from 0 to 1, not {self.weight}")
        if not 1 <= self.levels <= 8:
            raise ValueError(f"levels must be from 1 to 8, not {self.levels}")
        if not 0 < self.finest <= 0.1:
            raise ValueError(f"finest must be in (0, 0.1], not {self.finest}")


def fit_relief(color: NDArray[np.floating], settings: ReliefSettings = ReliefSettings()) -> NDArray[np.float64]:
    """Height h in [0, 1] (6, N, N) of each texel; 0.5 displaces nothing.

    Lower frequencies weigh more, since they are the larger structures. A membrane pulls h to 0.5 on the silhouette of
    the photograph, which is where directions have z = 0; on either side of it h is 0.5 on average, so that the relief
    neither swells nor shrinks the crown.

    Args:
        color: (6, N, N, 3), linear Rec.709; front is +z.
        settings: Pyramid.

    Source:
        Argudo, section 4.4; the membrane on the closed cubemap and the centring are ours.
    """
    size = color.shape[1]
    bright = encode_srgb(luminance(color))
    low, high = np.percentile(bright, [1, 99])
    bright = np.clip((bright - low) / max(high - low, 1e-6), 0, 1)
    weights = 2.0 ** np.arange(settings.levels)
    if settings.band_pass:  # a level less the next: the weight of each blur drops by that of the one before
        weights = np.diff(weights, prepend=0)
    sigmas = settings.finest * size * 2.0 ** np.arange(settings.levels)
    height = weighted_blurs(bright, sigmas.tolist(), (weights / np.abs(weights).sum()).tolist())

    z = face_directions(size)[..., 2]
    on_silhouette = np.abs(z) <= 1.01 / (size - 1)  # within half a texel
    relief = height - solve_dirichlet(np.zeros_like(height), on_silhouette, height)
    # A bump that is nought on the silhouette centres each side.
    bump = np.abs(z)
    for side in (z > 0, z < 0):
        relief -= np.where(side, bump * (relief[side].mean() / max(bump[side].mean(), 1e-12)), 0)
    relief[on_silhouette] = 0
    reach = float(np.percentile(np.abs(relief), 99.5))
    return np.clip(NEUTRAL + relief * (0.5 / reach if reach > 1e-9 else 0.0), 0, 1)


def displace_radius(radius: NDArray[np.floating], height: NDArray[np.floating], weight: float) -> NDArray[np.float64]:
    """‖p − c‖ · (1 + ρ (h − 0.5)), section 4.6."""
    return np.asarray(radius * (1 + weight * (height - NEUTRAL)))
