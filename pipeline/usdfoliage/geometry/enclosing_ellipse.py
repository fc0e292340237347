"""The smallest ellipses around sets of points of a plane."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native


@dataclass(frozen=True, kw_only=True, eq=False)
class Ellipses:
    """Ellipses, one a set; half axes are 0 where the points do not span one."""

    centers: NDArray[np.float64]  # (M, 2); NaN where the set is empty
    half_axes: NDArray[np.float64]  # (M, 2), the longer one first
    angles: NDArray[np.float64]  # (M,), of the longer one from +x, in radians, above -pi / 2 up to pi / 2


def enclosing_ellipses(
    points: NDArray[np.floating], offsets: NDArray[np.integer], *, tolerance: float = 1e-7, threads: int = 0
) -> Ellipses:
    """The ellipse of least area around each set of points.

    Points on a line have an ellipse without width, a single point one without length.

    Args:
        points: (P, 2), set after set.
        offsets: (M + 1,), where each set begins; from 0 to P.
        tolerance: The share by which an ellipse may be larger than the least one, about; it holds all points anyhow.

    Raises:
        ValueError: A shape is wrong, a point is not finite, or the tolerance is not above 0.

    Source:
        Khachiyan, Rounding of polytopes in the real number model of computation, 1996; Kumar and Yildirim,
        Minimum-volume enclosing ellipsoids and core sets, 2005.
    """
    places, begins = np.ascontiguousarray(points, np.float64), np.ascontiguousarray(offsets, np.int64)
    if places.ndim != 2 or places.shape[1] != 2:
        raise ValueError(f"points must be (P, 2), not {places.shape}")
    if (
        begins.ndim != 1
        or len(begins) < 1
        or begins[0] != 0
        or begins[-1] != len(places)
        or (np.diff(begins) < 0).any()
    ):
        raise ValueError("offsets must rise from 0 to the number of points")
    if not np.isfinite(places).all():
        raise ValueError("points must be finite")
    if not tolerance > 0:
        raise ValueError(f"the tolerance must be above 0, not {tolerance}")
    sets = len(begins) - 1
    centers, half_axes, angles = np.empty((sets, 2)), np.empty((sets, 2)), np.empty(sets)
    _native.enclosing_ellipses(
        places, begins, tolerance=tolerance, centers=centers, half_axes=half_axes, angles=angles, threads=threads
    )
    return Ellipses(centers=centers, half_axes=half_axes, angles=angles)
