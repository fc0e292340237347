"""Branches as a part of an asset: their skeleton, their surfaces by order, bark, and what moves of them."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pxr import Sdf, Usd

from usdfoliage.asset.materials.bark import BARK_COLOR, BarkMaterial, author_bark_material
from usdfoliage.asset.materials.layer import BARK_MATERIAL
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
from usdfoliage.asset.parts.part import AssetPlace, Part, copy_map
from usdfoliage.asset.parts.sway_clips import write_leaf_clips, write_rig_clips
from usdfoliage.asset.plant import BRANCHES, SKELETON, TO_SKELETON
from usdfoliage.asset.variants import VariantSet
from usdfoliage.branch.cage.surfaces import BranchSurfaces

ALL_ORDERS = "all"  # variant of the set branches
_SKELETON, _SURFACE, _RIG, _GROWTH = "skeleton.usdc", "branches.usdc", "rig.usdc", "growth.usdc"


@dataclass(frozen=True, kw_only=True)
class BranchAssetSettings:
    """How an asset of branches is written."""

    color: tuple[float, float, float] = BARK_COLOR  # linear Rec.709
    texture: Path | None = None  # picture of bark that repeats
    texture_m: float = 0.5  # width of what it shows
    version: str = "1"  # assetInfo


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantBranches:
    """All that is written of branches."""

    skeleton: SkeletonPrim
    surfaces: BranchSurfaces  # the variants of the set branches
    settings: BranchAssetSettings = BranchAssetSettings()
    rig: BranchRig | None = None  # joints, for a variant set rig
    growth: BranchGrowth | None = None  # frames of the growth, for a variant set growth
    rigged_leaves: RiggedLeaves | None = None  # how leaves follow the joints, for the same set as the rig


def write_branch_part(place: AssetPlace, branches: PlantBranches, drawn: DrawnLeaves | None = None) -> Part:
    """Write branches into the asset at place.

    Args:
        place: Where; the payload's folder exists, with the layers of the leaves.
        branches: What to write, in the plant's frame.
        drawn: The leaves on them; None where there are none.

    Raises:
        ValueError: The settings are not those of any bark.
        AssetError: A picture cannot be copied, or a file cannot be written.
    """
    payload, name, settings = place.payload, place.name, branches.settings
    texture = copy_map(place, f"{name}_bark", settings.texture)
    bark = BarkMaterial(color=settings.color, texture=texture or None, texture_m=settings.texture_m)
    guide_m = write_skeleton_layer(payload / _SKELETON, name, branches.skeleton)
    variants = {ALL_ORDERS: [f"./{_SURFACE}"]}
    boxes = [write_branches_layer(payload / _SURFACE, name, branches.surfaces.whole, settings.color)]
    for order, cage in branches.surfaces.by_order:
        layer = f"branches_order{order}.usdc"
        boxes.append(write_branches_layer(payload / layer, name, cage, settings.color))  # it may stand out a little
        variants[f"order{order}"] = [f"./{layer}"]
    moving = []
    rig, growth, rigged_leaves = branches.rig, branches.growth, branches.rigged_leaves
    if rig is not None:
        layers = [f"./{_RIG}"]
        boxes.append(rig.extent_m)  # what sways goes farther
        if rig.has_clips:  # they go over what holds the rest
            layers.insert(0, write_rig_clips(payload, name, rig))
        if drawn is not None and rigged_leaves is not None:
            moves = rigged_leaves.motion
            boxes.append(
                write_leaf_rig_layer(payload / RIG_LEAVES, name, drawn, rigged_leaves, has_samples=not rig.has_clips)
            )
            layers.append(f"./{RIG_LEAVES}")
            if rig.has_clips and moves is not None:
                layer, around = write_leaf_clips(payload, name, drawn, moves)
                boxes += around
                layers.insert(0, layer)
        moving.append(VariantSet(name="rig", variants={"none": [], "skel": layers}))
    if growth is not None:
        write_growth_layer(payload / _GROWTH, name, growth)
        layers = [f"./{_GROWTH}"]
        if drawn is not None and growth.leaves is not None:
            boxes.append(write_leaf_growth_layer(payload / GROWTH_LEAVES, name, drawn, growth.leaves))
            layers.append(f"./{GROWTH_LEAVES}")
        moving.append(VariantSet(name="growth", variants={"still": [], "growing": layers}))
    return Part(
        relationships={TO_SKELETON: SKELETON},
        collections={"branches": [BRANCHES]},
        materials=[partial(_author_material, bark=bark)],
        guides=[f"./{_SKELETON}"],
        near_m=boxes,
        guides_m=[guide_m],
        moving=moving,
        still=[VariantSet(name="branches", variants=variants)],
        frames=max(rig.frames if rig is not None else 0, growth.frames if growth is not None else 0),
        finish=partial(write_rig_layer, payload / _RIG, name, rig) if rig is not None else None,
    )


def _author_material(stage: Usd.Stage, root: Sdf.Path, bark: BarkMaterial) -> None:
    author_bark_material(stage, root.AppendPath(BARK_MATERIAL), bark)
