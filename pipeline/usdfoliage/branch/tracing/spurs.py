"""Spurs: what was traced as a branch, but never leaves the stem that it springs from."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.axis_places import beyond_surface
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.rooted_tree import RootedTree
from usdfoliage.branch.tracing.axes import Axes
from usdfoliage.branch.tracing.sections import SectionTree
from usdfoliage.geometry.point_cells import cell_means


def find_spurs(skeleton: Skeleton, beyond_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(B,) branches that with all they carry stay near their parent's surface, and those that such a one carries.

    Points all around a thick or sparsely seen stem fall apart into several slices, and what is cut off runs along the
    bark, or ends inside the stem when its nodes are drawn to the middle of it.

    Args:
        skeleton: Whose.
        beyond_m: (V,), how far from the surface of its parent, at each vertex of that, a branch must come somewhere.
    """
    spur = np.zeros(len(skeleton), bool)
    comes_out = _come_out(skeleton, beyond_m, skeleton.parent_curve)
    carried: list[list[int]] = [[] for _ in range(len(skeleton))]
    for branch, parent in enumerate(skeleton.parent_curve.tolist()):
        if parent >= 0:
            carried[parent].append(branch)
    for branch, parent in enumerate(skeleton.parent_curve.tolist()):
        if parent < 0:
            continue
        spur[branch] = spur[parent]
        if spur[branch] or comes_out[branch]:
            continue
        above = [branch]
        for one in above:  # which grows
            above.extend(carried[one])
        of = np.full(len(skeleton), -1, np.int32)
        of[above[1:]] = parent
        spur[branch] = len(above) == 1 or not _come_out(skeleton, beyond_m, of).any()
    return spur


def absorb_spurs(
    points_m: NDArray[np.float64], sections: SectionTree, axes: Axes, spur: NDArray[np.bool_]
) -> tuple[SectionTree, NDArray[np.bool_]]:
    """Sections whose points on spurs, and on all that they carry, are the stem's; and which were kept (S,).

    Args:
        points_m: (N, 3).
        sections: Of the points.
        axes: Through the sections.
        spur: (A,), and those that one carries.
    """
    taken_by = np.full(len(sections), -1, np.int64)  # the axis whose sections take the points of each one
    for lowest in np.flatnonzero(spur & ~spur[axes.parent]).tolist():
        taken_by[axes.axis(lowest)[1]] = axes.parent[lowest]
    for level in RootedTree(sections.parent).levels[1:]:
        carried = taken_by[level] < 0
        taken_by[level[carried]] = taken_by[sections.parent[level[carried]]]
    into = np.arange(len(sections))
    gone = np.flatnonzero(taken_by >= 0)
    gone = gone[np.argsort(taken_by[gone], kind="stable")]
    for run in np.split(gone, np.flatnonzero(np.diff(taken_by[gone])) + 1) if len(gone) else []:
        stem = axes.axis(int(taken_by[run[0]]))
        nearest = np.asarray(cKDTree(sections.center_m[stem]).query(sections.center_m[run])[1])
        into[run] = stem[nearest]
    kept = taken_by < 0
    number = np.cumsum(kept) - 1
    section = number[into[sections.section]]
    counts = np.bincount(section, minlength=int(kept.sum()))
    parent = sections.parent[kept]
    absorbed = SectionTree(
        center_m=cell_means(points_m, section),
        points=counts.astype(np.int32),
        parent=np.where(parent < 0, -1, number[parent]).astype(np.int32),
        section=section.astype(np.int32),
    )
    return absorbed, kept


def _come_out(skeleton: Skeleton, beyond_m: NDArray[np.float64], of: NDArray[np.integer]) -> NDArray[np.bool_]:
    """(B,) branches with a point that is farther than beyond_m (V,) from the surface of another (B,); none for -1."""
    out = np.zeros(len(skeleton), bool)
    mine = np.flatnonzero(of[skeleton.curve] >= 0)
    curve = skeleton.curve[mine]
    away_m = beyond_surface(skeleton, skeleton.points_m[mine], of[curve], skeleton.radius_m + beyond_m)
    out[curve[away_m > 0]] = True
    return out
