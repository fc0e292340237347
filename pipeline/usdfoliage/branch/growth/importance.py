"""Importance of points: many similar ones around a point on a branch, few around one on a leaf.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 5.2, equation 8.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

_CHUNK = 100_000  # points whose neighbours are in memory at once


@dataclass(frozen=True, kw_only=True)
class ImportanceSettings:
    """What counts as similar."""

    reach_internodes: float = 0.6  # epsilon_D: 3 cm where an internode has 5
    min_cosine: float = 0.9  # epsilon_A, between principal directions, whichever way they point
    neighbors: int = 32  # looked at, at most

    def __post_init__(self) -> None:
        if not self.reach_internodes > 0 or not 0 <= self.min_cosine <= 1 or self.neighbors < 3:
            raise ValueError(f"reach above 0, cosine in [0, 1], 3 neighbours or more, not {self}")


def weigh_points(
    points_m: NDArray[np.float64], internode_m: float, settings: ImportanceSettings = ImportanceSettings()
) -> NDArray[np.float64]:
    """(N,) weight w_i: how many neighbours have a principal direction like that of the point (eq. 8).

    Args:
        points_m: (N, 3).
        internode_m: Of the plant, by which the paper's lengths are scaled.
        settings: What counts as similar.
    """
    tree = cKDTree(points_m)
    reach_m = settings.reach_internodes * internode_m
    near = min(settings.neighbors, len(points_m) - 1)
    principal = np.zeros((len(points_m), 3))
    others = np.empty((len(points_m), near), np.int64)
    for start in range(0, len(points_m), _CHUNK):
        part = slice(start, start + _CHUNK)
        nearest = tree.query(points_m[part], k=list(range(1, near + 2)), workers=-1)
        away_m, found = (np.asarray(each) for each in nearest)
        is_near = away_m <= reach_m  # of the point itself always
        offset_m = np.where(is_near[..., None], points_m[found] - points_m[part][:, None], 0)
        count = is_near.sum(axis=1)[:, None]
        offset_m = np.where(is_near[..., None], offset_m - offset_m.sum(axis=1, keepdims=True) / count[..., None], 0)
        principal[part] = np.linalg.eigh(np.einsum("nki,nkj->nij", offset_m, offset_m))[1][:, :, 2]
        others[part] = np.where(is_near, found, -1)[:, 1:]
    weight = np.zeros(len(points_m))
    for start in range(0, len(points_m), _CHUNK):
        part = slice(start, start + _CHUNK)
        cosine = np.abs(np.einsum("nki,ni->nk", principal[np.maximum(others[part], 0)], principal[part]))
        weight[part] = ((others[part] >= 0) & (cosine > settings.min_cosine)).sum(axis=1)
    return weight
