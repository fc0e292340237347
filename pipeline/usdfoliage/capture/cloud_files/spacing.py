"""How far apart the points of a cloud are, so that drawn points meet their neighbours."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.geometry.pinhole import Pinhole

_FEW = 20_000  # points that the density of a cloud is measured from
_NEIGHBORS = 4  # of a point on a surface
_CLOSE = 0.25  # share of the points that lie close together
_ALONE_M = 0.001  # between points of which nothing is known
_ACROSS = 1.5  # widths, in distances to the neighbours: without it gaps show across the diagonals


def point_widths(
    points_m: NDArray[np.float64], cameras: Sequence[Pinhole], thinning: float = 1.0
) -> NDArray[np.float32]:
    """So wide, (N,), that most points (N, 3) touch their neighbours on the surface; those that have none stay small.

    Points are as far apart as pixels of the nearest camera are at their distance; where clouds have been thinned, at
    least as far as those are that lie close together.

    Args:
        points_m: Of the cloud.
        cameras: That it was made with; without them the points are taken to be evenly dense.
        thinning: How many points of the cloud each of these stands for.
    """
    if len(points_m) <= _NEIGHBORS:
        apart_m = _ALONE_M
    else:
        some = points_m[:: max(1, len(points_m) // _FEW)]
        away_m = np.asarray(cKDTree(points_m).query(some, k=_NEIGHBORS + 1)[0])[:, -1]
        apart_m = float(np.quantile(away_m, _CLOSE if cameras else 0.5)) or _ALONE_M
    widths_m = np.full(len(points_m), np.inf if cameras else apart_m)
    for camera in cameras:
        offset_m = points_m - camera.position_m
        pixel = np.sqrt(thinning / np.prod(camera.focal_px))
        np.minimum(widths_m, np.sqrt(np.einsum("nc,nc->n", offset_m, offset_m)) * pixel, out=widths_m)
    return np.asarray(_ACROSS * np.maximum(widths_m, apart_m), np.float32)
