"""What a user of branch cages decides."""

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True, kw_only=True)
class BranchCageSettings:
    """How close a cage keeps to its skeleton, in radii of the branch."""

    axis_tolerance: float = 0.01  # how far the surface may leave the axis in a bend
    longest_row: float = 24.0  # of faces along a branch
    clearance: float = 0.2  # between a parent and the first ring of a branch
    farthest: float = inf  # across its axis, that a branch is moved to where its parent has room; else it is no fork
    lean: bool = False  # fewer rings beside forks and tips

    def __post_init__(self) -> None:
        if not 0 < self.axis_tolerance <= 1:
            raise ValueError(f"axis_tolerance must be above 0 and at most 1, not {self.axis_tolerance}")
        if not self.longest_row >= 1:
            raise ValueError(f"longest_row must be 1 or more, not {self.longest_row}")
        if not self.farthest > 0:
            raise ValueError(f"farthest must be above 0, not {self.farthest}")
        if not 0 < self.clearance <= 2:
            raise ValueError(f"clearance must be above 0 and at most 2, not {self.clearance}")
