"""Where a rig takes a surface: linear blend skinning, as UsdSkel does it, for bounds and for tests."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.branch.motion.rig import Rig, Skin


def pose_joints(rig: Rig, turn_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """(J, 4, 4) asset from joint, for column vectors, once each has turned by a vector (J, 3) in its own frame."""
    local = rig.rest
    local[:, :3, :3] = local[:, :3, :3] @ Rotation.from_rotvec(turn_rad).as_matrix()
    posed = local.copy()
    for joint, parent in enumerate(rig.parent.tolist()):
        if parent >= 0:
            posed[joint] = posed[parent] @ local[joint]
    return posed


def skin_points(rig: Rig, skin: Skin, points_m: NDArray[np.float64], posed: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, 3) where points (P, 3) are once the joints are posed (J, 4, 4)."""
    moved = posed @ np.linalg.inv(rig.bind)
    where_m = np.zeros_like(points_m)
    for joints, weights in zip(skin.joints.T, skin.weights.T, strict=True):
        follows = np.flatnonzero(weights)  # most follow one joint alone
        to = moved[joints[follows]]
        turned_m = np.einsum("prc,pc->pr", to[:, :3, :3], points_m[follows]) + to[:, :3, 3]
        where_m[follows] += weights[follows, None] * turned_m
    return where_m
