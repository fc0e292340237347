"""Branches with their surface, and how some are left out of both."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.twig_choice import TwigChoice
from usdfoliage.branch.cage.twigs import TwigSettings
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.pruning import prune_branches
from usdfoliage.branch.rooted_tree import RootedTree
from usdfoliage.geometry.mesh_pieces import label_pieces
from usdfoliage.geometry.used_points import find_used


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedBranches:
    """A skeleton, and its surface."""

    skeleton: Skeleton
    cage: BranchCage
    settings: BranchCageSettings  # of what is joined
    twig_settings: TwigSettings
    number: NDArray[np.int32]  # (B,), of each branch that was given in the skeleton; -1 of one that is left out
    left_out: Mapping[DropReason, int]  # how many branches
    is_twig: NDArray[np.bool_]  # (K,)
    thickest_twig_m: float  # radius up to which branches are twigs for the number of faces; 0 where there are enough


def leave_out(skeleton: Skeleton, cage: BranchCage, choice: TwigChoice, settings: BranchCageSettings) -> ClosedBranches:
    """Leave out of the skeleton what the cage lacks."""
    left_out = Counter(each.reason for each in cage.dropped)
    stays = np.ones(len(skeleton), bool)
    stays[[each.curve for each in cage.dropped]] = False
    if not stays.any():  # a skeleton has a branch at least
        return ClosedBranches(
            skeleton=skeleton,
            cage=cage,
            settings=settings,
            twig_settings=choice.twig_settings,
            number=np.arange(len(skeleton), dtype=np.int32),
            left_out=left_out,
            is_twig=choice.is_twig,
            thickest_twig_m=0,
        )
    pruned = prune_branches(skeleton, stays)
    curve = pruned.number[cage.curve]
    return ClosedBranches(
        skeleton=pruned.skeleton,
        cage=replace(
            cage,
            st_m=begin_earlier(cage.st_m, cage.face_st, pruned.prefix_m[curve]),
            curve=curve,
            order=pruned.skeleton.order[curve],
            fork_curve=pruned.number[cage.fork_curve],
            tries=None if cage.tries is None else cage.tries[stays],
            dropped=(),
            loose=tuple(pruned.number[list(cage.loose)].tolist()) if cage.loose else (),
        ),
        settings=settings,
        twig_settings=choice.twig_settings,
        number=pruned.number,
        left_out=left_out,
        is_twig=choice.is_twig[stays],
        thickest_twig_m=0,
    )


def leave_lost(closed: ClosedBranches, lost: NDArray[np.bool_]) -> ClosedBranches:
    """Leave out branches with their faces and all that they carry."""
    skeleton, cage = closed.skeleton, closed.cage
    gone = with_carried(skeleton, lost)
    if gone.all():
        return closed
    # A piece goes as a whole, or it would be open.
    number = np.where(gone, -1, np.cumsum(~gone) - 1).astype(np.int32)
    stays = ~gone[cage.curve]
    of_point, count = label_pieces(len(cage.points_m), cage.faces)
    torn = np.zeros(count, bool)
    torn[of_point[cage.faces[~stays, 0]]] = True
    cut = stays & torn[of_point[cage.faces[:, 0]]]
    if cut.any():  # what is joined to a lost branch and does not hang on it: lost as well
        more = gone.copy()
        more[cage.curve[cut]] = True
        return leave_lost(closed, more)
    of_fork = np.repeat(np.arange(len(cage.fork_counts)), cage.fork_counts)
    forks = ~gone[cage.fork_curve]
    face_number = np.cumsum(stays) - 1
    known = np.where(closed.number >= 0, number[closed.number], -1).astype(np.int32)
    return replace(
        closed,
        skeleton=skeleton.only(~gone),
        cage=only_used(
            replace(
                cage,
                faces=cage.faces[stays],
                face_st=cage.face_st[stays],
                curve=number[cage.curve[stays]],
                order=cage.order[stays],
                fork_faces=face_number[cage.fork_faces[forks[of_fork]]].astype(np.int32),
                fork_counts=cage.fork_counts[forks],
                fork_curve=number[cage.fork_curve[forks]],
                tries=None if cage.tries is None else cage.tries[~gone],
                loose=tuple(int(number[each]) for each in cage.loose if not gone[each]),
            )
        ),
        number=known,
        is_twig=closed.is_twig[~gone],
        left_out=Counter(closed.left_out) + Counter({DropReason.AFLOAT: int(gone.sum())}),
    )


def begin_earlier(
    st_m: NDArray[np.float64], face_st: NDArray[np.integer], by_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Texture coordinates (S, 2) of faces (F,) whose branches begin so much earlier (F,) along their axes."""
    moved = st_m.copy()
    added_m = np.zeros(len(st_m))
    added_m[face_st] = by_m[:, None]
    moved[:, 1] += added_m
    return moved


def only_used(cage: BranchCage) -> BranchCage:
    """A cage with the points, rings and texture coordinates that its faces use."""
    used, faces = find_used(cage.faces, len(cage.points_m))
    used_st, face_st = find_used(cage.face_st, len(cage.st_m))
    return replace(
        cage,
        points_m=cage.points_m[used],
        ring=find_used(cage.ring[used], int(cage.ring.max(initial=-1)) + 1)[1],
        faces=faces,
        st_m=cage.st_m[used_st],
        face_st=face_st,
    )


def with_carried(skeleton: Skeleton, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(B,) these branches and all that they carry."""
    return np.asarray(RootedTree(skeleton.parent_curve).sum_below(some.astype(np.float64)) > 0)
