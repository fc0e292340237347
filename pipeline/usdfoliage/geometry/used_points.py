"""Points that faces use, numbered anew without the others."""

import numpy as np
from numpy.typing import NDArray


def find_used(corners: NDArray[np.integer], count: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Which of so many points corners use, and the corners by the numbers of those alone.

    Args:
        corners: (F, K), points from 0 to count - 1.
        count: Of all points.

    Returns:
        Points (U,), ascending, and corners (F, K) from 0 to U - 1.
    """
    used = np.zeros(count, bool)
    used[corners] = True
    number = np.cumsum(used, dtype=np.int32) - 1
    return np.flatnonzero(used), number[corners]
