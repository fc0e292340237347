"""Jittered silhouettes as far as control nets of leaves can carry them."""

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.nurbs import SHAPE, net_weights
from usdfoliage.leaf.shape.surface import evaluate_points, leaf_nets

SAMPLES = 256  # along the silhouette; more than any jitter that a leaf is drawn with has waves
BLOCK = 1024  # leaves at once


def jittered_nets(
    parameters: NDArray[np.floating], jitter: Jitter = NO_JITTER, phase: NDArray[np.floating] | None = None
) -> NDArray[np.float64]:
    """Control nets (N, 5, 7, 3) of leaves (N, 7, 3) with the jitter, exact but for the jitter.

    Of that they keep what is nearest to it in the mean square: a silhouette has three free control points, too few for
    waves much shorter than the leaf.

    Args:
        phase: (N,), where on the jitter's wave each leaf begins; 0 by default.
    """
    nets = leaf_nets(parameters)
    if not jitter.amplitude:
        return nets
    phase = np.zeros(len(nets)) if phase is None else phase
    v = (np.arange(SAMPLES) + 0.5) / SAMPLES
    places = np.stack([np.ones(SAMPLES), v], axis=-1)
    nearest = np.linalg.pinv(net_weights(places).reshape(-1, *SHAPE[:2])[:, 1:4, 6])
    for first in range(0, len(nets), BLOCK):
        block = slice(first, first + BLOCK)
        right = evaluate_points(parameters[block], places, jitter, phase[block])
        right = nearest @ (right - evaluate_points(parameters[block], places))
        nets[block, 1:4, 6] += right
        nets[block, 1:4, 0] -= right
    return nets
