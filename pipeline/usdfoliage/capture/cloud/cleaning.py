"""What a merged cloud loses before it is used: outliers, floating pieces, points that lie too close together."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from usdfoliage.capture.cloud.fusion import CELL_BITS
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.geometry.disks import choose_disks

_CHUNK = 200_000  # points whose neighbours are looked for at once
_FIRST_GAP = 16  # of the distance between neighbouring points: smaller pieces are looked for by drop_outliers
_GAP_CELLS = 4  # that a gap is wide when pieces are looked for; above 2 sqrt 3, see _find_pieces
_BESIDE = [step for step in product((-1, 0, 1), repeat=3) if step > (0, 0, 0)]  # half of the cells that touch one


@dataclass(frozen=True, kw_only=True)
class CleaningSettings:
    """Which points are outliers, and how far apart the others may be."""

    # A point with fewer neighbours within reach is an outlier and dropped; 0 keeps outliers. Range: 0 or more.
    neighbors: int = 6
    # Neighbours are searched within this many median distances between points. Unit: median distances. Range: above
    # 0.
    reach: float = 4.0
    # A floating piece is dropped where the gap around it is at least this many times its size; 0 keeps floating
    # pieces. Unit: sizes. Range: 0 or more.
    isolation: float = 3.0
    # Points are thinned so that they lie at least this far apart (Poisson disks); 0 keeps all. Unit: metres. Range: 0
    # or more.
    spacing_m: float = 0.0
    seed: int = 0  # Every random choice starts from this number. Range: 0 or more.

    def __post_init__(self) -> None:
        if self.neighbors < 0 or not self.reach > 0 or not (np.isfinite(self.spacing_m) and self.spacing_m >= 0):
            raise ValueError("neighbors and spacing_m must not be below 0, reach must be above 0")
        if not (np.isfinite(self.isolation) and self.isolation >= 0):
            raise ValueError(f"isolation must not be below 0, not {self.isolation:g}")


def drop_outliers(cloud: Cloud, settings: CleaningSettings = CleaningSettings()) -> Cloud:
    """Without points that have few neighbours within reach: chance agreements of views stand alone in the air."""
    if settings.neighbors == 0 or len(cloud) <= settings.neighbors:
        return cloud
    tree = cKDTree(cloud.points_m, balanced_tree=False)  # built in two thirds of the time, and asked as fast
    reach_m = settings.reach * _median_gap_m(cloud.points_m, tree)
    kept = np.zeros(len(cloud), bool)
    for start in range(0, len(cloud), _CHUNK):
        points = cloud.points_m[start : start + _CHUNK]
        away = tree.query(points, k=settings.neighbors + 1, distance_upper_bound=reach_m, workers=-1)[0]
        farthest = np.asarray(away)[:, -1]
        kept[start : start + _CHUNK] = np.isfinite(farthest)
    return cloud.take(kept)


def drop_floating(cloud: Cloud, settings: CleaningSettings = CleaningSettings()) -> Cloud:
    """Without pieces that float: a gap around them is wide for their size.

    What views agree about by mistake hangs alone in the air, be it as large as a leaf; leaves have a plant beside them.
    Gaps are doubled from one look to the next until all is one piece; that of the largest size always stays.
    """
    if settings.isolation == 0 or len(cloud) < 2:
        return cloud
    extent_m = float(np.ptp(cloud.points_m, axis=0).max())
    gap_m = _FIRST_GAP * _median_gap_m(cloud.points_m, cKDTree(cloud.points_m, balanced_tree=False))
    gap_m = max(gap_m, 2 * _GAP_CELLS * extent_m / (1 << CELL_BITS))
    if not gap_m > 0:  # all points are one
        return cloud
    # Cells of twice the side are made of cells, not of points: at first every point is one.
    cells = np.floor((cloud.points_m - cloud.points_m.min(axis=0)) * (_GAP_CELLS / gap_m)).astype(np.int64)
    sums_m: NDArray[np.float64] = cloud.points_m
    count: NDArray[np.float64] = np.ones(len(cloud))
    left = cell_of = np.arange(len(cloud))  # points, and the cell of each
    while True:
        keys, merged = np.unique(_number_cells(cells), return_inverse=True)
        first = np.zeros(len(keys), np.int64)
        first[merged] = np.arange(len(merged))
        cells, cell_of = cells[first], merged[cell_of]
        sums_m = np.column_stack([np.bincount(merged, line) for line in sums_m.T])
        count = np.bincount(merged, count).astype(np.float64)
        middles_m = sums_m / count[:, None]
        pieces, piece_of = _find_pieces(keys, middles_m, gap_m)
        if pieces == 1:
            return cloud.take(left)
        low_m, high_m = np.full((pieces, 3), np.inf), np.full((pieces, 3), -np.inf)
        np.minimum.at(low_m, piece_of, middles_m)
        np.maximum.at(high_m, piece_of, middles_m)
        size_m = np.linalg.norm(high_m - low_m, axis=1)
        floating = settings.isolation * size_m < gap_m
        floating[np.argmax(size_m)] = False
        stays = ~floating[piece_of]
        left, cell_of = left[stays[cell_of]], (np.cumsum(stays) - 1)[cell_of[stays[cell_of]]]
        cells, sums_m, count = cells[stays] >> 1, sums_m[stays], count[stays]
        gap_m *= 2


def _number_cells(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number (N,) for each of cells (N, 3), of which none is below 0; steps to cells beside them do not wrap."""
    return np.asarray(((cells[:, 0] + 1) << (2 * CELL_BITS)) | ((cells[:, 1] + 1) << CELL_BITS) | (cells[:, 2] + 1))


