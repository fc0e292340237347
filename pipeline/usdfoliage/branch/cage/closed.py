"""The surface of a plant's branches in one piece, within a number of faces, and the skeleton that it belongs to.

What cannot be in the surface is not in the skeleton: a branch that ends inside its parent, or that nothing joins to
it. The thicker branches are joined, the thinnest are twigs where all together would have too many faces. The method
is our own.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.axis_places import Exits, axis_exits
from usdfoliage.branch.cage.build import BranchCage, DroppedBranch, build_branch_cage
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.rings import RingMarks
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.settle import ATTEMPTS
from usdfoliage.branch.cage.twigs import SIDES, TwigSettings, count_rows, draw_twigs, mark_twigs, stand_out
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.pruning import PrunedSkeleton, prune_branches
from usdfoliage.branch.rooted_tree import RootedTree
from usdfoliage.branch.whole_wood import AFLOAT_M, bare_lengths
from usdfoliage.geometry.mesh_pieces import label_pieces, measure_gaps
from usdfoliage.geometry.smooth_mesh import refine_smooth

JOINED_FACES = 36.0, 4.0  # of a branch, with those on its parent: at its fork, and times the rows that it asks for
LEAN_FACES = 32.0, 3.0  # of a lean one

SURELY = 0.9  # times as many fewer faces as the last tips gave, from the next ones
FACES_OF_TWIG = 30  # that are fewer without a twig, before it is known
LIMBS = 0.15, 0.3, 0.5  # of the greatest radius: a thicker branch is a limb
ROUNDS = 3  # of choosing what is left out
COARSER = (1.0, 1.5, 2.0, 3.0)  # times fewer rings of twigs
SHORT_ROUNDS = 4  # of leaving out what ends inside its parent: others then leave from there
MANY = 10  # branches that one carries, with itself, from which on it is not made a twig for the want of a fork
ASTRAY_ROUNDS = 3  # of drawing otherwise what is bare, for others come to lie elsewhere then
AFLOAT_ROUNDS = 3
LOST_ROUNDS = 3  # of both: what was left out may have covered others
AFLOAT_LEVELS = (1, 2)  # of division, at which pieces are looked at: as reports and validation do, and finer
ASTRAY = 1.0  # radii of an axis without surface, from which on a branch is drawn otherwise
ASTRAY_EDGES = 0.5  # edges of the surface, once refined, that such an axis may be away from it
BARE_SHARE = 0.0005  # of the length of all axes, that may be without surface: half of what anybody allows
MARGIN = 0.3  # of that, which is left where there is more: others become bare by what is changed
TOUCH_M = 0.5 * AFLOAT_M  # between points of thin branches and what they run into
THIN_M = 0.015  # radius of branches that may be lost where it is not sure that they touch
UNSURE_M = 0.05  # of those that are drawn otherwise where it is not


@dataclass(frozen=True, kw_only=True, eq=False)
class TwigChoice:
    """Which branches are twigs, which are left out, and how coarse twigs are."""

    is_twig: NDArray[np.bool_]  # (B,)
    gone: NDArray[np.bool_]  # (B,)
    twig_settings: TwigSettings
    afloat: NDArray[np.bool_] | None = None  # (B,), those of what is left out that were beside the surface
    apart: NDArray[np.bool_] | None = (
        None  # (B,), those of the others that are pieces of their own, with what they carry
    )
    tried: NDArray[np.int64] | None = None  # (B,), how often forks were tried in a surface of much the same branches


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


def close_branches(
    skeleton: Skeleton, settings: BranchCageSettings = BranchCageSettings(), max_faces: int | None = None
) -> ClosedBranches:
    """Build the surface of branches, and leave out of the skeleton what is not in it.

    Args:
        skeleton: B branches; metres.
        settings: How close the surface keeps to it.
        max_faces: As many as the surface may have; as many as it takes where it is not given.
    """
    thickness_m = thickest_above(skeleton)
    exits = axis_exits(skeleton)
    none = np.zeros(len(skeleton), bool)
    choice = TwigChoice(is_twig=none, gone=none, twig_settings=TwigSettings())
    fits = max_faces is None or _joined_faces(skeleton, JOINED_FACES).sum() <= max_faces
    if fits:
        cage = build_with_twigs(skeleton, choice, settings, exits)
        fits = max_faces is None or len(cage.faces) <= max_faces
        choice = replace(choice, tried=cage.tries)
    if not fits and max_faces is not None:
        settings = replace(settings, lean=True)
        choice, cage = _fit_faces(skeleton, thickness_m, max_faces, settings, exits, choice.tried)
    twig_m = float(thickness_m[choice.is_twig].max(initial=0))
    closed = _leave_out(skeleton, cage, choice, settings)
    choice = replace(choice, tried=cage.tries)
    closed = _redraw_astray(skeleton, closed, choice, settings, exits)
    return replace(closed, thickest_twig_m=twig_m)


def _redraw_astray(
    skeleton: Skeleton, closed: ClosedBranches, choice: TwigChoice, settings: BranchCageSettings, exits: Exits
) -> ClosedBranches:
    """Draw what is bare, or joined and afloat, otherwise, and leave out what is afloat then.

    What carries others becomes a piece of its own with them, at first; all else, and what is bare then as well, becomes
    twigs. Both begin where their axes come out, or on those of their parents. What is left out may have covered others.
    """
    carries = RootedTree(skeleton.parent_curve).sum_above(np.ones(len(skeleton))) > MANY
    apart = np.zeros(len(skeleton), bool)
    astray = find_astray(closed, late=True)
    loose = np.zeros(len(closed.skeleton), bool)
    loose[list(closed.cage.loose)] = True
    astray |= loose & ~carries[closed.number >= 0]  # drawn out of a face a twig is joined
    for _ in range(LOST_ROUNDS):
        for _ in range(ASTRAY_ROUNDS):
            again = np.append(astray, False)[closed.number] & ~choice.is_twig
            if not again.any():
                break
            is_twig = _with_carried(skeleton, choice.is_twig | (again & (apart | ~carries)))
            apart = apart | again
            choice = replace(choice, is_twig=is_twig & ~choice.gone, apart=apart & ~is_twig)
            closed, choice = _draw(skeleton, choice, settings, exits)
            astray = find_astray(closed, late=False)
        afloat = find_afloat(closed, thin_m=UNSURE_M)
        again = np.append(afloat & (closed.skeleton.parent_curve >= 0), False)[closed.number] & ~choice.is_twig
        if again.any():
            is_twig = _with_carried(skeleton, choice.is_twig | again)
            choice = replace(choice, is_twig=is_twig & ~choice.gone, apart=apart & ~is_twig)
            closed, choice = _draw(skeleton, choice, settings, exits)
            afloat = np.ones(len(closed.skeleton), bool)
        drawn = closed
        closed = _leave_afloat(drawn, afloat)
        if closed is drawn:
            break
        astray = find_astray(closed, late=False)
        if not astray.any():
            break
        left_out = (drawn.number >= 0) & (closed.number < 0)
        left_out |= False if choice.afloat is None else choice.afloat
        left_out = _with_carried(skeleton, left_out)  # what was left out before it as well
        choice = replace(choice, is_twig=choice.is_twig & ~left_out, gone=choice.gone | left_out, afloat=left_out)
    return closed


def _draw(
    skeleton: Skeleton, choice: TwigChoice, settings: BranchCageSettings, exits: Exits
) -> tuple[ClosedBranches, TwigChoice]:
    """The surface of a choice, and the choice with what it showed of the forks."""
    cage = build_with_twigs(skeleton, choice, settings, exits)
    return _leave_out(skeleton, cage, choice, settings), replace(choice, tried=cage.tries)


def _leave_afloat(closed: ClosedBranches, among: NDArray[np.bool_]) -> ClosedBranches:
    """Leave out what is afloat among branches (B,) and what is near; the same where nothing is, or nothing would be
    left."""
    if not among.any():
        return closed
    lost = find_afloat(closed, among)
    for _ in range(AFLOAT_ROUNDS):
        if not lost.any():
            break
        before = closed
        closed = _without(before, lost)
        if closed is before:
            break
        lost = find_afloat(closed, _beside_lost(before, closed))
    return closed


def _fit_faces(
    skeleton: Skeleton,
    thickness_m: NDArray[np.float64],
    max_faces: int,
    settings: BranchCageSettings,
    exits: Exits,
    tried: NDArray[np.int64] | None,
) -> tuple[TwigChoice, BranchCage]:
    """Join as many branches as the number of faces allows, the thickest first; the others are twigs.

    With all branches as twigs, finer or coarser ones, it is known what is left for joining; at last the thinnest tips
    are left out.
    """
    rooted = skeleton.parent_curve < 0
    none = np.zeros(len(skeleton), bool)
    rows = count_rows(skeleton)[~rooted].sum()
    left = list(COARSER)
    while left:
        coarser = left.pop(0)
        choice = TwigChoice(is_twig=~rooted, gone=none, twig_settings=TwigSettings(coarser=coarser), tried=tried)
        cage = build_with_twigs(skeleton, choice, settings, exits)
        if len(cage.faces) <= max_faces:
            return _join_limbs(skeleton, thickness_m, max_faces, settings, exits, (choice, cage))
        # What is not enough by far need not be built.
        needed = len(cage.faces) - max_faces
        left = [each for each in left if SIDES * rows * (1 / coarser - 1 / each) > needed or each == COARSER[-1]]
    each = float(FACES_OF_TWIG)
    for _ in range(ROUNDS):
        before = len(cage.faces), int(choice.gone.sum())
        gone = _thinnest_tips(skeleton, thickness_m, choice.gone, int(np.ceil((before[0] - max_faces) / each)))
        choice = replace(choice, is_twig=~rooted & ~gone, gone=gone)
        cage = build_with_twigs(skeleton, choice, settings, exits)
        if len(cage.faces) <= max_faces:
            break
        each = max((before[0] - len(cage.faces)) / max(int(gone.sum()) - before[1], 1) * SURELY, 1.0)
    return choice, cage


def _join_limbs(
    skeleton: Skeleton,
    thickness_m: NDArray[np.float64],
    max_faces: int,
    settings: BranchCageSettings,
    exits: Exits,
    fits: tuple[TwigChoice, BranchCage],
) -> tuple[TwigChoice, BranchCage]:
    """Join the limbs of a tree as far as there are faces for them; fits has none that is joined, and comes back if none
    can be.

    Of the twigs of a joined limb some find no face to leave by, and become pieces of their own; those of a twig do.
    """
    may = skeleton.parent_curve >= 0
    more = _joined_faces(skeleton, LEAN_FACES) - np.bincount(fits[1].curve, minlength=len(skeleton))
    for share in LIMBS:
        is_twig = may & (thickness_m < share * thickness_m.max())
        joined = may & ~is_twig
        if not joined.any() or len(fits[1].faces) + more[joined].sum() > max_faces:
            continue
        choice = replace(fits[0], is_twig=is_twig)
        cage = build_with_twigs(skeleton, choice, settings, exits)
        if len(cage.faces) <= max_faces:
            return choice, cage
    return fits


def _joined_faces(skeleton: Skeleton, faces: tuple[float, float]) -> NDArray[np.float64]:
    """(B,) about how many faces branches have that are joined: at each fork, and times the rows that each asks for."""
    return np.asarray(faces[0] + faces[1] * SIDES * count_rows(skeleton))


def _thinnest_tips(
    skeleton: Skeleton, thickness_m: NDArray[np.float64], gone: NDArray[np.bool_], count: int
) -> NDArray[np.bool_]:
    """(B,) branches that are left out: so many more than are gone already, the thinnest first."""
    order = np.argsort(np.where((skeleton.parent_curve < 0) | gone, np.inf, thickness_m), kind="stable")
    more = min(count, int((~gone & (skeleton.parent_curve >= 0)).sum()))
    left_out = gone.copy()
    left_out[order[:more]] = True
    return _with_carried(skeleton, left_out)  # of one thickness a parent may be one


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
    st_m = _begin_earlier(drawn.st_m, drawn.face_st, -later_m)
    numbered = replace(
        drawn,
        st_m=st_m,
        curve=kept[drawn.curve].astype(np.int32),
        order=skeleton.order[kept[drawn.curve]].astype(np.int32),
        fork_curve=kept[drawn.fork_curve].astype(np.int32),
        loose=tuple(sorted({*cage.loose, *kept[list(drawn.loose)].tolist()} if drawn.loose else cage.loose)),
        dropped=_sorted(reasons),
    )
    return _only_used(numbered)


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


def find_afloat(
    closed: ClosedBranches, among: NDArray[np.bool_] | None = None, thin_m: float = THIN_M
) -> NDArray[np.bool_]:
    """(B,) branches whose piece of the surface neither has a root nor runs into another piece.

    Of thin branches it is not enough that the two go through each other: points of the one must be near the other, as
    in any drawing of the two that is not very fine.

    Args:
        closed: Of B branches.
        among: (B,), pieces are looked at that have a face of one of these; all where it is not given.
        thin_m: Radius up to which branches are thin.
    """
    skeleton, cage = closed.skeleton, closed.cage
    lost = np.zeros(len(skeleton), bool)
    of_point, count = label_pieces(len(cage.points_m), cage.faces)
    of_face = of_point[cage.faces[:, 0]]
    rooted = np.zeros(count, bool)
    rooted[of_face[skeleton.parent_curve[cage.curve] < 0]] = True
    chosen = of_face if among is None else of_face[among[cage.curve]]
    asked = np.setdiff1d(chosen, np.flatnonzero(rooted))
    if not len(asked):
        return lost
    wanted = np.zeros(count, bool)
    wanted[asked] = True
    near = _faces_near(cage, wanted[of_face])
    used, corners = np.unique(cage.faces[near], return_inverse=True)
    thickest_m = np.zeros(count)
    np.maximum.at(thickest_m, of_face, np.maximum.reduceat(skeleton.radius_m, skeleton.first)[cage.curve])
    thin = asked[thickest_m[asked] < thin_m]
    afloat = np.zeros(count, bool)
    for levels in AFLOAT_LEVELS:
        points_m, faces = refine_smooth(cage.points_m[used], corners.reshape(-1, 4), levels)
        piece = np.zeros(len(points_m), np.int32)
        piece[faces] = np.repeat(of_face[near], 4**levels)[:, None]
        afloat[asked[measure_gaps(points_m, faces, piece, asked) > 0]] = True
    # At the finest.
    afloat[thin[measure_gaps(points_m, faces, piece, thin, TOUCH_M, through=False) > TOUCH_M]] = True
    lost[cage.curve[afloat[of_face]]] = True
    return lost


def _beside_lost(before: ClosedBranches, after: ClosedBranches) -> NDArray[np.bool_]:
    """(B,) branches of the surface after, with faces near those that it lacks and the one before has."""
    given = np.flatnonzero(before.number >= 0)
    number = np.full(len(before.skeleton), -1)
    number[before.number[given]] = after.number[given]
    near = number[before.cage.curve[_faces_near(before.cage, number[before.cage.curve] < 0)]]
    beside = np.zeros(len(after.skeleton), bool)
    beside[near[near >= 0]] = True
    return beside


def find_astray(closed: ClosedBranches, *, late: bool) -> NDArray[np.bool_]:
    """(B,) joined branches that leave their parent elsewhere than their axes do, for want of room.

    Args:
        closed: Of B branches.
        late: Whether those count that come back late, and not only as many as bring down what is bare of all.
    """
    skeleton, cage = closed.skeleton, closed.cage
    if not len(cage.faces) or closed.is_twig.all():
        return np.zeros(len(skeleton), bool)
    joined = ~closed.is_twig  # what they carry is joined as well, or a twig
    used, corners = np.unique(cage.faces[joined[cage.curve]], return_inverse=True)
    points_m, faces = refine_smooth(cage.points_m[used], corners.reshape(-1, 4).astype(np.int32), 1)
    bare_m = np.zeros(len(skeleton))
    bare_m[joined] = bare_lengths(skeleton.only(joined), points_m, faces, edges=ASTRAY_EDGES)
    bare_m[skeleton.parent_curve < 0] = 0.0
    allowed_each_m = (
        ASTRAY * np.maximum.reduceat(skeleton.radius_m, skeleton.first) if late else np.full(len(skeleton), np.inf)
    )
    return choose_astray(bare_m, allowed_each_m, BARE_SHARE * float(skeleton.lengths_m.sum()))


def choose_astray(
    bare_m: NDArray[np.float64], allowed_each_m: NDArray[np.float64], allowed_m: float
) -> NDArray[np.bool_]:
    """(B,) which branches are drawn otherwise, so that no more than what is allowed is left without surface.

    Args:
        bare_m: (B,), how much of each has no surface.
        allowed_each_m: (B,), how much of each may have none.
        allowed_m: How much of all others may have none.
    """
    astray = bare_m > allowed_each_m
    others_m = np.where(astray, 0.0, bare_m)
    order = np.argsort(others_m, kind="stable")
    summed_m = np.cumsum(others_m[order])
    more = np.zeros(len(bare_m), bool)
    more[order] = (summed_m > MARGIN * allowed_m) & (summed_m[-1] > allowed_m)
    return np.asarray(astray | (more & (others_m > 0)))


def _faces_near(cage: BranchCage, mine: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Faces (F,) that are mine, those within the size of both of them, and what touches these."""
    corners_m = cage.points_m[cage.faces]
    middle_m = corners_m.mean(axis=1)
    size_m = np.linalg.norm(corners_m - middle_m[:, None], axis=2).max(axis=1)
    near = mine.copy()
    classes = np.ceil(np.log2(np.maximum(size_m, 1e-9)))
    for own in np.unique(classes[mine]):
        tree = cKDTree(middle_m[mine & (classes == own)])
        for other in np.unique(classes[~near]):
            some = np.flatnonzero(~near & (classes == other))
            reach_m = 2 * 2.0**own + 2 * 2.0**other
            found = np.asarray(tree.query(middle_m[some], distance_upper_bound=reach_m, workers=-1)[0])
            near[some[np.isfinite(found)]] = True
    touched = np.zeros(len(cage.points_m), bool)
    touched[cage.faces[near]] = True
    return np.flatnonzero(touched[cage.faces].any(axis=1))


