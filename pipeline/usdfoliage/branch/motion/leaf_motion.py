"""Where leaves on twigs are while their branches grow or sway.

A leaf stands at a place on the axis of its branch, on the bark. In growth it goes with that place as the surface does,
and unfolds once the place is there; in a sway it follows the joints as the surface does there. Our own arrangement.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.branch.axis_places import Places
from usdfoliage.branch.motion.growth_stages import GrownSurface, GrowthStages, grow_surface
from usdfoliage.branch.motion.rig import Rig, Skin
from usdfoliage.branch.motion.skinning import skin_points

UNBORN = 1e-4  # of its length, that a leaf has which is not there yet: a scale is above 0

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class UnfoldSettings:
    """How leaves come."""

    share: float = 0.15  # of the time, that a leaf takes to unfold; what comes late takes what is left

    def __post_init__(self) -> None:
        if not 0 < self.share <= 1:
            raise ValueError(f"share must be above 0 and at most 1, not {self.share:g}")


def unfold_leaves(
    stages: GrowthStages, stage: int, places: Places, settings: UnfoldSettings = UnfoldSettings()
) -> Array:
    """(N,) length of leaves at places (N,) over that at last: UNBORN before their place is there, 1 at last."""
    path_m = stages.times.base_m[places.curve] + places.arc_m
    born = stages.times.born(places.curve, path_m)
    share = np.clip((stages.at[stage] - born) / np.minimum(settings.share, 1 - born), 0, 1)
    return np.asarray(np.maximum(share * share * (3 - 2 * share), UNBORN))


def carry_leaves(
    stages: GrowthStages, stage: int, leaves: GrownSurface, settings: UnfoldSettings = UnfoldSettings()
) -> tuple[Array, Array]:
    """Bases (N, 3) of leaves, and their lengths (N,) over those at last, at one time.

    Args:
        stages: Of the branches.
        stage: Which time.
        leaves: Their bases at last as the points of a surface, with the emerges_m of that of the branches.
        settings: How they come.
    """
    return grow_surface(stages, stage, leaves), unfold_leaves(stages, stage, leaves.places, settings)


def sway_leaves(rig: Rig, skin: Skin, base_m: Array, orientation: Array, posed: Array) -> tuple[Array, Array]:
    """Bases (N, 3) and orientations (N, 4) of leaves once the joints are posed (J, 4, 4).

    Bases go with the surface. A leaf keeps its shape, so between joints it turns by their weighted mean.

    Args:
        rig: Of the branches.
        skin: How the leaves' places follow it.
        base_m: (N, 3), at rest.
        orientation: (N, 4), unit quaternions (x, y, z, w), at rest.
        posed: As usdfoliage.branch.motion.skinning.pose_joints gives it.
    """
    turned = Rotation.from_matrix((posed @ np.linalg.inv(rig.bind))[:, :3, :3]).as_quat(canonical=True)
    first = turned[skin.joints[:, 0]]
    mean = np.zeros_like(first)
    for joints, weights in zip(skin.joints.T, skin.weights.T, strict=True):
        other = turned[joints]
        same_side = np.where(np.sum(other * first, axis=1) < 0, -1.0, 1.0)  # q and -q are one rotation
        mean += (weights * same_side)[:, None] * other
    base_m = skin_points(rig, skin, base_m, posed)
    if not len(mean):
        return base_m, orientation
    return base_m, np.asarray((Rotation.from_quat(mean) * Rotation.from_quat(orientation)).as_quat())
