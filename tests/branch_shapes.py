"""Skeletons whose every number is known."""

import numpy as np
from usdfoliage.branch.model import Skeleton


def fork(angle_deg: float = 90.0, radius_m: float = 0.05, child_m: float = 0.03) -> Skeleton:
    """A trunk of 2 m, a branch of 1 m from its middle at an angle from it, a twig from the branch's tip at 45 degrees."""
    turn = np.radians(angle_deg)
    tip = np.array([np.sin(turn), 1 + np.cos(turn), 0])
    return Skeleton(
        points_m=np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0], [0, 1, 0], tip, tip, tip + [0.5, 0, 0.5]], float),
        radius_m=np.array([radius_m] * 3 + [child_m] * 2 + [child_m / 2] * 2),
        counts=np.array([3, 2, 2], np.int32),
        parent_curve=np.array([-1, 0, 1], np.int32),
        parent_vertex=np.array([-1, 1, 4], np.int32),
        order=np.array([0, 1, 2], np.int32),
    )