def _leave_out(
    skeleton: Skeleton, cage: BranchCage, choice: TwigChoice, settings: BranchCageSettings
) -> ClosedBranches:
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
            st_m=_begin_earlier(cage.st_m, cage.face_st, pruned.prefix_m[curve]),
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


def _begin_earlier(
    st_m: NDArray[np.float64], face_st: NDArray[np.integer], by_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Texture coordinates (S, 2) of faces (F,) whose branches begin so much earlier (F,) along their axes."""
    moved = st_m.copy()
    added_m = np.zeros(len(st_m))
    added_m[face_st] = by_m[:, None]
    moved[:, 1] += added_m
    return moved


def _without(closed: ClosedBranches, lost: NDArray[np.bool_]) -> ClosedBranches:
    """Leave out branches with their faces and all that they carry."""
    skeleton, cage = closed.skeleton, closed.cage
    gone = _with_carried(skeleton, lost)
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
        return _without(closed, more)
    of_fork = np.repeat(np.arange(len(cage.fork_counts)), cage.fork_counts)
    forks = ~gone[cage.fork_curve]
    face_number = np.cumsum(stays) - 1
    known = np.where(closed.number >= 0, number[closed.number], -1).astype(np.int32)
    return replace(
        closed,
        skeleton=skeleton.only(~gone),
        cage=_only_used(
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


def _only_used(cage: BranchCage) -> BranchCage:
    """A cage with the points, rings and texture coordinates that its faces use."""
    used, faces = np.unique(cage.faces, return_inverse=True)
    used_st, face_st = np.unique(cage.face_st, return_inverse=True)
    return replace(
        cage,
        points_m=cage.points_m[used],
        ring=np.unique(cage.ring[used], return_inverse=True)[1].astype(np.int32),
        faces=faces.reshape(-1, 4).astype(np.int32),
        st_m=cage.st_m[used_st],
        face_st=face_st.reshape(-1, 4).astype(np.int32),
    )


def _with_carried(skeleton: Skeleton, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(B,) these branches and all that they carry."""
    return np.asarray(RootedTree(skeleton.parent_curve).sum_below(some.astype(np.float64)) > 0)


def thickest_above(skeleton: Skeleton) -> NDArray[np.float64]:
    """(B,) the greatest radius of a branch and of all that it carries."""
    thickest_m = np.maximum.reduceat(skeleton.radius_m, skeleton.first)
    tree = RootedTree(skeleton.parent_curve)
    for level in reversed(tree.levels[1:]):
        np.maximum.at(thickest_m, skeleton.parent_curve[level], thickest_m[level])
    return np.asarray(thickest_m)


def _sorted(reasons: Mapping[int, DropReason]) -> tuple[DroppedBranch, ...]:
    return tuple(DroppedBranch(curve=curve, reason=reasons[curve]) for curve in sorted(reasons))
