"""A whole asset of branches: their skeleton, their surface by order, and leaves on their twigs."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.materials.bark import BARK_COLOR, BarkMaterial
from usdfoliage.asset.materials.layer import write_materials_layer
from usdfoliage.asset.packages.leaf_package import (
    LeafAssetSettings,
    LeafLook,
    begin_asset,
    copy_map,
    finish_asset,
    leaf_jitter,
    write_leaf_layers,
)
from usdfoliage.asset.parts.branch_growth import BranchGrowth, write_growth_layer
from usdfoliage.asset.parts.branch_rig import BranchRig, write_rig_layer
from usdfoliage.asset.parts.branches import SkeletonPrim, write_branches_layer, write_skeleton_layer
from usdfoliage.asset.parts.leaf_motion import (
    GROWTH_LEAVES,
    RIG_LEAVES,
    DrawnLeaves,
    RiggedLeaves,
    write_leaf_growth_layer,
    write_leaf_rig_layer,
)
from usdfoliage.asset.plant import SKELETON, Plant, box_around
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.variants import VariantSet
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits

ALL_ORDERS = "all"  # variant of the set branches


@dataclass(frozen=True, kw_only=True)
class BranchAssetSettings:
    """How an asset of branches is written."""

    color: tuple[float, float, float] = BARK_COLOR  # linear Rec.709
    texture: Path | None = None  # picture of bark that repeats
    texture_m: float = 0.5  # width of what it shows
    version: str = "1"  # assetInfo


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchSurfaces:
    """The surface of all branches, and coarser ones, which have those up to an order alone."""

    whole: BranchCage
    by_order: Sequence[tuple[int, BranchCage]] = field(default_factory=tuple)


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchLeaves:
    """Leaves on the twigs, as usdfoliage.asset.packages.leaf_package.write_leaf_asset takes them."""

    leaves: Leaves
    settings: LeafAssetSettings = field(default_factory=LeafAssetSettings)
    edits: LeafEdits = NEUTRAL
    look: LeafLook = field(default_factory=LeafLook)


def write_branch_asset(
    folder: Path,
    name: str,
    skeleton: SkeletonPrim,
    surfaces: BranchSurfaces,
    provenance: Provenance,
    asset_from_capture: NDArray[np.float64],
    settings: BranchAssetSettings = BranchAssetSettings(),
    foliage: BranchLeaves | None = None,
    rig: BranchRig | None = None,
    growth: BranchGrowth | None = None,
    rigged_leaves: RiggedLeaves | None = None,
) -> Path:
    """Write an asset of branches, inside publish_folder as usdfoliage.asset.packages.leaf_package.write_crown_asset.

    Args:
        folder: An existing folder; the asset's files are written into it.
        name: Name of the root prim and of the interface layer, an identifier (usdfoliage.asset.plant.asset_name).
        skeleton: Of all branches.
        surfaces: The variants of the set branches.
        provenance: The run that made it.
        asset_from_capture: (4, 4) for column vectors.
        settings: Bark, and the asset's version.
        foliage: Leaves on them, None for none.
        rig: Joints, for a variant set rig.
        growth: Frames of the growth, for a variant set growth.
        rigged_leaves: How the leaves follow the joints, for the same set as the rig.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier, the settings are not those of any bark, or the leaves have numbers that are
            no leaves.
        CaptureError: The jitter map of the leaves cannot be used.
        AssetError: A picture cannot be copied, or a file cannot be written.
    """
    payload = begin_asset(folder, name)
    texture = copy_map(folder, f"{name}_bark", settings.texture)
    bark = BarkMaterial(color=settings.color, texture=texture or None, texture_m=settings.texture_m)
    guide_m = write_skeleton_layer(payload / "skeleton.usdc", name, skeleton)
    variants = {ALL_ORDERS: ["./branches.usdc"]}
    boxes = [write_branches_layer(payload / "branches.usdc", name, surfaces.whole, settings.color)]
    for order, cage in surfaces.by_order:
        layer = f"branches_order{order}.usdc"
        boxes.append(write_branches_layer(payload / layer, name, cage, settings.color))  # it may stand out a little
        variants[f"order{order}"] = [f"./{layer}"]
    sets = [VariantSet(name="lod", variants={"leaves": []})]
    rig_layers, growth_layers = ["./rig.usdc"], ["./growth.usdc"]
    guides, parts = [guide_m], [SKELETON]
    if rig is not None:  # what sways goes farther
        boxes.append(rig.extent_m)
    if foliage is None:
        write_materials_layer(payload / "materials.usda", name, bark=bark)
    else:
        layers = write_leaf_layers(folder, name, foliage.leaves, foliage.settings, foliage.edits, foliage.look, bark)
        sets.append(layers.variants)
        parts += layers.parts
        if len(foliage.leaves):
            boxes.append(layers.extent_m)
            guides += [] if layers.guide_extent_m is None else [layers.guide_extent_m]
            drawn = DrawnLeaves(
                payload=payload,
                leaves=foliage.leaves,
                representations=foliage.settings.representations,
                edits=foliage.edits,
                jitter=leaf_jitter(foliage.edits, foliage.look),
            )
            if rigged_leaves is not None:
                boxes.append(write_leaf_rig_layer(payload / RIG_LEAVES, name, drawn, rigged_leaves))
                rig_layers.append(f"./{RIG_LEAVES}")
            if growth is not None and growth.leaves is not None:
                boxes.append(write_leaf_growth_layer(payload / GROWTH_LEAVES, name, drawn, growth.leaves))
                growth_layers.append(f"./{GROWTH_LEAVES}")
    plant = Plant(
        provenance=provenance,
        asset_from_capture=asset_from_capture,
        extent_m=box_around(boxes),
        guide_extent_m=box_around(guides),
        parts=parts,
        version=settings.version,
    )
    frames = 0
    # Before the sets lod and branches, whose layers these go over.
    moving = []
    if rig is not None:
        write_rig_layer(payload / "rig.usdc", name, rig, plant.extent_m)
        moving.append(VariantSet(name="rig", variants={"none": [], "skel": rig_layers}))
        frames = rig.frames
    if growth is not None:
        write_growth_layer(payload / "growth.usdc", name, growth)
        moving.append(VariantSet(name="growth", variants={"still": [], "growing": growth_layers}))
        frames = max(frames, growth.frames)
    sets.append(VariantSet(name="branches", variants=variants))
    return finish_asset(folder, name, plant, [*moving, *sets], ["./materials.usda", "./skeleton.usdc"], frames)
