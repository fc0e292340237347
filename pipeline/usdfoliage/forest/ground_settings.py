"""How the ground is read from a mesh or a cloud, and found in a cloud that does not state it."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, kw_only=True)
class GroundFilterSettings:
    """What stands on the ground, and what is ground."""

    cell_m: float = 1.0  # side of the cells whose lowest points are compared
    widest_object_m: float = 40.0  # what is no wider is taken off: crowns, groups of trees, houses
    slope: float = 0.15  # rise over run by which the ground may differ from its trend
    step_m: float = 0.2  # height above the ground within which a cell is ground in any case
    near_m: float = 0.35  # distance from the surface within which points are ground

    def __post_init__(self) -> None:
        for name in ("cell_m", "widest_object_m", "step_m", "near_m"):
            if not 0 < getattr(self, name) <= 1e6:
                raise ValueError(f"{name} must be above 0 and up to 1e6 metres, not {getattr(self, name):g}")
        if not 0 <= self.slope <= 10:
            raise ValueError(f"slope must be 0 to 10, not {self.slope:g}")
        if self.widest_object_m < 4 * self.cell_m:
            raise ValueError(
                f"widest_object_m must be at least 4 cells of {self.cell_m:g} m, not {self.widest_object_m:g} m"
            )


@dataclass(frozen=True, kw_only=True)
class GroundSettings:
    """How a mesh or a cloud of the ground becomes a raster."""

    spacing_m: float | None = None  # side of a pixel; None: by the spacing of the points
    max_gap_m: float = 10.0  # holes of a cloud that are no wider are filled; a tall crown hides as much
    filter: GroundFilterSettings = field(default_factory=GroundFilterSettings)  # of a cloud without classes

    def __post_init__(self) -> None:
        if self.spacing_m is not None and not 1e-6 <= self.spacing_m <= 1e6:
            raise ValueError(f"ground_spacing must be a length of 1e-6 to 1e6 metres, not {self.spacing_m:g}")
        if not 0 <= self.max_gap_m < np.inf:
            raise ValueError(f"max_gap_m must be a length from 0 on, not {self.max_gap_m:g}")
