"""The surface of a plant's branches in one piece, within a number of faces, and the skeleton that it belongs to.

What cannot be in the surface is not in the skeleton: a branch that ends inside its parent, or that nothing joins to
it. The thicker branches are joined, the thinnest are plain tubes where all together would have too many faces. The
method is our own.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage._native import refine_catmull_clark
from usdfoliage.branch.cage.build import BranchCage, DroppedBranch, build_branch_cage
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.rings import RingMarks
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.twigs import TwigSettings, count_twig_faces, draw_twigs, mark_twigs, stand_out
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.pruning import prune_branches
from usdfoliage.branch.rooted_tree import RootedTree
from usdfoliage.geometry.mesh_pieces import find_pieces

FEWEST_JOINED = 30  # faces of a branch that is joined
EACH_JOINED = 75.0  # the same with those on its parent, before it is known
EACH_RANGE = (30.0, 200.0)  # likewise, at least and at most
NEARLY = 0.85  # of the faces that there may be, which are enough
ROUNDS = 6  # of choosing what is joined
COARSEST = 16.0  # times fewer rings of plain tubes, at most
SHORT_ROUNDS = 4  # of leaving out what ends inside its parent: others then leave from there
AFLOAT_ROUNDS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class PlainChoice:
    """Which branches are plain tubes, which are left out, and how coarse twigs are."""

    plain: NDArray[np.bool_]  # (B,)
    gone: NDArray[np.bool_]  # (B,)
    twigs: TwigSettings


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedBranches:
    """A skeleton, and its surface."""

    skeleton: Skeleton
    cage: BranchCage
    number: NDArray[np.int32]  # (B,), of each branch that was given in the skeleton; -1 of one that is left out
    left_out: Mapping[DropReason, int]  # how many branches
    thickest_plain_m: float  # radius up to which branches are plain tubes; 0 where all are joined


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
    none = np.zeros(len(skeleton), bool)
    choice = PlainChoice(plain=none, gone=none, twigs=TwigSettings())
    if max_faces is None or len(skeleton) * FEWEST_JOINED <= max_faces:
        cage = build_with_twigs(skeleton, choice, settings)
    if max_faces is not None and (len(skeleton) * FEWEST_JOINED > max_faces or len(cage.faces) > max_faces):
        settings = replace(settings, lean=True)
        choice, cage = _fit_faces(skeleton, thickness_m, max_faces, settings)
    closed = _leave_out(skeleton, cage)
    lost = find_afloat(closed)
    if lost.any() and not choice.plain.all():  # as plain tubes they begin on the axes of their parents
        plain = choice.plain | (np.append(lost, False)[closed.number] & (skeleton.parent_curve >= 0))
        for branch in np.flatnonzero(skeleton.parent_curve >= 0).tolist():  # parents first
            plain[branch] |= plain[skeleton.parent_curve[branch]]
        closed = _leave_out(skeleton, build_with_twigs(skeleton, replace(choice, plain=plain), settings))
    for _ in range(AFLOAT_ROUNDS):
        lost = find_afloat(closed)
        if not lost.any():
            break
        closed = _without(closed, lost)
    plain_m = float(thickness_m[choice.plain].max(initial=0))
    return replace(closed, thickest_plain_m=plain_m)


def _fit_faces(
    skeleton: Skeleton, thickness_m: NDArray[np.float64], max_faces: int, settings: BranchCageSettings
) -> tuple[PlainChoice, BranchCage]:
    """Join as many branches as the number of faces allows; the others are twigs.

    Faces are taken to be those of the twigs, so many for each branch that is joined, and what remains; the two numbers
    follow from what was built before.
    """
    costs = [count_twig_faces(skeleton, TwigSettings(coarser=coarser)) for coarser in _doubled(1.0, COARSEST)]
    each, rest = EACH_JOINED, 0.0
    built: list[tuple[int, float]] = []  # branches that were joined, faces without those of twigs
    best: tuple[PlainChoice, BranchCage] | None = None
    for _ in range(ROUNDS):
        choice = _choose_plain(skeleton, thickness_m, costs, max_faces, each, rest)
        cage = build_with_twigs(skeleton, choice, settings)
        faces = len(cage.faces)
        if faces <= max_faces and (best is None or faces > len(best[1].faces)):
            best = choice, cage
        joined = int((~choice.plain & ~choice.gone).sum())
        if faces <= max_faces and (faces >= NEARLY * max_faces or joined == len(skeleton)):
            break
        of_twigs = costs[_doubled(1.0, COARSEST).index(choice.twigs.coarser)][choice.plain].sum()
        built.append((joined, float(faces - of_twigs)))
        if len(built) > 1 and built[-1][0] != built[-2][0]:
            slope = (built[-1][1] - built[-2][1]) / (built[-1][0] - built[-2][0])
            each = float(np.clip(slope, *EACH_RANGE))
        # A little more than was found: the same choice again would be no use.
        rest = built[-1][1] - each * joined + (0.01 * max_faces if faces > max_faces else 0.0)
    return best if best is not None else (choice, cage)


def build_with_twigs(
    skeleton: Skeleton, choice: PlainChoice, settings: BranchCageSettings = BranchCageSettings()
) -> BranchCage:
    """The cage of the branches that are joined, and twigs drawn out of it; those left out are named in dropped."""
    chosen = ~choice.plain & ~choice.gone
    thick = np.flatnonzero(chosen)
    number = np.cumsum(chosen) - 1
    marks = mark_twigs(skeleton, choice.plain)
    on_thick = chosen[marks.branch]
    marks = RingMarks(branch=number[marks.branch[on_thick]], arc_m=marks.arc_m[on_thick])
    cage = build_branch_cage(skeleton.only(chosen), settings, marks)
    reasons = {int(thick[each.curve]): each.reason for each in cage.dropped}
    reasons |= dict.fromkeys(np.flatnonzero(choice.gone).tolist(), DropReason.TOO_MANY)
    cage = replace(
        cage,
        curve=thick[cage.curve].astype(np.int32),
        fork_curve=thick[cage.fork_curve].astype(np.int32),
        loose=tuple(thick[list(cage.loose)].tolist()) if cage.loose else (),
        order=skeleton.order[thick[cage.curve]].astype(np.int32),
    )
    if not choice.plain.any():
        return replace(cage, dropped=_sorted(reasons))
    for last in (False,) * (SHORT_ROUNDS - 1) + (True,):
        stays = np.ones(len(skeleton), bool)
        stays[list(reasons)] = False
        pruned = prune_branches(skeleton, stays)
        kept = np.flatnonzero(stays)
        short = kept[choice.plain[kept] & ~stand_out(pruned.skeleton)]
        if last or not len(short):
            break
        reasons |= dict.fromkeys(short.tolist(), DropReason.TOO_SHORT)
    back = replace(cage, curve=pruned.number[cage.curve], fork_curve=pruned.number[cage.fork_curve], loose=())
    drawn = draw_twigs(pruned.skeleton, choice.plain[kept], back, choice.twigs)
    # As the skeleton that was given has them: a branch begins at its own first point.
    st_m, owner = drawn.st_m.copy(), np.zeros(len(drawn.st_m), np.int64)
    owner[drawn.face_st[len(cage.faces) :]] = drawn.curve[len(cage.faces) :, None]
    of_twigs = np.arange(len(st_m)) >= len(cage.st_m)
    st_m[of_twigs, 1] -= pruned.prefix_m[owner[of_twigs]]
    return replace(
        drawn,
        st_m=st_m,
        curve=kept[drawn.curve].astype(np.int32),
        order=skeleton.order[kept[drawn.curve]].astype(np.int32),
        fork_curve=kept[drawn.fork_curve].astype(np.int32),
        loose=tuple(sorted({*cage.loose, *kept[list(drawn.loose)].tolist()} if drawn.loose else cage.loose)),
        dropped=_sorted(reasons),
    )


def find_afloat(closed: ClosedBranches, nearest_m: float = 0.0) -> NDArray[np.bool_]:
    """(B,) branches whose piece of the surface neither has a root nor runs into another piece."""
    skeleton, cage = closed.skeleton, closed.cage
    lost = np.zeros(len(skeleton), bool)
    if not len(cage.faces):
        return lost
    none = np.zeros(0, np.int32)
    limit = refine_catmull_clark(
        cage.points_m,
        np.full(len(cage.faces), 4, np.int32),
        cage.faces.astype(np.int32).ravel(),
        crease_edges=none.reshape(0, 2),
        crease_sharpness=none.astype(np.float32),
        corner_vertices=none,
        corner_sharpness=none.astype(np.float32),
        levels=1,
        limit=True,
    )
    faces = limit.faces.reshape(-1, 4)
    pieces = find_pieces(limit.points, faces, skeleton.points_m[skeleton.first[skeleton.parent_curve < 0]])
    afloat = np.zeros(len(pieces.gap_m), bool)
    afloat[pieces.afloat(nearest_m)] = True
    lost[np.repeat(cage.curve, 4)[afloat[pieces.of_point[faces[:, 0]]]]] = True
    return lost


def _leave_out(skeleton: Skeleton, cage: BranchCage) -> ClosedBranches:
    """Leave out of the skeleton what the cage lacks."""
    left_out = Counter(each.reason for each in cage.dropped)
    stays = np.ones(len(skeleton), bool)
    stays[[each.curve for each in cage.dropped]] = False
    if not stays.any():
        return ClosedBranches(
            skeleton=skeleton,
            cage=cage,
            number=np.arange(len(skeleton), dtype=np.int32),
            left_out=left_out,
            thickest_plain_m=0,
        )
    pruned = prune_branches(skeleton, stays)
    curve = pruned.number[cage.curve]
    owner = np.zeros(len(cage.st_m), np.int64)
    owner[cage.face_st] = curve[:, None]
    st_m = cage.st_m.copy()
    st_m[:, 1] += pruned.prefix_m[owner]
    return ClosedBranches(
        skeleton=pruned.skeleton,
        cage=replace(
            cage,
            st_m=st_m,
            curve=curve,
            order=pruned.skeleton.order[curve],
            fork_curve=pruned.number[cage.fork_curve],
            dropped=(),
            loose=tuple(pruned.number[list(cage.loose)].tolist()) if cage.loose else (),
        ),
        number=pruned.number,
        left_out=left_out,
        thickest_plain_m=0,
    )


def _without(closed: ClosedBranches, lost: NDArray[np.bool_]) -> ClosedBranches:
    """Leave out branches with their faces and all that they carry."""
    skeleton, cage = closed.skeleton, closed.cage
    gone = lost.copy()
    for branch in np.flatnonzero(skeleton.parent_curve >= 0).tolist():  # parents first
        gone[branch] |= gone[skeleton.parent_curve[branch]]
    if gone.all():
        return closed
    # A piece goes as a whole, or it would be open.
    number = np.where(gone, -1, np.cumsum(~gone) - 1).astype(np.int32)
    stays = ~gone[cage.curve]
    pieces = find_pieces(cage.points_m, cage.faces, np.zeros((0, 3)), np.inf)
    torn = np.zeros(len(pieces.gap_m), bool)
    torn[pieces.of_point[cage.faces[~stays, 0]]] = True
    cut = stays & torn[pieces.of_point[cage.faces[:, 0]]]
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
        cage=_only_faces(
            replace(
                cage,
                faces=cage.faces[stays],
                face_st=cage.face_st[stays],
                curve=number[cage.curve[stays]],
                order=cage.order[stays],
                fork_faces=face_number[cage.fork_faces[forks[of_fork]]].astype(np.int32),
                fork_counts=cage.fork_counts[forks],
                fork_curve=number[cage.fork_curve[forks]],
                loose=tuple(int(number[each]) for each in cage.loose if not gone[each]),
            )
        ),
        number=known,
        left_out=Counter(closed.left_out) + Counter({DropReason.AFLOAT: int(gone.sum())}),
    )


def _only_faces(cage: BranchCage) -> BranchCage:
    """The points, rings and texture coordinates that faces use."""
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


def thickest_above(skeleton: Skeleton) -> NDArray[np.float64]:
    """(B,) the greatest radius of a branch and of all that it carries."""
    thickest_m = np.maximum.reduceat(skeleton.radius_m, skeleton.first)
    tree = RootedTree(skeleton.parent_curve)
    for level in reversed(tree.levels[1:]):
        np.maximum.at(thickest_m, skeleton.parent_curve[level], thickest_m[level])
    return np.asarray(thickest_m)


def _choose_plain(
    skeleton: Skeleton,
    thickness_m: NDArray[np.float64],
    costs: list[NDArray[np.int64]],
    max_faces: int,
    each: float,
    rest: float,
) -> PlainChoice:
    """As few twigs as the number of faces allows, the thinnest branches first; then coarser ones; at last the thinnest
    tips are left out.

    Args:
        skeleton: B branches.
        thickness_m: (B,), of each branch with all that it carries.
        costs: Faces (B,) of each as a twig, finer and coarser.
        max_faces: That there may be.
        each: Faces of a branch that is joined.
        rest: Faces beside these.
    """
    count = len(skeleton)
    none = np.zeros(count, bool)
    rooted = skeleton.parent_curve < 0
    order = np.argsort(np.where(rooted, np.inf, thickness_m), kind="stable")
    may = int(count - rooted.sum())
    levels = _doubled(1.0, COARSEST)
    for coarser, faces in zip(levels, costs, strict=True):
        joined = count - np.arange(may + 1)
        total = np.concatenate([[0], np.cumsum(faces[order[:may]])]) + each * joined + rest
        enough = np.flatnonzero(total <= max_faces)
        if len(enough):
            # Of branches of one thickness all are twigs, so that what a twig carries is one.
            thinnest_m = thickness_m[order[enough[0] - 1]] if enough[0] else -1.0
            plain = ~rooted & (thickness_m <= thinnest_m)
            return PlainChoice(plain=plain, gone=none, twigs=TwigSettings(coarser=coarser))
    plain = ~rooted
    room = max(max_faces - each * rooted.sum() - rest, 0)
    thickest_first = order[:may][::-1]
    gone = none.copy()
    gone[thickest_first[np.cumsum(costs[-1][thickest_first]) > room]] = True
    for branch in np.flatnonzero(~rooted).tolist():  # parents first: of one thickness a parent may be gone
        gone[branch] |= gone[skeleton.parent_curve[branch]]
    return PlainChoice(plain=plain & ~gone, gone=gone, twigs=TwigSettings(coarser=COARSEST))


def _doubled(first: float, last: float) -> list[float]:
    values = [first]
    while values[-1] < last:
        values.append(2 * values[-1])
    return values


def _sorted(reasons: Mapping[int, DropReason]) -> tuple[DroppedBranch, ...]:
    return tuple(DroppedBranch(curve=curve, reason=reasons[curve]) for curve in sorted(reasons))
