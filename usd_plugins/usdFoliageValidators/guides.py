"""Leaves that only guide: the copy that a plant carries where its leaves are shown as something else."""

from collections.abc import Callable

from pxr import Usd, UsdGeom

from usdFoliageValidators.findings import Findings

LEAVES_GUIDE = "/geo/guide/Leaves/"

Check = Callable[[Usd.Prim, object], Findings]


def is_guide_copy(prim: Usd.Prim) -> bool:
    """Whether leaves are that copy.

    The representations nurbs, subdiv and mesh hold the leaves of bezier again as a guide, from the same layer. A defect
    is reported where they are drawn; to report it of the copy too would make two findings of it.
    """
    return LEAVES_GUIDE in str(prim.GetPath()) and UsdGeom.Imageable(prim).ComputePurpose() == UsdGeom.Tokens.guide


def but_guide_copies(check: Check) -> Check:
    """The same validator of a prim, which reports nothing of a guide's copy."""

    def check_drawn(prim: Usd.Prim, time: object) -> Findings:
        return [] if is_guide_copy(prim) else check(prim, time)

    return check_drawn
