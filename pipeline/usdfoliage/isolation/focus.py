"""What the photographs of a capture are all aimed at."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class FocusSettings:
    """When photographs are taken to be aimed at one thing."""

    min_spread: float = 0.01  # of the directions of view: 0 where all are parallel, 2/3 where they are of all sides
    max_miss: float = 0.35  # of the distance, by which the median photograph's axis may pass beside
    min_before: float = 0.8  # share of the photographs that must have it before them

    def __post_init__(self) -> None:
        if not (0 < self.min_spread < 1 and self.max_miss > 0 and 0 <= self.min_before <= 1):
            raise ValueError(f"min_spread must be in (0, 1), max_miss above 0, min_before a share, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Focus:
    """What is looked at."""

    place_m: NDArray[np.float64]  # (3,)
    distance_m: float  # of the median camera


def find_focus(
    positions_m: NDArray[np.float64], axes: NDArray[np.float64], settings: FocusSettings = FocusSettings()
) -> Focus | None:
    """The point nearest to all optical axes, by least squares; None where the axes do not determine it.

    Photographs from the air look down side by side, and have none.

    Args:
        positions_m: (V, 3), where cameras stand.
        axes: (V, 3), where they look, of length 1.
        settings: When there is one.
    """
    if len(positions_m) < 3:
        return None
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    total = across.mean(axis=0)
    if float(np.linalg.eigvalsh(total)[0]) < settings.min_spread:
        return None
    place_m = np.linalg.solve(total, np.einsum("nij,nj->ni", across, positions_m).mean(axis=0))
    towards_m = place_m - positions_m
    ahead_m = np.einsum("ni,ni->n", towards_m, axes)
    distance_m = float(np.median(np.linalg.norm(towards_m, axis=1)))
    miss_m = float(np.median(np.linalg.norm(np.einsum("nij,nj->ni", across, towards_m), axis=1)))
    if not distance_m > 0 or miss_m > settings.max_miss * distance_m:
        return None
    if float((ahead_m > 0).mean()) < settings.min_before:
        return None
    return Focus(place_m=place_m, distance_m=distance_m)
