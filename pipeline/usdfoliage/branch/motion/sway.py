"""A gentle sway of branches, that begins again where it ends: for each joint of a rig, how it turns in time.

Every branch swings about two axes across it, as a harmonic whose frequency goes through the loop a whole number of
times. Thin and long branches swing farther, short ones faster. Our own arrangement; it is no simulation.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.motion.rig import Rig
from usdfoliage.branch.motion.sway_frames import check_sway_frames

_SIDEWAYS = 0.4  # of a swing, across it: tips go round on ellipses
_LOW, _HIGH = 0.4, 2.0  # times the typical swing


@dataclass(frozen=True, kw_only=True)
class SwaySettings:
    """How branches swing."""

    frames: int = 96  # of the loop
    swing_rad: float = 0.035  # amplitude of a branch that is as slender as most of its order: 2 degrees
    trunk_share: float = 0.25  # of it, for a trunk, which carries all
    cycles: int = 2  # of the typical branch in a loop
    max_cycles: int = 4  # of the shortest

    def __post_init__(self) -> None:
        check_sway_frames(self.frames)
        if not (0 <= self.swing_rad <= 1 and 0 <= self.trunk_share <= 1):
            raise ValueError(
                f"swing_rad and trunk_share must be 0 to 1, not {self.swing_rad:g} and {self.trunk_share:g}"
            )
        if not 1 <= self.cycles <= self.max_cycles:
            raise ValueError(f"cycles must be 1 to {self.max_cycles}, not {self.cycles}")


def sway_joints(
    rig: Rig, skeleton: Skeleton, rng: np.random.Generator, settings: SwaySettings = SwaySettings()
) -> NDArray[np.float64]:
    """(T, J, 3) rotation vectors in radians, in each joint's own frame; after the last frame the first one follows.

    Args:
        rig: Of this skeleton.
        skeleton: Lengths and radii.
        rng: Of phases and of the directions in which branches swing.
        settings: How far, how often.
    """
    length_m = skeleton.lengths_m[rig.curve]
    radius_m = skeleton.radius_m[skeleton.first[rig.curve]]
    order = skeleton.order[rig.curve]
    slender, quick = length_m / radius_m, np.sqrt(1 / np.maximum(length_m, 1e-9))
    for number in np.unique(order):
        mine = order == number
        slender[mine] /= max(float(np.median(slender[mine])), 1e-9)
        quick[mine] /= max(float(np.median(quick[mine])), 1e-9)
    swing_rad = settings.swing_rad * np.clip(slender, _LOW, _HIGH) * np.where(order == 0, settings.trunk_share, 1.0)
    cycles = np.where(order == 0, 1, np.clip(np.rint(settings.cycles * quick), 1, settings.max_cycles))
    phase_rad, across_rad, heading_rad = 2 * np.pi * rng.random((3, len(rig)))
    turn = 2 * np.pi * np.arange(settings.frames)[:, None] / settings.frames * cycles
    # At rest the turn is not zero in a frame, but over the loop it is.
    forth, aside = np.sin(turn + phase_rad), _SIDEWAYS * np.sin(turn + across_rad)
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    across = np.stack([cosine * forth - sine * aside, np.zeros_like(forth), sine * forth + cosine * aside], axis=-1)
    return np.asarray(swing_rad[:, None] * across)
