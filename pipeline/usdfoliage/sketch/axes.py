"""Axes of branches in the frame of the picture, while a tree grows."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from usdfoliage.branch.model import Skeleton

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """One branch: x to the right, y up, z towards the viewer, in pixels."""

    points: Floats  # (K, 3), from its parent or the root on
    half: Floats  # (K,) radius in pixels; NaN where it is not seen
    parent: int  # -1 of a trunk
    parent_point: int  # of the parent, -1 of a trunk
    order: int
    inferred: bool  # nothing of it is in the picture

    @cached_property
    def length(self) -> float:
        """In pixels, along the axis."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


def sample_axis(points: Floats, step: float) -> Floats:
    """(N, 3) points along an axis, about so far apart, without its first one."""
    parts = []
    for one, two in pairwise(points):
        count = max(1, int(np.ceil(np.linalg.norm(two - one) / step)))
        share = (np.arange(count) + 1) / count
        parts.append(one + share[:, None] * (two - one))
    return np.concatenate(parts)


def skeleton_of(axes: Sequence[Axis], radius: Sequence[Floats], scale_m: float, root: Floats) -> Skeleton:
    """Axes in metres, the root at the origin.

    Args:
        axes: Each after its parent.
        radius: (K,) of each, in pixels.
        scale_m: Metres of a pixel.
        root: (3,), in the frame of the picture.
    """
    counts = np.array([len(axis.points) for axis in axes], np.int32)
    first = np.cumsum(counts) - counts
    parent = np.array([axis.parent for axis in axes], np.int32)
    leaves_from = np.array(
        [-1 if axis.parent < 0 else first[axis.parent] + axis.parent_point for axis in axes], np.int32
    )
    return Skeleton(
        points_m=(np.concatenate([axis.points for axis in axes]) - root) * scale_m,
        radius_m=np.concatenate(radius) * scale_m,
        counts=counts,
        parent_curve=parent,
        parent_vertex=leaves_from,
        order=np.array([axis.order for axis in axes], np.int32),
        inferred=np.array([axis.inferred for axis in axes], bool),
    )
