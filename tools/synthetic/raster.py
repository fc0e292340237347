"""Triangles to pixels, with a depth buffer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CANDIDATES = 1 << 20  # pixels tried at a time, so that temporaries stay small


@dataclass(frozen=True, kw_only=True, eq=False)
class Hits:
    """What is seen through the centre of every pixel."""

    triangle: NDArray[np.int32]  # (H, W), -1 for none
    depth: NDArray[np.float64]  # (H, W), 0 for none

    def weights(
        self, places_px: NDArray[np.float64], inverse_depth: NDArray[np.float64], triangles: NDArray[np.int32]
    ) -> NDArray[np.float64]:
        """Shares (K, 3) that the corners have in the point of each of K pixels that hit, in their order."""
        rows, columns = np.nonzero(self.triangle >= 0)
        corners = triangles[self.triangle[rows, columns]]
        centers = np.column_stack([columns, rows]) + 0.5
        screen = _screen_weights(places_px[corners], *centers.T)
        true = np.column_stack(screen) * inverse_depth[corners]  # shares on the screen to shares in space
        return np.asarray(true / true.sum(axis=1, keepdims=True))


def rasterise(
    places_px: NDArray[np.float64],
    inverse_depth: NDArray[np.float64],
    triangles: NDArray[np.int32],
    size: tuple[int, int],
) -> Hits:
    """Find the nearest triangle in every pixel, by one ray through its centre.

    Args:
        places_px: (V, 2), x and y in the picture; pixel (row i, column j) has its centre at (j + 0.5, i + 0.5).
        inverse_depth: (V,), 1 / z, which is linear in the picture; the greatest is the nearest. Triangles with a corner
            at 0 or below, behind the camera, are not seen.
        triangles: (F, 3), either way round.
        size: Rows and columns of the picture.
    """
    height, width = size
    nearest = np.zeros(height * width)
    found = np.full(height * width, -1, np.int32)
    before_camera = np.flatnonzero((inverse_depth[triangles] > 0).all(axis=1))
    corners = places_px[triangles[before_camera]]
    low = np.maximum(np.ceil(corners.min(axis=1) - 0.5), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1) - 0.5), (width - 1, height - 1)).astype(np.int64)
    spans = np.maximum(high - low + 1, 0)
    counts = spans.prod(axis=1)
    drawn = np.flatnonzero(counts)
    ends = np.cumsum(counts[drawn])
    begin = 0
    while begin < len(drawn):
        before = ends[begin - 1] if begin else 0
        end = max(int(np.searchsorted(ends, before + CANDIDATES, side="right")), begin + 1)
        chosen = drawn[begin:end]
        begin = end
        triangle = np.repeat(chosen, counts[chosen])
        start = np.repeat(np.cumsum(counts[chosen]) - counts[chosen], counts[chosen])
        row, column = np.divmod(np.arange(len(triangle)) - start, spans[triangle, 0])
        column += low[triangle, 0]
        row += low[triangle, 1]
        first, second, third = _screen_weights(corners[triangle], column + 0.5, row + 0.5)
        inside = np.flatnonzero((first >= 0) & (second >= 0) & (third >= 0))
        triangle, pixel = triangle[inside], (row * width + column)[inside]
        at_first, at_second, at_third = inverse_depth[triangles[before_camera[triangle]]].T
        inverse = first[inside] * at_first + second[inside] * at_second + third[inside] * at_third
        kept = np.flatnonzero(inverse > nearest[pixel])
        kept = kept[np.argsort(inverse[kept], kind="stable")]  # the nearest is written last
        nearest[pixel[kept]] = inverse[kept]
        found[pixel[kept]] = before_camera[triangle[kept]]
    depth = np.divide(1.0, nearest, out=np.zeros_like(nearest), where=nearest > 0)
    return Hits(triangle=found.reshape(size), depth=depth.reshape(size))


def _screen_weights(
    corners: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Barycentric coordinates (K,) of points x, y (K,) in triangles (K, 3, 2); NaN in those without area."""
    x0, y0 = corners[:, 0, 0], corners[:, 0, 1]
    x1, y1, x2, y2 = corners[:, 1, 0] - x0, corners[:, 1, 1] - y0, corners[:, 2, 0] - x0, corners[:, 2, 1] - y0
    x, y = x - x0, y - y0
    with np.errstate(divide="ignore", invalid="ignore"):
        over_area = 1 / (x1 * y2 - y1 * x2)
        second = (x * y2 - y * x2) * over_area
        third = (x1 * y - y1 * x) * over_area
        return 1 - second - third, second, third
