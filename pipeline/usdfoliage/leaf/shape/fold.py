"""Leaves that fold over themselves.

Seen from above, a half of a leaf is a map from (u, v) to (x, y). Where it turns over, the Jacobian determinant changes
its sign; the heights do not matter. The determinant is a polynomial: Bezier coefficients of one sign prove that it
keeps its sign, values of both signs that it does not, and what neither decides is halved. Our own idea.
"""

from math import comb

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.shape.surface import leaf_nets

HALVINGS = 8  # so that what turns over in less than a 256th of u and v may stay unseen
DEPTH = 0.01  # narrow tips on a bent axis turn over by less, where nobody sees it
BLOCK = 8192  # leaves looked at together, so that a million need no more memory


def find_folds(parameters: NDArray[np.floating], depth: float = DEPTH) -> NDArray[np.bool_]:
    """Whether the map to (x, y) turns over inside either half: (N,) from parameters (N, 7, 3).

    A leaf that is turned over as a whole, as one of negative width is, does not fold.

    Args:
        depth: How far the determinant must go to either side of 0 to count, as a share of its greatest coefficient.

    Raises:
        ValueError: A shape is wrong.
    """
    blocks = []
    for start in range(0, max(len(parameters), 1), BLOCK):
        net = leaf_nets(parameters[start : start + BLOCK])[..., :2]
        right, left = _determinants(net[:, :, 3:]), _determinants(net[:, :, 3::-1])
        blocks.append(_changes_sign(right, depth) | _changes_sign(left, depth))
    return np.concatenate(blocks)


def _determinants(half: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bezier coefficients (N, 8, 6), along v and across, of the determinant.

    Args:
        half: (N, 5, 4, 2), control points of one half, columns from the axis to the silhouette.
    """
    by_u, by_v = 3 * np.diff(half, axis=2), 4 * np.diff(half, axis=1)
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
    rows, columns = ([float(comb(count - 1, k)) for k in range(count)] for count in coefficients.shape[1:])
    return np.outer(rows, columns)


def _changes_sign(coefficients: NDArray[np.float64], depth: float) -> NDArray[np.bool_]:
    """Whether polynomials (N, K, C) go beyond depth on both sides of 0 on the unit square."""
    count = len(coefficients)
    positive, negative = np.zeros(count, bool), np.zeros(count, bool)
    scale = np.abs(coefficients).max(axis=(1, 2), initial=0.0)
    cells = coefficients / np.where(scale > 0, scale, 1.0)[:, None, None]
    leaf = np.arange(count)
    middle = _binomials(cells) / 2.0 ** (sum(cells.shape[1:]) - 2)
    for _ in range(HALVINGS + 1):
        corners = cells[:, :: cells.shape[1] - 1, :: cells.shape[2] - 1].reshape(-1, 4)
        values = np.column_stack([corners, np.einsum("nkc,kc->n", cells, middle)])
        positive[leaf[(values > depth).any(axis=1)]] = True
        negative[leaf[(values < -depth).any(axis=1)]] = True
        may_be_positive = (cells.max(axis=(1, 2), initial=-np.inf) > depth) & ~positive[leaf]
        may_be_negative = (cells.min(axis=(1, 2), initial=np.inf) < -depth) & ~negative[leaf]
        undecided = may_be_positive | may_be_negative
        cells, leaf = cells[undecided], leaf[undecided]
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
