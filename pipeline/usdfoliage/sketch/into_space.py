"""Traced branches out of the plane of the picture.

M. Okabe et al., Interactive design of botanical trees using freehand sketches, 2005, as P. Tan et al., 2008, section
3.1, take it: seen orthographically, each branch is turned towards the viewer or away by the angle at which it keeps
farthest from the others, one after the other.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.lines import arc_lengths
from usdfoliage.sketch.axes import Axis, sample_axis
from usdfoliage.sketch.bounds import CrownBounds
from usdfoliage.sketch.tracing import TracedTree

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class TurningSettings:
    """How branches are turned."""

    steepest_deg: float = 60.0  # out of the picture's plane
    angles: int = 13
    outside: float = 4.0  # weight of a point that would be outside of the crown
    step: float = 0.02  # of the tree's height, between points that are compared

    def __post_init__(self) -> None:
        if not (0 <= self.steepest_deg < 85 and self.angles >= 1 and self.step > 0):
            raise ValueError(f"steepest_deg must be 0 to below 85, angles 1 or more, step above 0, not {self}")


def turn_into_space(tree: TracedTree, bounds: CrownBounds, settings: TurningSettings = TurningSettings()) -> list[Axis]:
    """The axes of traced branches in the frame of the picture, trunks in its plane.

    Args:
        tree: Branches in pixels of the photograph.
        bounds: Where they may be.
        settings: How.
    """
    height = max(float(np.ptp(np.concatenate([each.points_px for each in tree.branches])[:, 1])), 1.0)
    step = settings.step * height
    slopes = np.tan(np.radians(np.linspace(-settings.steepest_deg, settings.steepest_deg, settings.angles)))
    axes: list[Axis] = []
    samples: list[Floats] = []
    for branch in tree.branches:
        flat = branch.points_px * [1, -1]
        along = arc_lengths(flat)
        parent = axes[branch.parent] if branch.parent >= 0 else None
        base_z = 0.0 if parent is None else float(parent.points[branch.parent_point, 2])
        best = np.column_stack([flat, np.full(len(flat), base_z)])
        if parent is not None and samples:
            others = np.concatenate(samples)
            scores = []
            turned = []
            for slope in slopes:
                points = np.column_stack([flat, base_z + slope * along])
                mine = sample_axis(points, step)
                far = mine[len(mine) // 4 :]  # where it begins all angles are the same
                near = np.linalg.norm(others[:, None] - far, axis=2).min(axis=0)
                outside = ~bounds.contains(far) & (np.abs(far[:, 2]) > np.abs(base_z))
                scores.append(float(near.mean() - settings.outside * step * outside.mean() * len(far)))
                turned.append(points)
            best = turned[int(np.argmax(scores))]
        axis = Axis(
            points=best,
            half=branch.half_px,
            parent=branch.parent,
            parent_point=branch.parent_point,
            order=0 if parent is None else parent.order + 1,
            inferred=False,
        )
        if parent is not None:
            axis.points[0] = parent.points[branch.parent_point]
        axes.append(axis)
        samples.append(sample_axis(axis.points, step))
    return axes
