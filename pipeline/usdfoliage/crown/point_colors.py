"""The colour cubemap of a crown from the colours of its points, where there are no photographs. Our own."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.geometry.cubemap import face_directions, sample_cubemap

NEAREST = 4  # points whose mean a texel shows
WIDEST_RAD = 0.1  # from a texel's direction to a point that it shows
SHELL = 0.8  # of the radius, within which a point is hidden by those farther out
SHADE, LIGHT = 0.4, 1.2  # of a plain colour: at the shell's inner side, and as far beyond the radius


def shade_points(
    radius_m: NDArray[np.floating],
    center_m: NDArray[np.floating],
    points_m: NDArray[np.floating],
    plain: tuple[float, float, float],
) -> NDArray[np.float64]:
    """Colours (P, 3) for points without: a plain one, darker the deeper in the crown, as foliage shades itself.

    Arguments are those of gather_point_colors.
    """
    offset_m = np.asarray(points_m, np.float64) - center_m
    away_m = np.linalg.norm(offset_m, axis=1)
    toward = np.where(away_m[:, None] > 0, offset_m, (0.0, 1.0, 0.0))
    depth = (1 - away_m / sample_cubemap(radius_m, toward)) / (1 - SHELL)
    shade = np.interp(depth, [-1, 1], [LIGHT, SHADE])
    return np.asarray(shade[:, None] * np.array(plain))


def gather_point_colors(
    radius_m: NDArray[np.floating],
    center_m: NDArray[np.floating],
    points_m: NDArray[np.floating],
    colors: NDArray[np.floating],
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The colours of the outermost points in every direction from the crown's centre.

    Args:
        radius_m: (6, N, N), the crown's radius cubemap.
        center_m: (3,), in the points' frame.
        points_m: (P, 3), of the crown, one at least.
        colors: (P, 3), linear Rec.709; NaN where a point has none.

    Returns:
        Colours (6, N, N, 3), 0 where there is none, and where there are some (6, N, N).
    """
    size = radius_m.shape[1]
    offset_m = np.asarray(points_m, np.float64) - center_m
    away_m = np.linalg.norm(offset_m, axis=1)
    there = (away_m > 0) & np.isfinite(colors).all(axis=1)
    toward = offset_m[there] / away_m[there, None]
    outer = away_m[there] >= SHELL * sample_cubemap(radius_m, toward)
    if not outer.any():
        return np.zeros((6, size, size, 3), np.float32), np.zeros((6, size, size), bool)
    toward, light = toward[outer], np.asarray(colors, np.float64)[there][outer]
    count = min(NEAREST, len(toward))
    apart, near = cKDTree(toward).query(
        face_directions(size).reshape(-1, 3),
        k=count,
        distance_upper_bound=2 * np.sin(WIDEST_RAD / 2),
        workers=-1,
    )
    apart, near = np.reshape(apart, (-1, count)), np.reshape(near, (-1, count))
    texel = np.pi / 2 / size
    weight = np.where(np.isfinite(apart), 1 / (apart**2 + texel**2), 0.0)
    sums = np.einsum("tk,tkc->tc", weight, np.vstack([light, np.zeros(3)])[near])
    total = weight.sum(axis=1)
    color = sums / np.maximum(total, 1e-30)[:, None]
    return color.reshape(6, size, size, 3).astype(np.float32), (total > 0).reshape(6, size, size)
