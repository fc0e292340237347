"""How long the longitudinal curves of leaves are."""

import numpy as np
from numpy.typing import NDArray
from usdfoliage.leaf.shape.surface import evaluate_grid

NODES = 24  # Gauss-Legendre nodes along a curve, exact for polynomials of degree 47


def curve_length(parameters: NDArray[np.floating], u: float) -> NDArray[np.float64]:
    """Length of the curve at u, in leaf space: (N,) from parameters (N, 7, 3); without jitter.

    Args:
        u: 0 for the axis, -1 and 1 for either side of the silhouette.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    tangents = evaluate_grid(parameters, [u], (nodes + 1) / 2).tangents_v[:, :, 0]
    return np.asarray(np.linalg.norm(tangents, axis=-1) @ (weights / 2))
