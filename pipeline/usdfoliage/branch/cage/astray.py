"""What of a surface does not belong: pieces that are afloat, and joined branches whose axes lie beside it."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.cage.leave_out import ClosedBranches
from usdfoliage.branch.whole_wood import AFLOAT_M, bare_lengths
from usdfoliage.geometry.mesh_pieces import label_pieces, measure_gaps
from usdfoliage.geometry.smooth_mesh import refine_smooth
from usdfoliage.geometry.used_points import find_used

AFLOAT_LEVELS = (1, 2)  # of division, at which pieces are looked at: as reports and validation do, and finer
TOUCH_M = 0.5 * AFLOAT_M  # between points of thin branches and what they run into
THIN_M = 0.015  # radius of branches that may be lost where it is not sure that they touch
ASTRAY = 1.0  # radii of an axis without surface, from which on a branch is drawn otherwise
ASTRAY_EDGES = 0.5  # edges of the surface, once refined, that such an axis may be away from it
BARE_SHARE = 0.0005  # of the length of all axes, that may be without surface: half of what anybody allows
MARGIN = 0.3  # of that, which is left where there is more: others become bare by what is changed


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
    used, corners = find_used(cage.faces[near], len(cage.points_m))
    thickest_m = np.zeros(count)
    np.maximum.at(thickest_m, of_face, np.maximum.reduceat(skeleton.radius_m, skeleton.first)[cage.curve])
    thin = asked[thickest_m[asked] < thin_m]
    afloat = np.zeros(count, bool)
    for levels in AFLOAT_LEVELS:
        points_m, faces = refine_smooth(cage.points_m[used], corners, levels)
        piece = np.zeros(len(points_m), np.int32)
        piece[faces] = np.repeat(of_face[near], 4**levels)[:, None]
        afloat[asked[measure_gaps(points_m, faces, piece, asked) > 0]] = True
    # At the finest.
    afloat[thin[measure_gaps(points_m, faces, piece, thin, TOUCH_M, through=False) > TOUCH_M]] = True
    lost[cage.curve[afloat[of_face]]] = True
    return lost


def beside_lost(before: ClosedBranches, after: ClosedBranches) -> NDArray[np.bool_]:
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
    used, corners = find_used(cage.faces[joined[cage.curve]], len(cage.points_m))
    points_m, faces = refine_smooth(cage.points_m[used], corners, 1)
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
