"""The parameters of a plant that grows.

J. Guo et al., Realistic procedural plant modeling from multiple view images, 2020, table 1 and section 5.2.
"""

from dataclasses import dataclass, field

import numpy as np

from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.growth.logistic import LogisticSettings


@dataclass(frozen=True, kw_only=True)
class GrowthSettings:
    """The parameters of a plant (table 1), and how its buds grow."""

    internode_m: float
    divergence_deg: float = 137.5  # phi, between laterals of successive nodes
    branching_deg: float = 37.0  # psi, between a lateral and what it springs from
    allometry: AllometrySettings = field(default_factory=AllometrySettings)
    logistic: LogisticSettings = field(default_factory=LogisticSettings)
    perception_deg: float = 90.0  # theta, opening of the cone in which a bud sees points
    kill: float = 0.5  # of the influence distance, within which points around a node are used up
    max_kill: float = 3.0  # internodes, that this is at most
    min_reach: float = 4.0  # internodes, that the influence distance is at least: what is left is grown into slowly
    max_kill_m: float = np.inf  # metres, that it is at most: points close together are not used up from afar
    max_gap_m: float = 0.0  # metres, how far buds look where none sees a point in its cone; 0: no farther than that
    max_unreached: float = 0.01  # share of the points, up to which growth leaves out those beyond gaps
    pull: float = 1.6  # alpha of equation 9, of the points
    tropism: float = 0.3  # beta of equation 9
    tropism_direction: tuple[float, float, float] = (0.0, -1.0, 0.0)
    max_cycles: int = 400
    rest: int = 3  # cycles without growth, after which a branch may be shed
    stub: float = 2.0  # internodes: a shorter branch is shed
    slenderness: float = 250.0  # of its thickness at its base, that a branch may be long
    min_radius_m: float = 0.0005  # of the finest twig

    def __post_init__(self) -> None:
        if not (np.isfinite(self.internode_m) and self.internode_m > 0):
            raise ValueError(f"internode_m must be above 0, not {self.internode_m:g}")
        if not (0 < self.perception_deg <= 360 and self.kill > 0 and self.max_kill > 0 and self.min_reach > 0):
            raise ValueError("perception_deg in (0, 360], kill, max_kill and min_reach above 0")
        if not (self.max_kill_m > 0 and self.max_gap_m >= 0 and 0 <= self.max_unreached < 1):
            raise ValueError("max_kill_m must be above 0, max_gap_m not below, max_unreached in [0, 1)")
        if not (self.pull >= 0 and self.tropism >= 0 and np.isfinite(self.tropism_direction).all()):
            raise ValueError("pull and tropism must not be below 0, tropism_direction finite")
        if not (self.rest >= 1 and self.stub >= 0 and self.slenderness > 0 and self.min_radius_m > 0):
            raise ValueError("rest at least 1, stub not below 0, slenderness and min_radius_m above 0")
