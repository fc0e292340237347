"""Spurs: what was traced as a branch, but never leaves the stem that it springs from."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

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
    carried: list[list[int]] = [[] for _ in range(len(skeleton))]
    for branch, parent in enumerate(skeleton.parent_curve.tolist()):
        if parent >= 0:
            carried[parent].append(branch)
    for branch, parent in enumerate(skeleton.parent_curve.tolist()):
        if parent < 0:
            continue
        spur[branch] = spur[parent]
        waiting = [] if spur[branch] else [branch]
        spur[branch] |= bool(waiting)
        stem = skeleton.branch(parent)
        stem_m, reach_m = skeleton.points_m[stem], skeleton.radius_m[stem] + beyond_m[stem]
        while waiting:
            one = waiting.pop()
            if _comes_out(skeleton.points_m[skeleton.branch(one)], stem_m, reach_m):
                spur[branch] = False
                break
            waiting.extend(carried[one])
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


def _comes_out(points_m: NDArray[np.float64], stem_m: NDArray[np.float64], reach_m: NDArray[np.float64]) -> bool:
    """Whether any of the points (K, 3) is farther than reach_m (M,) from a stem's axis (M, 3)."""
    along_m = np.diff(stem_m, axis=0)
    square = np.maximum(np.einsum("mc,mc->m", along_m, along_m), 1e-24)
    from_start = points_m[:, None] - stem_m[:-1]
    share = np.clip(np.einsum("kmc,mc->km", from_start, along_m) / square, 0, 1)
    away_m = np.linalg.norm(from_start - share[:, :, None] * along_m, axis=2)
    out = away_m > (1 - share) * reach_m[:-1] + share * reach_m[1:]
    return bool(out.all(axis=1).any())
