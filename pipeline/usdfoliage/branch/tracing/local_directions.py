"""Where the points around each point of a cloud lie in a line, and which: on a twig along it, on a stem nowhere."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

_AROUND = 16  # points, the one itself among them


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalDirections:
    """Of the points around each point."""

    direction: NDArray[np.float64]  # (N, 3), unit, of their largest spread
    in_line: NDArray[np.float64]  # (N,), 0 where they spread to two sides equally, 1 where they lie in a line


def local_directions(points_m: NDArray[np.float64]) -> LocalDirections:
    """Directions by the principal axes of the nearest points.

    Args:
        points_m: (N, 3), two or more.

    Source:
        J. Demantke et al., Dimensionality based scale selection in 3D lidar point clouds, 2011, equation 2 (linearity,
        of variances here).
    """
    count = min(_AROUND, len(points_m))
    around = np.asarray(cKDTree(points_m).query(points_m, k=list(range(1, count + 1)), workers=-1)[1])
    offset_m = points_m[around] - points_m[around].mean(axis=1, keepdims=True)
    variance, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offset_m, offset_m))
    longest = variance[:, 2]
    in_line = np.divide(longest - variance[:, 1], longest, out=np.zeros(len(points_m)), where=longest > 0)
    return LocalDirections(direction=axes[:, :, 2], in_line=in_line)
