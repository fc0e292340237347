"""A coloured cloud of points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
    """N points in the world of their cameras."""

    points_m: NDArray[np.float64]  # (N, 3)
    normals: NDArray[np.float32]  # (N, 3), unit, towards those that saw the point
    srgb: NDArray[np.uint8]  # (N, 3)
    confidence: NDArray[np.float32]  # (N,), 0 to 1, of the view that was surest
    views: NDArray[np.int32]  # (N,), how many saw it: those with a point in its cell, or that agree with one of these

    def __len__(self) -> int:
        return len(self.points_m)

    def take(self, chosen: NDArray[np.generic]) -> "Cloud":
        """Those of these numbers, or where a mask (N,) is True."""
        return Cloud(**{name: getattr(self, name)[chosen] for name in self.__dataclass_fields__})
