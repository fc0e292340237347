"""How a cloud becomes a skeleton."""

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from usdfoliage.branch.tracing.cloud_graph import CloudGraphSettings
from usdfoliage.branch.tracing.meeting_fronts import FrontSettings
from usdfoliage.branch.tracing.radii import RadiusSettings
from usdfoliage.branch.tracing.refinement import RefinementSettings
from usdfoliage.branch.tracing.wood import WoodSettings

CloudLeaves = Literal["auto", "on", "off"]  # whether a cloud has leaves: found from the cloud, yes, no


@dataclass(frozen=True, kw_only=True)
class BranchSettings:
    """How a cloud becomes a skeleton. Lengths without a unit are internodes, or what their comment states."""

    internode_m: float | None = None  # without it from the height
    internode_of_height: float = 0.005  # table 2: 5 cm in a box of 10 m
    graph: CloudGraphSettings = field(default_factory=CloudGraphSettings)
    path_power: float = 3.0  # of a link's length, that it costs: paths cross where branches touch the less the higher
    sparse_power: float = 2.5  # the same where points are far apart, and paths from each to the next are no branches
    search_power: float = 2.0  # the same where leaves are looked for, through which paths are to be short
    coarse: float = 2.0  # internodes, thickness of a slice in which thick stems are found
    fine: float = 0.21  # internodes, thickness of a slice
    fine_spacings: float = 1.6  # distances to the sixth neighbour, thickness of a slice at most
    fine_noises: float = 2.5  # mean distances of points from a stem's surface, thickness of a slice at least
    sparse: float = 0.6  # internodes, that points are apart from where on each of them may be a twig's only one
    sparse_spacings: float = 0.14  # distances to the sixth neighbour, thickness of a slice there,
    wood_spacings: float = 0.03  # and where all points are taken for wood, known to be or not
    wood_stiffness: float = 0.3  # of axes there: slices have few points, which are all that is known of a twig
    stem_share: float = 0.3  # of the radius of a thick stem, thickness of its slices
    min_length: float = 1.0  # slices, that a branch must reach beyond its parent's surface
    max_gap: float = 1.0  # of the path beyond it, that a gap between a branch and the rest may be long
    stiffness: float = 4.0
    radii: RadiusSettings = field(default_factory=RadiusSettings)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    fronts: FrontSettings = field(default_factory=FrontSettings)
    leaves: CloudLeaves = "auto"
    wood: WoodSettings = field(default_factory=WoodSettings)

    def __post_init__(self) -> None:
        if self.internode_m is not None and not (np.isfinite(self.internode_m) and self.internode_m > 0):
            raise ValueError(f"internode_m must be above 0, not {self.internode_m:g}")
        if min(self.path_power, self.sparse_power, self.search_power) < 1:
            raise ValueError("path_power, sparse_power and search_power must be at least 1")
        if not (self.coarse > 0 and self.fine > 0 and self.min_length >= 0):
            raise ValueError("coarse and fine must be above 0, min_length not below 0")
        if not all(0 <= each < np.inf for each in (self.stiffness, self.wood_stiffness, self.fine_spacings)):
            raise ValueError("stiffness, wood_stiffness and fine_spacings must be finite and not below 0")
        if not self.max_gap > 0:
            raise ValueError(f"max_gap must be above 0, not {self.max_gap:g}")
        if self.leaves not in get_args(CloudLeaves):
            raise ValueError(f"leaves must be one of {', '.join(get_args(CloudLeaves))}, not {self.leaves!r}")
