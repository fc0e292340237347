"""A leaf of several lobes: silhouette, skeleton and railroad ties, from its mask.

Source:
    L. Mündermann et al., Modeling lobed leaves, section 3.
"""

from dataclasses import dataclass, field, replace

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
from usdfoliage.leaf.lobed.veins import VeinPaths, VeinSettings, find_paths, find_vein_ends, follow_veins

Floats = NDArray[np.float64]

_SMOOTHER = (0.5, 2.0)  # than the medial axis: skeletons along veins are tried in this order
_STEP_PX = 1.5  # between samples of the silhouette, of which the medial axis is found


@dataclass(frozen=True, kw_only=True)
class LobedLeafSettings:
    """How a lobed leaf is made."""

    silhouette: SilhouetteSettings = field(default_factory=SilhouetteSettings)
    axis: MedialAxisSettings = field(default_factory=MedialAxisSettings)
    skeleton: SkeletonSettings = field(default_factory=SkeletonSettings)
    ties: TieSettings = field(default_factory=TieSettings)
    veins: VeinSettings = field(default_factory=VeinSettings)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatLobedLeaf:
    """A lobed leaf as it lay in its picture: pixels, x to the right and y up, from the upper left corner."""

    silhouette: Silhouette
    limbs: LimbTree
    ties: Ties
    on_veins: bool = False  # whether its skeleton goes along veins

    @property
    def lobes(self) -> int:
        """How many tips the skeleton has, but for the base."""
        ends = np.bincount([node for limb in self.limbs.limbs for node in (limb.begin, limb.end)])
        return int((ends == 1).sum()) - 1


def model_lobed_leaf(
    mask: NDArray[np.bool_],
    settings: LobedLeafSettings = LobedLeafSettings(),
    *,
    base_px: Floats | None = None,
    veins: NDArray[np.float32] | None = None,
) -> FlatLobedLeaf:
    """The silhouette, the skeleton and the ties of the largest piece of a mask (H, W).

    With veins the skeleton goes along them, and is made smoother where ties would fold the surface; it is the medial
    axis again if they fold it still.

    Args:
        mask: (H, W), of the leaf.
        settings: How.
        base_px: (2,), where the leaf begins, pixels with y up; None to look for the end of a petiole.
        veins: (H, W), how clearly each pixel is on a vein, 0 to 1; None for the medial axis.

    Raises:
        ValueError: The mask shows no leaf, or one that has no axis.
    """
    silhouette = fit_silhouette(follow_boundary(mask), settings.silhouette)
    outline = silhouette.sample(_STEP_PX)
    base = find_petiole_end(outline) if base_px is None else base_px
    if base is None:
        base = outline[np.argmin(outline[:, 1])]
    axis = find_medial_axis(outline, base, settings.axis)
    limbs = build_limbs(axis, outline, base, settings.skeleton)
    if veins is not None:
        leaf = _along_veins(silhouette, outline, limbs, mask, veins, settings)
        if leaf is not None:
            return leaf
    return FlatLobedLeaf(silhouette=silhouette, limbs=limbs, ties=lay_ties(limbs, outline, settings.ties))


def _along_veins(
    silhouette: Silhouette,
    outline: Floats,
    limbs: LimbTree,
    mask: NDArray[np.bool_],
    veins: NDArray[np.float32],
    settings: LobedLeafSettings,
) -> FlatLobedLeaf | None:
    """The leaf with a skeleton along its veins; None where each one tears the surface.

    Veins go to the tips that the medial axis has, one to each lobe. A skeleton that folds ties is made smoother first,
    and follows the veins less then. Where it folds them still, the tips of the limbs that do so are left out; if that
    does not help, the ends of the clearest veins are tips instead.
    """
    tips = [node for node in range(len(limbs.nodes)) if len(limbs.limbs_of(node)) == 1 and node != limbs.base]
    base = limbs.nodes[limbs.base]
    paths = find_paths(veins, mask, base, settings.veins)
    for ends in (limbs.nodes[tips], find_vein_ends(paths, outline, settings.veins)):
        leaf = _without_folds(silhouette, outline, base, paths, ends, settings)
        if leaf is not None:
            return leaf
    return None


def _without_folds(
    silhouette: Silhouette, outline: Floats, base: Floats, paths: VeinPaths, ends: Floats, settings: LobedLeafSettings
) -> FlatLobedLeaf | None:
    """The leaf with paths along veins to as many of the ends (N, 2) as do not fold its ties; None for too few."""
    # Other ends are tried rather than leaning ties, which take as long again.
    fewest = max(1, (len(ends) + 1) // 2)
    while len(ends) >= fewest:
        axis = follow_veins(paths, ends, settings.veins)
        torn = ends[:0]
        for smoother in _SMOOTHER:
            skeleton = replace(settings.skeleton, smooth=settings.skeleton.smooth * smoother)
            try:
                along = build_limbs(axis, outline, base, skeleton)
                ties = lay_ties(along, outline, replace(settings.ties, leans=()))
            except ValueError:
                continue
            folded = ties.node[ties.areas() <= 0]
            if not len(folded):
                return FlatLobedLeaf(silhouette=silhouette, limbs=along, ties=ties, on_veins=True)
            torn = _tips_of(along, ties, folded)
        kept = np.ones(len(ends), bool)
        for tip in torn:
            kept[np.argmin(((ends - tip) ** 2).sum(axis=1))] = False
        if kept.all():
            return None
        ends = ends[kept]
    return None


def _tips_of(limbs: LimbTree, ties: Ties, nodes: NDArray[np.int64]) -> Floats:
    """(N, 2) the tips, but for the base, of the limbs on which some nodes of ties lie."""
    tips = []
    for limb, inner in zip(limbs.limbs, ties.limb_nodes, strict=True):
        ends = [node for node in (limb.begin, limb.end) if node != limbs.base and len(limbs.limbs_of(node)) == 1]
        if ends and np.isin(nodes, inner).any():
            tips.append(limbs.nodes[ends[0]])
    return np.array(tips).reshape(-1, 2)
