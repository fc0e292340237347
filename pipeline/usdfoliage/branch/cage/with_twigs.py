"""The surface of a choice of branches: some joined, some twigs that are drawn out of these, some left out."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.axis_places import Exits, axis_exits
from usdfoliage.branch.cage.build import BranchCage, DroppedBranch, build_branch_cage
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.leave_out import begin_earlier, only_used
from usdfoliage.branch.cage.rings import RingMarks
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.settle import ATTEMPTS
from usdfoliage.branch.cage.twig_choice import TwigChoice
from usdfoliage.branch.cage.twigs import draw_twigs, mark_twigs, stand_out
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.pruning import PrunedSkeleton, prune_branches

SHORT_ROUNDS = 4  # of leaving out what ends inside its parent: others then leave from there


def build_with_twigs(skeleton: Skeleton, choice: TwigChoice, settings: BranchCageSettings, exits: Exits) -> BranchCage:
    """The cage of the branches that are joined, and twigs drawn out of it; those left out are named in dropped.

    Args:
        skeleton: B branches.
        choice: Which of them are what.
        settings: How close the surface keeps to what is joined.
        exits: Of the skeleton, as axis_exits finds them.
    """
    chosen = ~choice.is_twig & ~choice.gone
    thick = np.flatnonzero(chosen)
    number = np.cumsum(chosen) - 1
    marks = mark_twigs(skeleton, choice.is_twig, exits)
    on_thick = chosen[marks.branch]
    marks = RingMarks(branch=number[marks.branch[on_thick]], arc_m=marks.arc_m[on_thick])
    known = None if choice.tried is None else _forget_tries(skeleton, choice.tried, chosen)
    if choice.apart is not None:
        known = np.zeros(len(skeleton), np.int64) if known is None else known
        known[choice.apart] = ATTEMPTS
    cage = build_branch_cage(skeleton.only(chosen), settings, marks, None if known is None else known[thick])
    tries = np.zeros(len(skeleton), np.int64) if known is None else known
    if cage.tries is not None:
        tries[thick] = cage.tries
    reasons = {int(thick[each.curve]): each.reason for each in cage.dropped}
    reasons |= dict.fromkeys(np.flatnonzero(choice.gone).tolist(), DropReason.TOO_MANY)
    if choice.afloat is not None:
        reasons |= dict.fromkeys(np.flatnonzero(choice.afloat).tolist(), DropReason.AFLOAT)
    cage = replace(
        cage,
        curve=thick[cage.curve].astype(np.int32),
        fork_curve=thick[cage.fork_curve].astype(np.int32),
        loose=tuple(thick[list(cage.loose)].tolist()) if cage.loose else (),
        order=skeleton.order[thick[cage.curve]].astype(np.int32),
        tries=tries,
    )
    if not choice.is_twig.any():
        return replace(cage, dropped=_sorted(reasons))
    for last in (False,) * (SHORT_ROUNDS - 1) + (True,):
        stays = np.ones(len(skeleton), bool)
        stays[list(reasons)] = False
        pruned = prune_branches(skeleton, stays)
        kept = np.flatnonzero(stays)
        pruned_exits = _carry_exits(exits, skeleton, pruned, kept)
        short = kept[choice.is_twig[kept] & ~stand_out(pruned.skeleton, pruned_exits)]
        if last or not len(short):
            break
        reasons |= dict.fromkeys(short.tolist(), DropReason.TOO_SHORT)
    back = replace(cage, curve=pruned.number[cage.curve], fork_curve=pruned.number[cage.fork_curve], loose=())
    drawn = draw_twigs(pruned.skeleton, choice.is_twig[kept], back, pruned_exits, choice.twig_settings)
    # As the skeleton that was given has them: a branch begins at its own first point.
    # What is joined does so already.
    later_m = np.where(choice.is_twig[kept], pruned.prefix_m, 0.0)[drawn.curve]
    st_m = begin_earlier(drawn.st_m, drawn.face_st, -later_m)
    numbered = replace(
        drawn,
        st_m=st_m,
        curve=kept[drawn.curve].astype(np.int32),
        order=skeleton.order[kept[drawn.curve]].astype(np.int32),
        fork_curve=kept[drawn.fork_curve].astype(np.int32),
        loose=tuple(sorted({*cage.loose, *kept[list(drawn.loose)].tolist()} if drawn.loose else cage.loose)),
        dropped=_sorted(reasons),
    )
    return only_used(numbered)


def _forget_tries(skeleton: Skeleton, tried: NDArray[np.int64], joined: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(B,) how often forks were tried, without what was tried (B,) for the sake of branches that are not joined now.

    Beside a fork that crossed others and is none any more there is more room, for what was given up as well.
    """
    free = np.where(tried >= ATTEMPTS, 0, tried)
    has_parent = skeleton.parent_curve >= 0
    crossed = ~joined & (tried > 0) & has_parent
    beside = np.zeros(len(skeleton) + 1, bool)  # a parent's branches; the last is for those without one
    beside[skeleton.parent_curve[crossed]] = True
    free[~joined | (beside[skeleton.parent_curve] & has_parent)] = 0
    free[skeleton.parent_curve[crossed]] = 0
    return free


def _carry_exits(exits: Exits, skeleton: Skeleton, pruned: PrunedSkeleton, kept: NDArray[np.int64]) -> Exits:
    """Where the axes of a pruned skeleton come out, looked for anew where a branch begins elsewhere than before."""
    parent = pruned.skeleton.parent_curve
    moved = (pruned.number[skeleton.parent_curve[kept]] != parent) & (skeleton.parent_curve[kept] >= 0)
    again = axis_exits(pruned.skeleton, moved)
    shifted_m = exits.parent_arc_m[kept] + np.where(parent >= 0, pruned.prefix_m[parent], 0.0)
    return Exits(
        curve=parent,
        parent_arc_m=np.where(moved, again.parent_arc_m, shifted_m),
        arc_m=np.where(moved, again.arc_m, exits.arc_m[kept]),
    )


def _sorted(reasons: Mapping[int, DropReason]) -> tuple[DroppedBranch, ...]:
    return tuple(DroppedBranch(curve=curve, reason=reasons[curve]) for curve in sorted(reasons))
