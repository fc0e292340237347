"""A leaf of several lobes: silhouette, skeleton and railroad ties, from its mask.

Source:
    L. Mündermann et al., Modeling lobed leaves, section 3.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.lobed.medial_axis import MedialAxisSettings, find_medial_axis
from usdfoliage.leaf.lobed.silhouette import (
    Silhouette,
    SilhouetteSettings,
    find_petiole_end,
    fit_silhouette,
    follow_boundary,
)
from usdfoliage.leaf.lobed.skeleton import LimbTree, SkeletonSettings, build_limbs
from usdfoliage.leaf.lobed.ties import Ties, TieSettings, lay_ties

_STEP_PX = 1.5  # between samples of the silhouette, of which the medial axis is found


@dataclass(frozen=True, kw_only=True)
class LobedLeafSettings:
    """How a lobed leaf is made."""

    silhouette: SilhouetteSettings = field(default_factory=SilhouetteSettings)
    axis: MedialAxisSettings = field(default_factory=MedialAxisSettings)
    skeleton: SkeletonSettings = field(default_factory=SkeletonSettings)
    ties: TieSettings = field(default_factory=TieSettings)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatLobedLeaf:
    """A lobed leaf as it lay in its picture: pixels, x to the right and y up, from the upper left corner."""

    silhouette: Silhouette
    limbs: LimbTree
    ties: Ties

    @property
    def lobes(self) -> int:
        """How many tips the skeleton has, but for the base."""
        ends = np.bincount([node for limb in self.limbs.limbs for node in (limb.begin, limb.end)])
        return int((ends == 1).sum()) - 1


def model_lobed_leaf(mask: NDArray[np.bool_], settings: LobedLeafSettings = LobedLeafSettings()) -> FlatLobedLeaf:
    """The silhouette, the skeleton and the ties of the largest piece of a mask (H, W).

    Raises:
        ValueError: The mask shows no leaf, or one that has no axis.
    """
    silhouette = fit_silhouette(follow_boundary(mask), settings.silhouette)
    outline = silhouette.sample(_STEP_PX)
    base = find_petiole_end(outline)
    if base is None:
        base = outline[np.argmin(outline[:, 1])]
    axis = find_medial_axis(outline, base, settings.axis)
    limbs = build_limbs(axis, outline, base, settings.skeleton)
    return FlatLobedLeaf(silhouette=silhouette, limbs=limbs, ties=lay_ties(limbs, outline, settings.ties))
