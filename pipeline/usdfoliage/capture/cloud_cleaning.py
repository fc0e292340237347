"""What a merged cloud loses before it is used: stray points, and points that lie too close together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.capture.cloud import Cloud

_CHUNK = 200_000  # points whose neighbours are looked for at once


@dataclass(frozen=True, kw_only=True)
class CleaningSettings:
    """Which points are strays, and how far apart the others may be."""

    neighbors: int = 6  # that a point must have within reach; 0 keeps strays
    reach: float = 4.0  # of the median distance between neighbouring points
    spacing_m: float = 0.0  # least distance between points that are left, as Poisson disks; 0 leaves them all
    seed: int = 0

    def __post_init__(self) -> None:
        if self.neighbors < 0 or not self.reach > 0 or not (np.isfinite(self.spacing_m) and self.spacing_m >= 0):
            raise ValueError("neighbors and spacing_m must not be below 0, reach must be above 0")


def drop_strays(cloud: Cloud, settings: CleaningSettings = CleaningSettings()) -> Cloud:
    """Without points that have few neighbours within reach: chance agreements of views stand alone in the air."""
    if settings.neighbors == 0 or len(cloud) <= settings.neighbors:
        return cloud
    tree = cKDTree(cloud.points_m)
    sample = cloud.points_m[:: max(1, len(cloud) // 20_000)]
    nearest = np.asarray(tree.query(sample, k=2, workers=-1)[0])[:, 1]
    reach_m = settings.reach * float(np.median(nearest))
    kept = np.zeros(len(cloud), bool)
    for start in range(0, len(cloud), _CHUNK):
        points = cloud.points_m[start : start + _CHUNK]
        away = tree.query(points, k=settings.neighbors + 1, distance_upper_bound=reach_m, workers=-1)[0]
        farthest = np.asarray(away)[:, -1]
        kept[start : start + _CHUNK] = np.isfinite(farthest)
    return cloud.take(kept)


def thin_to_disks(cloud: Cloud, settings: CleaningSettings = CleaningSettings()) -> Cloud:
    """Points that lie at least spacing_m apart, so many that no further one of the cloud fits between them.

    Poisson disks over given points: of any that conflict the first in a random order stays. M. Corsini et al.,
    Efficient and flexible sampling with blue noise properties of triangular meshes, 2012, pruning of samples.
    """
    if settings.spacing_m == 0 or len(cloud) == 0:
        return cloud
    rng = np.random.default_rng(settings.seed)
    rank = rng.permutation(len(cloud))
    kept: NDArray[np.int64] = np.zeros(0, np.int64)
    waiting = np.arange(len(cloud))
    while len(waiting):
        # The first of every cell of a grid as wide as a disk; then what of these conflicts, and what they cover.
        cells = np.floor(cloud.points_m[waiting] / settings.spacing_m).astype(np.int64)
        order = np.lexsort((rank[waiting], cells[:, 2], cells[:, 1], cells[:, 0]))
        first = np.ones(len(order), bool)
        first[1:] = (cells[order][1:] != cells[order][:-1]).any(axis=1)
        chosen = waiting[order[first]]
        chosen = chosen[np.argsort(rank[chosen])]
        tree = cKDTree(cloud.points_m[chosen])
        pairs = tree.query_pairs(settings.spacing_m, output_type="ndarray")
        beaten = np.zeros(len(chosen), bool)
        beaten[pairs.max(axis=1)] = True  # a pair's later one; it may come again once the others are settled
        chosen = chosen[~beaten]
        kept = np.concatenate([kept, chosen])
        near = cKDTree(cloud.points_m[chosen]).query(
            cloud.points_m[waiting], distance_upper_bound=settings.spacing_m, workers=-1
        )[0]
        waiting = waiting[~np.isfinite(near)]
    return cloud.take(np.sort(kept))
