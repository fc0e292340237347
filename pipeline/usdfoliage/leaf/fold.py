"""Leaves that fold over themselves.

Seen from above, a half of a leaf is a map from (u, v) to (x, y). Where it turns over, the Jacobian determinant changes
its sign; the heights do not matter. The determinant is a polynomial: Bezier coefficients of one sign prove that it
keeps its sign, values of both signs that it does not, and what neither decides is halved. Our own idea.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb

from usdfoliage.leaf.surface import leaf_nets

HALVINGS = 8  # so that what turns over in less than a 256th of u and v may stay unseen
TOLERANCE = 1e-9  # share of the greatest coefficient that counts as nothing


def find_folds(parameters: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Whether the map to (x, y) turns over inside either half: (N,) from parameters (N, 7, 3).

    A leaf that is turned over as a whole, as one of negative width is, does not fold.

    Raises:
        ValueError: A shape is wrong.
    """
    net = leaf_nets(parameters)[..., :2]
    right, left = _determinants(net[:, :, 3:]), _determinants(net[:, :, 3::-1])
    return _changes_sign(right) | _changes_sign(left)


def _determinants(half: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bezier coefficients (N, 6, 6), along v and across, of the determinant over v (1 - v), where it vanishes anyway.

    Args:
        half: (N, 5, 4, 2), control points of one half, columns from the axis to the silhouette.
    """
    by_u = 3 * np.diff(half, axis=2)[:, 1:4]  # all columns meet in the first and in the last row
    by_u *= (np.array([4.0, 6.0, 4.0]) / np.array([1.0, 2.0, 1.0]))[:, None, None]  # divided by v (1 - v)
    by_v = 4 * np.diff(half, axis=1)
    return _product(by_u[..., 0], by_v[..., 1]) - _product(by_u[..., 1], by_v[..., 0])


def _product(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bezier coefficients of the product of two tensor Bezier polynomials (N, K, C) and (N, L, D)."""
    rows, columns = (first.shape[axis] + second.shape[axis] - 1 for axis in (1, 2))
    product = np.zeros((len(first), rows, columns))
    scaled = second * _binomials(second)
    for k in range(first.shape[1]):
        for c in range(first.shape[2]):
            weight = comb(first.shape[1] - 1, k) * comb(first.shape[2] - 1, c)
            target = product[:, k : k + second.shape[1], c : c + second.shape[2]]
            target += weight * first[:, k, c, None, None] * scaled
    return product / _binomials(product)


def _binomials(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    rows, columns = coefficients.shape[1:]
    return np.outer(comb(rows - 1, np.arange(rows)), comb(columns - 1, np.arange(columns)))


def _changes_sign(coefficients: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether polynomials (N, K, C) have values of both signs on the unit square."""
    count = len(coefficients)
    positive, negative = np.zeros(count, bool), np.zeros(count, bool)
    scale = np.abs(coefficients).max(axis=(1, 2), initial=0.0)
    cells = coefficients / np.where(scale > 0, scale, 1.0)[:, None, None]
    leaf = np.arange(count)
    for _ in range(HALVINGS + 1):
        corners = cells[:, :: cells.shape[1] - 1, :: cells.shape[2] - 1].reshape(-1, 4)
        least, greatest = cells.min(axis=(1, 2)), cells.max(axis=(1, 2))
        # One sign all over a cell is that of its inside, whatever the corners are.
        np.logical_or.at(positive, leaf, (corners > TOLERANCE).any(axis=1) | ((least >= 0) & (greatest > TOLERANCE)))
        np.logical_or.at(negative, leaf, (corners < -TOLERANCE).any(axis=1) | ((greatest <= 0) & (least < -TOLERANCE)))
        open_cells = (least < -TOLERANCE) & (greatest > TOLERANCE) & ~(positive & negative)[leaf]
        cells, leaf = cells[open_cells], leaf[open_cells]
        for axis in (1, 2):
            cells = np.concatenate(_halves(cells, axis))
            leaf = np.tile(leaf, 2)
    return positive & negative


def _halves(coefficients: NDArray[np.float64], axis: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The two halves of Bezier polynomials along an axis, by de Casteljau."""
    points = np.moveaxis(coefficients, axis, 0).copy()
    first, second = np.empty_like(points), np.empty_like(points)
    for step in range(len(points)):
        first[step], second[-1 - step] = points[0], points[-1]
        points = (points[1:] + points[:-1]) / 2
    return np.moveaxis(first, 0, axis), np.moveaxis(second, 0, axis)