def _find_pieces(
    keys: NDArray[np.int64], middles_m: NDArray[np.float64], gap_m: float
) -> tuple[int, NDArray[np.int32]]:
    """How many pieces there are, and that of each cell: their middles are linked up to gap_m apart.

    Middles of cells that touch are less than 2 sqrt 3 of their sides apart, and so linked. What this joins to the
    largest piece, most of a plant, needs no look at the many links within it.
    """
    starts, ends = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)]

    def join() -> tuple[int, NDArray[np.int32]]:
        start, end = np.concatenate(starts), np.concatenate(ends)
        links = coo_array((np.ones(len(start), bool), (start, end)), shape=(len(keys), len(keys)))
        pieces, piece_of = connected_components(links, directed=False)
        return int(pieces), piece_of

    for x, y, z in _BESIDE:
        wanted = keys + ((x << (2 * CELL_BITS)) + (y << CELL_BITS) + z)
        found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        there = keys[found] == wanted
        starts.append(np.flatnonzero(there))
        ends.append(found[there])
    pieces, piece_of = join()
    if pieces == 1:
        return pieces, piece_of

    is_main = piece_of == np.argmax(np.bincount(piece_of))
    main, others = np.flatnonzero(is_main), np.flatnonzero(~is_main)
    pairs = others[cKDTree(middles_m[others]).query_pairs(gap_m, output_type="ndarray")]
    starts.append(pairs[:, 0])
    ends.append(pairs[:, 1])
    away_m, nearest = cKDTree(middles_m[main], balanced_tree=False).query(
        middles_m[others],
        distance_upper_bound=2 * gap_m,  # which itself is left out
        workers=-1,
    )
    near = np.asarray(away_m) <= gap_m
    starts.append(others[near])
    ends.append(main[np.asarray(nearest)[near]])
    return join()


def _median_gap_m(points_m: NDArray[np.float64], tree: cKDTree) -> float:
    """Median distance between neighbouring points, of a sample."""
    sample = points_m[:: max(1, len(points_m) // 20_000)]
    return float(np.median(np.asarray(tree.query(sample, k=2, workers=-1)[0])[:, 1]))


def thin_to_disks(cloud: Cloud, settings: CleaningSettings = CleaningSettings()) -> Cloud:
    """Points that lie at least spacing_m apart, so many that no further one of the cloud fits between them.

    Poisson disks over given points: of any that conflict the first in a random order stays.
    """
    if settings.spacing_m == 0 or len(cloud) == 0:
        return cloud
    return cloud.take(choose_disks(cloud.points_m, settings.spacing_m, settings.seed))
