"""What is measured of leaves: widths and areas, all in leaf space, where the length from base to apex is 1.

Of natural leaves they are right to 2e-6; of leaves that fold, whose integrands have corners, to 1 %.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.shape.surface import evaluate_area_elements, evaluate_points, grid_places

BLOCK = 4096  # leaves measured at once, so that a million need no more memory than a few thousand
ALONG_NODES, ACROSS_NODES = 16, 8  # Gauss-Legendre nodes on either half of a surface
WIDTH_SAMPLES = 65


def leaf_area(parameters: NDArray[np.floating]) -> NDArray[np.float64]:
    """Area of the surface, folds counted as often as they lie over each other: (N,) from parameters (N, 7, 3)."""
    along, along_weights = _gauss_legendre(ALONG_NODES)
    across, across_weights = _gauss_legendre(ACROSS_NODES)
    places = grid_places(np.concatenate([-across[::-1], across]), along)
    weights = np.outer(along_weights, np.concatenate([across_weights[::-1], across_weights])).ravel()
    return _by_block(parameters, lambda leaves: evaluate_area_elements(leaves, places) @ weights)


def leaf_width(parameters: NDArray[np.floating]) -> NDArray[np.float64]:
    """Greatest distance from the left to the right silhouette at one v: (N,) from parameters (N, 7, 3).

    The greatest of WIDTH_SAMPLES distances, made finer by the parabola through it and its neighbours.
    """
    places = grid_places((-1.0, 1.0), np.linspace(0.0, 1.0, WIDTH_SAMPLES))

    def widths(leaves: NDArray[np.floating]) -> NDArray[np.float64]:
        sides = evaluate_points(leaves, places).reshape(len(leaves), WIDTH_SAMPLES, 2, 3)
        width = np.linalg.norm(sides[:, :, 1] - sides[:, :, 0], axis=-1)
        best = np.clip(width.argmax(axis=1), 1, WIDTH_SAMPLES - 2)
        before, at, after = (width[np.arange(len(leaves)), best + step] for step in (-1, 0, 1))
        bend = 2 * at - before - after
        rise = np.divide((after - before) ** 2, 8 * bend, out=np.zeros(len(leaves)), where=bend > 0)
        return np.asarray(at + rise)

    return _by_block(parameters, widths)


def _by_block(
    parameters: NDArray[np.floating], measure: Callable[[NDArray[np.floating]], NDArray[np.float64]]
) -> NDArray[np.float64]:
    blocks = [measure(parameters[start : start + BLOCK]) for start in range(0, max(len(parameters), 1), BLOCK)]
    return np.concatenate(blocks)


def _gauss_legendre(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights for integrals from 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2
