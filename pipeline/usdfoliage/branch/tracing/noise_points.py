"""Points that are strewn all over the box of a cloud, as rain, insects or false echoes are: what is no plant in a noisy
scan.

A plant leaves parts of its box empty, beside its stem and beside its top. Where no part of the box is empty, the barest
parts show how many points of noise there are in a volume, and what is hardly closer together than these is noise. Our
own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

_TAILS = 0.001  # share of the points on each side that do not count for the box
_SIXTH = 6
_BARE = 0.25  # quantile of the cells by their points, that shows those of noise
_MIN_CELLS, _MAX_CELLS = 5, 8  # along each side: a cell in a corner is beside the crown


@dataclass(frozen=True, kw_only=True)
class NoisePointSettings:
    """What is strewn."""

    points_of_cell: float = 40.0  # on average
    filled: float = 0.9  # share of the cells with points, from which on points are strewn all over; trees fill 0.7
    closer: float = 0.5  # of the distance of noise to its sixth neighbour, up to which points are the plant's
    spacings: float = 4.0  # of the plant, up to which they are
    min_noise: float = 0.03  # share of the points, below which they do no harm
    max_noise: float = 0.6  # above which they may be a plant that fills its box

    def __post_init__(self) -> None:
        if not (0 < self.filled <= 1 and 0 <= self.min_noise < self.max_noise < 1):
            raise ValueError(f"filled must be in (0, 1], min_noise below max_noise, both shares, not {self}")
        if not (self.points_of_cell > 0 and 0 < self.closer < 1 and self.spacings > 1):
            raise ValueError(f"points_of_cell must be above 0, closer in (0, 1), spacings above 1, not {self}")


def find_noise_points(
    points_m: NDArray[np.float64], settings: NoisePointSettings = NoisePointSettings()
) -> NDArray[np.bool_]:
    """(N,) points that are strewn all over the box of a cloud; none where the plant leaves parts of it empty.

    Args:
        points_m: (N, 3), in any order, of axes along which the box stands.
        settings: What is strewn.
    """
    none = np.zeros(len(points_m), bool)
    cells = min(int(np.cbrt(len(points_m) / settings.points_of_cell)), _MAX_CELLS)
    if cells < _MIN_CELLS:
        return none
    low_m, high_m = np.quantile(points_m, [_TAILS, 1 - _TAILS], axis=0)
    sides_m = high_m - low_m
    if not sides_m.min() > 0:
        return none
    inside = ((points_m >= low_m) & (points_m <= high_m)).all(axis=1)
    cell = np.minimum((points_m[inside] - low_m) / sides_m * cells, cells - 1).astype(np.int64)
    counts = np.bincount(np.ravel_multi_index(tuple(cell.T), (cells,) * 3), minlength=cells**3)
    if np.mean(counts > 0) < settings.filled:
        return none
    per_m3 = np.quantile(counts, _BARE) * cells**3 / float(np.prod(sides_m))
    if not per_m3 > 0:
        return none
    noise_m = np.cbrt(_SIXTH / (4 / 3 * np.pi * per_m3))
    sixth_m = np.asarray(cKDTree(points_m).query(points_m, k=[_SIXTH + 1], workers=-1)[0])[:, 0]
    close = sixth_m < settings.closer * noise_m
    if not close.any():
        return none
    noise = ~close | (sixth_m > settings.spacings * np.median(sixth_m[close]))
    return np.asarray(noise) if settings.min_noise <= noise.mean() <= settings.max_noise else none
