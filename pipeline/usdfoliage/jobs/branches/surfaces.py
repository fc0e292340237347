"""The surfaces of an asset of branches: that of all, and those of the lower orders."""

from dataclasses import dataclass

import numpy as np

from usdfoliage.branch.axis_places import axis_exits
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.cage.closed import close_branches
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.leave_out import ClosedBranches
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.branch.cage.twig_choice import TwigChoice
from usdfoliage.branch.cage.with_twigs import build_with_twigs
from usdfoliage.branch.model import Skeleton
from usdfoliage.remarks import Remark, Setting, remark

FACES_A_POINT = 6  # of a cloud, that the surface of its branches may have
MIN_FACES, MAX_FACES = 30_000, 400_000
MIN_MAX_FACES = 1000  # that may be asked for
# Bends are those of points that were measured, and branches stay where they were.
CAGE = BranchCageSettings(axis_tolerance=0.1, longest_row=40.0, farthest=3.0)
_FINER = BranchCageSettings(axis_tolerance=0.01, longest_row=2.0, farthest=3.0)  # where that takes few faces
_FEW = 0.25  # of the faces that a surface may have
_COARSER_ORDERS = (1, 2)  # variants of the surface


@dataclass(frozen=True, kw_only=True, eq=False)
class MadeSurfaces:
    """The surfaces, and the skeleton that they belong to."""

    skeleton: Skeleton  # what is not in the surface is left out
    surfaces: BranchSurfaces
    left_out: int  # branches
    beyond_faces: int  # of these, for the number of faces
    remarks: tuple[Remark, ...]


def faces_of_cloud(points: int) -> int:
    """How many faces the surface of branches may have that were found in so many points."""
    return min(max(FACES_A_POINT * points, MIN_FACES), MAX_FACES)


def build_surfaces(skeleton: Skeleton, max_faces: int = MAX_FACES) -> MadeSurfaces:
    """The surface of all branches and those of the lower orders, with at most so many faces each."""
    closed = close_branches(skeleton, CAGE, max_faces)
    if len(closed.cage.faces) <= _FEW * max_faces:
        finer = close_branches(skeleton, _FINER, max_faces)
        closed = finer if len(finer.cage.faces) <= max_faces else closed
    highest = int(closed.skeleton.order.max())
    coarser = [(order, _build_up_to(closed, order)) for order in _COARSER_ORDERS if order < highest]
    return MadeSurfaces(
        skeleton=closed.skeleton,
        surfaces=BranchSurfaces(whole=closed.cage, by_order=tuple(coarser)),
        left_out=len(skeleton) - len(closed.skeleton),
        beyond_faces=closed.left_out.get(DropReason.TOO_MANY, 0),
        remarks=tuple(_describe(closed, len(skeleton))),
    )


def _build_up_to(closed: ClosedBranches, order: int) -> BranchCage:
    """The surface of the branches up to an order, twigs where the whole has them."""
    skeleton = closed.skeleton.up_to_order(order)
    is_twig = closed.is_twig[closed.skeleton.order <= order]
    tried = None if closed.cage.tries is None else closed.cage.tries[closed.skeleton.order <= order]
    choice = TwigChoice(
        is_twig=is_twig, gone=np.zeros(len(skeleton), bool), twig_settings=closed.twig_settings, tried=tried
    )
    return build_with_twigs(skeleton, choice, closed.settings, axis_exits(skeleton))


def _describe(closed: ClosedBranches, given: int) -> list[Remark]:
    remarks = []
    if closed.left_out:
        ordered = sorted(closed.left_out.items(), key=lambda item: -item[1])
        described = ", ".join(f"{count} {reason.text}" for reason, count in ordered)
        text = f"{given - len(closed.skeleton)} of {given} branches are left out: {described}"
        remarks.append(remark("branches-not-in-surface", text))
    if closed.cage.loose:
        text = (
            f"{len(closed.cage.loose)} branches would cross their parent where they join it: "
            "each begins a closed piece of its own inside it"
        )
        remarks.append(remark("branches-beside-parent", text))
    if closed.thickest_twig_m:
        text = (
            f"branches of up to {2000 * closed.thickest_twig_m:.3g} mm across have four sides, so that the surface "
            f"has {len(closed.cage.faces):,} faces"
        )
        remedy = ("give ", Setting(name="branches.max_faces"), " where more may be drawn")
        remarks.append(remark("branches-plain", text, remedy=remedy))
    return remarks
