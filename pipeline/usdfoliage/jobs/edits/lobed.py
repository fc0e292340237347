"""From angles that a user names to a look of a lobed leaf on disk."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdfoliage.asset.looks.lobed import LobedAsset, write_lobed_look
from usdfoliage.asset.looks.look import check_look_output
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.edits.edit import Change, PlannedLook
from usdfoliage.leaf.lobed.deformation import FUNCTIONS, BranchFunctions, add_evenly, rotations_of
from usdfoliage.leaf.shape.edits import NEUTRAL
from usdfoliage.remarks import remark

MAX_DEG = 3600.0  # of a rotation


@dataclass(frozen=True, kw_only=True, eq=False)
class LobedEditRequest:
    """What the user asked for: rotations from the begin to the end of a branch, on top of those that there are."""

    asset: Path
    found: LobedAsset
    output: Path
    turn_deg: float = 0.0
    bend_deg: float = 0.0
    twist_deg: float = 0.0
    branch: int | None = None  # None: every one
    prim: str | None = None
    force: bool = False

    def __post_init__(self) -> None:
        for name in FUNCTIONS:
            angle = getattr(self, f"{name}_deg")
            if not abs(angle) <= MAX_DEG:
                raise ValueError(f"{name} must be -{MAX_DEG:g} to {MAX_DEG:g} degrees, not {angle:g}")


def plan_lobed_look(request: LobedEditRequest) -> PlannedLook:
    """The content of the look that a request asks for; writes nothing.

    Raises:
        FoliageError: There is no such branch, or the look cannot be written there.
    """
    leaf = request.found.leaf
    after = _edited(request)
    check_look_output(request.output, request.found.interface, force=request.force)
    branches = leaf.shape.branch_count
    old, new = (np.degrees(rotations_of(functions, branches)) for functions in (leaf.functions, after))
    changes = tuple(
        Change(name=f"{name} of branch {branch}", before=float(old[number, branch]), after=float(new[number, branch]))
        for number, name in enumerate(FUNCTIONS)
        for branch in range(branches)
        if new[number, branch] != old[number, branch]
    )
    remarks = () if changes else (remark("edits-change-nothing", "these edits change nothing: they are neutral"),)
    return PlannedLook(edits=NEUTRAL, prim=request.prim, changes=changes, remarks=remarks)


def write_lobed_edit(request: LobedEditRequest) -> PlannedLook:
    """Write the look; it appears whole or not at all, and the asset stays as it is.

    Raises:
        FoliageError: As plan_lobed_look, or the look cannot be written.
    """
    planned = plan_lobed_look(request)
    write_lobed_look(request.output, request.found, _edited(request), request.prim, force=request.force)
    return planned


def _edited(request: LobedEditRequest) -> BranchFunctions:
    leaf = request.found.leaf
    try:
        return add_evenly(
            leaf.functions,
            leaf.shape.branch_count,
            turn_rad=np.radians(request.turn_deg),
            bend_rad=np.radians(request.bend_deg),
            twist_rad=np.radians(request.twist_deg),
            only=request.branch,
        )
    except ValueError as error:
        raise FoliageError(f"{error} ({request.asset})", "see the report of the leaf for its branches") from error
