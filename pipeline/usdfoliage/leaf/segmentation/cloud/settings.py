"""How leaves are found in a cloud."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class CloudSegmentationSettings:
    """How points become leaves."""

    # The cloud is thinned to this many points at most before leaves are looked for. Range: 100 or more.
    max_points: int = 300_000
    # The plane at a point is fitted to this many points around it. Range: 4 or more.
    plane_neighbours: int = 10
    # A point is linked with this many points around it at most. Range: 3 or more.
    linked_neighbours: int = 12
    # Points are linked up to this multiple of the local distance between points. Range: above 0.
    reach: float = 1.6
    # Links between points weaken where the planes at both differ by more than this. Unit: radians. Range: above 0.
    bend_rad: float = 0.35
    # Links between points weaken where one lies off the plane of the other by more than this multiple of the noise.
    # Range: above 0.
    offset_noises: float = 2.0
    # Regions are joined by the sum of their links over the size of the smaller one to this power: 0 the most links
    # first, 1 the smallest first. Range: 0 to 1.
    size_power: float = 0.7
    min_points: int = 10  # A leaf has at least this many points. Range: 4 or more.
    # A region is a leaf where that is at least so probable. Range: 0 to 1.
    min_probability: float = 0.45

    def __post_init__(self) -> None:
        minima = {"max_points": 100, "plane_neighbours": 4, "linked_neighbours": 3, "min_points": 4}
        for name, low in minima.items():
            if getattr(self, name) < low:
                raise ValueError(f"{name} must be at least {low}, not {getattr(self, name)}")
        for name in ("reach", "bend_rad", "offset_noises"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")
        for name in ("size_power", "min_probability"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be from 0 to 1, not {getattr(self, name)}")
