"""Which branches are joined and which are twigs, so that all have no more than a number of faces."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.axis_places import Exits
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.cage.leave_out import with_carried
from usdfoliage.branch.cage.settings import BranchCageSettings
from usdfoliage.branch.cage.twig_choice import TwigChoice
from usdfoliage.branch.cage.twigs import SIDES, TwigSettings, count_rows
from usdfoliage.branch.cage.with_twigs import build_with_twigs
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree

JOINED_FACES = 36.0, 4.0  # of a branch, with those on its parent: at its fork, and times the rows that it asks for
LEAN_FACES = 32.0, 3.0  # of a lean one
SURELY = 1.05  # times the faces that are too many, those of the tips that are left out
LIMBS = 0.15, 0.3, 0.5  # of the greatest radius: a thicker branch is a limb
ROUNDS = 3  # of choosing what is left out
COARSER = (1.0, 1.5, 2.0, 3.0)  # times fewer rings of twigs


def fit_faces(
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
    for _ in range(ROUNDS):
        gone = _thinnest_tips(skeleton, thickness_m, choice.gone, cage, SURELY * (len(cage.faces) - max_faces))
        choice = replace(choice, is_twig=~rooted & ~gone, gone=gone)
        cage = build_with_twigs(skeleton, choice, settings, exits)
        if len(cage.faces) <= max_faces:
            break
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
    more = joined_faces(skeleton, LEAN_FACES) - np.bincount(fits[1].curve, minlength=len(skeleton))
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


def joined_faces(skeleton: Skeleton, faces: tuple[float, float]) -> NDArray[np.float64]:
    """(B,) about how many faces branches have that are joined: at each fork, and times the rows that each asks for."""
    return np.asarray(faces[0] + faces[1] * SIDES * count_rows(skeleton))


def _thinnest_tips(
    skeleton: Skeleton, thickness_m: NDArray[np.float64], gone: NDArray[np.bool_], cage: BranchCage, faces: float
) -> NDArray[np.bool_]:
    """(B,) branches that are left out: those gone already, and the thinnest others that have so many faces in a cage.

    Thicker ones are longer, and have more faces each.
    """
    order = np.argsort(np.where((skeleton.parent_curve < 0) | gone, np.inf, thickness_m), kind="stable")
    order = order[: int((~gone & (skeleton.parent_curve >= 0)).sum())]
    fewer = np.cumsum(np.bincount(cage.curve, minlength=len(skeleton))[order])
    left_out = gone.copy()
    left_out[order[: int(np.searchsorted(fewer, faces)) + 1]] = True
    return with_carried(skeleton, left_out)  # of one thickness a parent may be one


def thickest_above(skeleton: Skeleton) -> NDArray[np.float64]:
    """(B,) the greatest radius of a branch and of all that it carries."""
    thickest_m = np.maximum.reduceat(skeleton.radius_m, skeleton.first)
    tree = RootedTree(skeleton.parent_curve)
    for level in reversed(tree.levels[1:]):
        np.maximum.at(thickest_m, skeleton.parent_curve[level], thickest_m[level])
    return np.asarray(thickest_m)
