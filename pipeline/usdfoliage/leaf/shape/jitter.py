"""Jittered silhouettes: a wave along the silhouette that makes serrated or uneven edges."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# The procedural wave: (cycles a unit, weight). It repeats after PERIOD units, so that a phase may be taken modulo it.
WAVES = ((39 / 64, 0.3), (1.0, 0.4), (91 / 64, 0.3))
PERIOD = 64.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Jitter:
    """How silhouettes are jittered; the same for all leaves but for the phase."""

    amplitude: float = 0.0  # leaf lengths
    frequency: float = 8.0  # cycles from base to apex
    map: NDArray[np.float64] | None = None  # (M,), one cycle, -1 inwards to 1 outwards; procedural without

    def __post_init__(self) -> None:
        if not (np.isfinite(self.amplitude) and self.amplitude >= 0):
            raise ValueError(f"the amplitude must be 0 or more, not {self.amplitude}")
        if not (np.isfinite(self.frequency) and self.frequency > 0):
            raise ValueError(f"the frequency must be above 0, not {self.frequency}")
        if self.map is not None and (self.map.ndim != 1 or not len(self.map) or not np.isfinite(self.map).all()):
            raise ValueError(f"the map must be (M,) finite numbers, not {self.map.shape}")

    @property
    def reach(self) -> float:
        """How far a silhouette may be moved, in leaf lengths, whatever the phase."""
        peak = sum(weight for _, weight in WAVES) if self.map is None else float(np.abs(self.map).max())
        return self.amplitude * peak


NO_JITTER = Jitter()


def spread_phases(count: int) -> NDArray[np.float64]:
    """Phases (count,) in [0, PERIOD) that lie far apart for leaves that follow each other: a golden-ratio sequence.

    Sixteenths of a cycle: nobody sees the difference, and crate files keep arrays of at most 1024 values small.
    """
    return np.asarray(np.floor(16 * PERIOD * np.modf(np.arange(count) * ((5**0.5 - 1) / 2))[0]) / 16)
