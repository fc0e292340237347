"""How far a plant reaches by time, and how many internodes its shoots grow in a cycle.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, section 5.2, equations 6 and 7.
There a plant is put into a box of 10 m, in which the first longest way is 2 m: here that is a share of the last one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_FULL_GROWN = 0.9999  # share of the longest way, from which on no more is grown


@dataclass(frozen=True, kw_only=True)
class LogisticSettings:
    """How growth begins; lengths are internodes."""

    longest: float = 200.0  # H_max: from a root to the farthest tip of the plant that is full-grown
    initial_share: float = 0.2  # H_0 / H_max
    initial_units: float = 0.3  # rho_0, a cycle

    def __post_init__(self) -> None:
        if not (np.isfinite(self.longest) and self.longest > 0 and self.initial_units > 0):
            raise ValueError(f"longest and initial_units must be above 0, not {self.longest:g}, {self.initial_units:g}")
        if not 0 < self.initial_share < 1:
            raise ValueError(f"initial_share must be in (0, 1), not {self.initial_share:g}")


def longest_path(cycle: float | NDArray[np.floating], settings: LogisticSettings) -> NDArray[np.float64]:
    """H_t (eq. 6) in internodes, after these cycles."""
    ahead = (1 / settings.initial_share - 1) * np.exp(-settings.initial_units * np.asarray(cycle, np.float64))
    return np.asarray(settings.longest / (1 + ahead))


def growth_units(cycle: float | NDArray[np.floating], settings: LogisticSettings) -> NDArray[np.float64]:
    """rho_t (eq. 7), internodes a cycle: the derivative of H_t."""
    reached = longest_path(cycle, settings)
    return np.asarray(settings.initial_units * reached * (1 - reached / settings.longest))


def cycles_until(share: float, settings: LogisticSettings) -> int:
    """Cycles after which H_t is such a share of H_max, in [0, 1): 0 where it is from the beginning."""
    if share <= settings.initial_share:
        return 0
    ahead = (1 / settings.initial_share - 1) / (1 / min(share, _FULL_GROWN) - 1)
    return int(np.log(ahead) / settings.initial_units)
