"""The surface of a plant's branches in one piece, within a number of faces, and the skeleton that it belongs to.

What cannot be in the surface is not in the skeleton: a branch that ends inside its parent, or that nothing joins to
it. The thicker branches are joined, the thinnest are twigs where all together would have too many faces. The method
is our own.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.axis_places import Exits, axis_exits
from usdfoliage.branch.cage.astray import beside_lost, find_afloat, find_astray
from usdfoliage.branch.cage.fit_faces import JOINED_FACES, fit_faces, joined_faces, thickest_above
from usdfoliage.branch.cage.leave_out import ClosedBranches, leave_lost, leave_out, with_carried
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.twig_choice import TwigChoice
from usdfoliage.branch.cage.twigs import TwigSettings
from usdfoliage.branch.cage.with_twigs import build_with_twigs
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree

MANY = 10  # branches that one carries, with itself, from which on it is not made a twig for the want of a fork
ASTRAY_ROUNDS = 3  # of drawing otherwise what is bare, for others come to lie elsewhere then
AFLOAT_ROUNDS = 3
LOST_ROUNDS = 3  # of both: what was left out may have covered others
BUDGET_ROUNDS = 2  # of joining less, where what was drawn otherwise has more faces than there may be
UNSURE_M = 0.05  # of those that are drawn otherwise where it is not


def close_branches(
    skeleton: Skeleton, settings: BranchCageSettings = BranchCageSettings(), max_faces: int | None = None
) -> ClosedBranches:
    """Build the surface of branches, and leave out of the skeleton what is not in it.

    Args:
        skeleton: B branches; metres.
        settings: How close the surface keeps to it.
        max_faces: As many as the surface may have; as many as it takes where it is not given.
    """
    exits = axis_exits(skeleton)
    closed = _close(skeleton, settings, max_faces, exits)
    for _ in range(BUDGET_ROUNDS):
        excess = 0 if max_faces is None else len(closed.cage.faces) - max_faces
        if max_faces is None or excess <= 0:
            break
        closed = _close(skeleton, settings, max(max_faces - excess, 1), exits)
    return closed


def _close(skeleton: Skeleton, settings: BranchCageSettings, max_faces: int | None, exits: Exits) -> ClosedBranches:
    """A surface that has no more faces before what is astray is drawn otherwise."""
    thickness_m = thickest_above(skeleton)
    none = np.zeros(len(skeleton), bool)
    choice = TwigChoice(is_twig=none, gone=none, twig_settings=TwigSettings())
    fits = max_faces is None or joined_faces(skeleton, JOINED_FACES).sum() <= max_faces
    if fits:
        cage = build_with_twigs(skeleton, choice, settings, exits)
        fits = max_faces is None or len(cage.faces) <= max_faces
        choice = replace(choice, tried=cage.tries)
    if not fits and max_faces is not None:
        settings = replace(settings, lean=True)
        choice, cage = fit_faces(skeleton, thickness_m, max_faces, settings, exits, choice.tried)
    twig_m = float(thickness_m[choice.is_twig].max(initial=0))
    closed = leave_out(skeleton, cage, choice, settings)
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
            is_twig = with_carried(skeleton, choice.is_twig | (again & (apart | ~carries)))
            apart = apart | again
            choice = replace(choice, is_twig=is_twig & ~choice.gone, apart=apart & ~is_twig)
            closed, choice = _draw(skeleton, choice, settings, exits)
            astray = find_astray(closed, late=False)
        afloat = find_afloat(closed, thin_m=UNSURE_M)
        again = np.append(afloat & (closed.skeleton.parent_curve >= 0), False)[closed.number] & ~choice.is_twig
        if again.any():
            is_twig = with_carried(skeleton, choice.is_twig | again)
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
        left_out = with_carried(skeleton, left_out)  # what was left out before it as well
        choice = replace(choice, is_twig=choice.is_twig & ~left_out, gone=choice.gone | left_out, afloat=left_out)
    return closed


def _draw(
    skeleton: Skeleton, choice: TwigChoice, settings: BranchCageSettings, exits: Exits
) -> tuple[ClosedBranches, TwigChoice]:
    """The surface of a choice, and the choice with what it showed of the forks."""
    cage = build_with_twigs(skeleton, choice, settings, exits)
    return leave_out(skeleton, cage, choice, settings), replace(choice, tried=cage.tries)


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
        closed = leave_lost(before, lost)
        if closed is before:
            break
        lost = find_afloat(closed, beside_lost(before, closed))
    return closed
