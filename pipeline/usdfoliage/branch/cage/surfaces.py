"""The surfaces of a plant's branches, fine and coarse."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from usdfoliage.branch.cage.build import BranchCage


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchSurfaces:
    """The surface of all branches, and coarser ones, which have those up to an order alone."""

    whole: BranchCage
    by_order: Sequence[tuple[int, BranchCage]] = field(default_factory=tuple)

    @property
    def coarsest(self) -> BranchCage:
        """That of the branches of order 1, or where there is none such the whole."""
        return next((cage for order, cage in self.by_order if order == 1), self.whole)
