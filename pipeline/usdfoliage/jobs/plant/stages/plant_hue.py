"""Whether leaves that were found have the plant's colour, whatever the light on them. Our own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.model import Leaves

_OF_PLANT = 0.95  # share of the leaves that show the plant's hue whose own hues count as it
_FEW = 8  # leaves that show the plant's hue; fewer show none


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantHue:
    """Hues of N leaves, as shares of red, green and blue, beside that of the plant: light does not change them."""

    hues: NDArray[np.float64]  # (N, 3)
    of_plant: NDArray[np.float64]  # (3,), the median of the leaves that show it
    off: NDArray[np.float64]  # (N,), distance of each hue from the plant's
    allowed: float  # distance within which 95 of 100 of the leaves that show it lie


def find_plant_hue(leaves: Leaves, showing: NDArray[np.bool_]) -> PlantHue | None:
    """The hues of leaves beside that of the plant; None where leaves have no colours or too few of them show it.

    Args:
        leaves: N.
        showing: (N,), leaves that are surely of the plant.
    """
    if leaves.color is None or np.count_nonzero(showing) < _FEW:
        return None
    hues = leaves.color / np.maximum(leaves.color.sum(axis=1, keepdims=True), 1e-9)
    of_plant = np.median(hues[showing], axis=0)
    off = np.linalg.norm(hues - of_plant, axis=1)
    return PlantHue(hues=hues, of_plant=of_plant, off=off, allowed=float(np.quantile(off[showing], _OF_PLANT)))
