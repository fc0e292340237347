"""Which colours are those of green leaves."""

import numpy as np
from numpy.typing import NDArray

MIN_EXCESS = 0.06  # of green, of all light, from which on a point is green: walls, pots and soil have less
DARK = 0.01  # of white, added to what colours are divided by


def green_excess(colors: NDArray[np.number], dark: float = DARK) -> NDArray[np.float64]:
    """(N,) excess of green in colours (N, 3), red, green and blue, 0 to 255: -1 to 2, 0 for grey ones.

    Args:
        colors: Encoded for display.
        dark: Of white, added to every colour: those about as dark are taken for grey.
    """
    shade = np.asarray(colors, np.float64) / 255 + dark
    return np.asarray((2 * shade[:, 1] - shade[:, 0] - shade[:, 2]) / shade.sum(axis=1))
