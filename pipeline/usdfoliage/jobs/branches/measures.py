"""The branches of an asset, in numbers."""

from dataclasses import dataclass

import numpy as np

from usdfoliage.branch.model import Skeleton

BREAST_HEIGHT_M = 1.3  # above the root, where foresters measure a stem


@dataclass(frozen=True, kw_only=True)
class BranchInfo:
    """How many branches there are, and how large."""

    count: int
    by_order: tuple[int, ...]  # the trunks first
    height_m: float  # of the highest point above the lowest root
    length_m: float  # of all axes together
    root_diameter_m: float  # of the thickest trunk where it begins
    breast_height_diameter_m: float | None  # of that trunk; None where it does not reach so high


def measure_branches(skeleton: Skeleton) -> BranchInfo:
    """The numbers of a skeleton, which has a branch at least."""
    roots = np.flatnonzero(skeleton.parent_curve < 0)
    trunk = roots[np.argmax(skeleton.radius_m[skeleton.first[roots]])]
    vertices = slice(skeleton.first[trunk], skeleton.first[trunk] + skeleton.counts[trunk])
    points_m, radius_m = skeleton.points_m[vertices], skeleton.radius_m[vertices]
    above_m = points_m[:, 1] - points_m[0, 1]
    higher = np.flatnonzero(above_m >= BREAST_HEIGHT_M)
    breast = None
    if len(higher):
        after = int(higher[0])
        breast = 2 * float(np.interp(BREAST_HEIGHT_M, above_m[after - 1 : after + 1], radius_m[after - 1 : after + 1]))
    steps_m = np.linalg.norm(np.diff(skeleton.points_m, axis=0), axis=1)
    inside = np.ones(len(steps_m), bool)
    inside[skeleton.first[1:] - 1] = False  # from the tip of one branch to the beginning of the next
    low_m = float(skeleton.points_m[skeleton.first[roots], 1].min())
    return BranchInfo(
        count=len(skeleton),
        by_order=tuple(int(number) for number in np.bincount(skeleton.order)),
        height_m=float(skeleton.points_m[:, 1].max()) - low_m,
        length_m=float(steps_m[inside].sum()),
        root_diameter_m=2 * float(radius_m[0]),
        breast_height_diameter_m=breast,
    )


def branch_rows(branches: BranchInfo) -> list[tuple[str, str]]:
    """Rows of a table for people."""
    orders = ", ".join(f"{number:,} of order {order}" for order, number in enumerate(branches.by_order))
    trunk = f"root {100 * branches.root_diameter_m:.3g} cm"
    if branches.breast_height_diameter_m is not None:
        trunk += f", {100 * branches.breast_height_diameter_m:.3g} cm at {BREAST_HEIGHT_M:g} m"
    return [
        ("branches", f"{branches.count:,} ({orders})"),
        ("height", f"{branches.height_m:.4g} m"),
        ("axes", f"{branches.length_m:.4g} m together"),
        ("diameter", trunk),
    ]
