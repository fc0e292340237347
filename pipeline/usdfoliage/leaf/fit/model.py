"""What a fit gives."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.model import Leaves


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedLeaves:
    """The leaves that could be fitted, in the frame of their points, with confidence, residual_m and view."""

    leaves: Leaves  # N of them
    source: NDArray[np.int64]  # (N,), the number of each in the LeafPoints that were fitted
    outlined: NDArray[np.float64] | None = (
        None  # (N,), share of the edge's points on the silhouette; None: not measured
    )
    dropped: Mapping[str, int] = field(default_factory=dict)  # how many were not, by reason
