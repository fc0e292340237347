"""What the rest of the system knows of a crown."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownModel:
    """A crown as distances and colours seen from its centre (thesis section 4.6).

    Cubemaps are in the layout of usdfoliage.geometry.cubemap. The crown's frame is the asset's: metres, right-handed,
    Y up, the photograph's camera looking along −Z.
    """

    radius_m: NDArray[np.float32]  # (6, N, N), distance from center_m, strictly positive
    color: NDArray[np.float32]  # (6, N, N, 3), linear Rec.709
    center_m: NDArray[np.float64]  # (3,), in the asset's frame
    relief_weight: float  # ρ, how much the relief moved the surface
    asset_from_photo: NDArray[np.float64]  # (4, 4), column vectors: (column, row, 0, 1) in pixels -> metres
