"""What the rest of the system knows of a crown."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownModel:
    """A crown as distances and colours seen from its centre (thesis section 4.6).

    Cubemaps are in the layout of usdfoliage.geometry.cubemap. The crown's frame is the asset's: metres, right-handed,
    Y up, the photograph's camera looking along −Z.

    Attributes:
        radius_m: (6, N, N), metres from center_m, above 0; texels on shared edges are equal.
        color: (6, N, N, 3), linear Rec.709, likewise.
        center_m: (3,), metres, in the asset's frame.
        relief_weight: ρ, how much the relief moved the surface.
        asset_from_photo: (4, 4), for column vectors: from (column, row, 0, 1) in pixels, or the coordinates of another
            input, to the asset.
    """

    radius_m: NDArray[np.float32]
    color: NDArray[np.float32]
    center_m: NDArray[np.float64]
    relief_weight: float
    asset_from_photo: NDArray[np.float64]
