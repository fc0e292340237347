"""An asset's parts, read as the models that they were written from."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from usdfoliage.asset.locate import find_leaves, select_representation
from usdfoliage.asset.look_layer import BEZIER, LOD, select_lod
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.materials.cubemap_exr import read_cubemap
from usdfoliage.asset.own_files import own_folders
from usdfoliage.asset.packages.contents import (
    find_branches,
    find_crown,
    find_skeleton,
    interface_of,
    matrix_in_plant,
    read_crown_facts,
    read_leaf_appearance,
    read_plant_facts,
    representations,
    require_plant,
)
from usdfoliage.asset.packed_files import unpacked
from usdfoliage.asset.parts.branches import SurfaceMesh, read_branches, read_skeleton
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.asset.parts.leaf_primvars import describe_unfound, place
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.asset.provenance import Provenance
from usdfoliage.branch.model import Skeleton
from usdfoliage.crown.model import CrownModel
from usdfoliage.errors import AssetError
from usdfoliage.leaf.change import move_leaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits


@dataclass(frozen=True, kw_only=True, eq=False)
class AssetModels:
    """The parts of one asset, as models. Frame: the asset's own, metres, right-handed, Y up.

    Attributes:
        interface: The interface layer, the one USD file at the top of the asset's folder.
        name: The name of the root prim.
        asset_from_capture: (4, 4) float64, for column vectors: from the coordinates of the input files to the asset.
        provenance: The run that made the asset.
        leaves: The leaves as they are stored, before the edits. None in an asset without leaves.
        edits: The collective edits of these leaves. Those of a look count, where a look was opened.
        appearance: The colour and the pictures that all leaves share.
        skeleton: The axes of the branches. None in an asset without branches.
        crown: The crown as cubemaps. None in an asset without a crown.
    """

    interface: Path
    name: str
    asset_from_capture: NDArray[np.float64]
    provenance: Provenance
    leaves: Leaves | None = None
    edits: LeafEdits = NEUTRAL
    appearance: LeafAppearance = field(default_factory=LeafAppearance)
    skeleton: Skeleton | None = None
    crown: CrownModel | None = None


def read_models(asset: Path) -> AssetModels:
    """Read the parts of an asset, whichever variants are selected in it.

    Args:
        asset: The asset's folder, its interface layer, or a look of it.

    Raises:
        AssetError: The asset cannot be read, is none of ours or holds several plants; its leaves have no representation
            bezier; an array or a cubemap is missing or damaged; a transform shears the leaves, or moves the skeleton
            or the crown within the plant.
    """
    interface, look = interface_of(asset)
    stage = open_asset(asset)
    plant = require_plant(stage, asset)
    facts = read_plant_facts(plant, interface)
    if "both" in facts.variants.get(LOD, ()):
        select_lod(plant, "both")  # so that every part is there
    skeleton, crown = find_skeleton(plant), find_crown(plant)
    if representations(plant):
        select_representation(stage, BEZIER)
    prims = find_leaves(stage)
    read = read_leaves(prims[0]) if prims else None
    appearance = LeafAppearance()
    if read is not None:
        folders = own_folders(interface, None if look is None else look.path, prims[0])
        appearance = read_leaf_appearance(prims[0], read.jitter_map, folders)
    return AssetModels(
        interface=interface,
        name=facts.name,
        asset_from_capture=facts.asset_from_capture,
        provenance=facts.provenance,
        leaves=None if read is None else move_leaves(read.leaves, matrix_in_plant(prims[0], plant)),
        edits=NEUTRAL if read is None else read.edits,
        appearance=appearance,
        skeleton=None if skeleton is None else read_skeleton(_unmoved(skeleton, plant)),
        crown=None if crown is None else read_crown(_unmoved(crown, plant), facts.asset_from_capture),
    )


def read_branch_surface(asset: Path) -> SurfaceMesh | None:
    """The surface of an asset's branches in the asset's frame, before it is subdivided; None where it has none.

    Raises:
        AssetError: The asset cannot be read, is none of ours or holds several plants; the surface is damaged, or a
            transform moves it within the plant.
    """
    stage = open_asset(asset)
    plant = require_plant(stage, asset)
    interface, _ = interface_of(asset)
    if "both" in read_plant_facts(plant, interface).variants.get(LOD, ()):
        select_lod(plant, "both")
    prim = find_branches(plant)
    return None if prim is None else read_branches(_unmoved(prim, plant))


def read_crown(prim: Usd.Prim, asset_from_photo: NDArray[np.float64]) -> CrownModel:
    """The crown at prim with its two cubemaps; colours are those of half floats, as they are stored.

    Raises:
        AssetError: A fact or a cubemap is missing, or the cubemaps are not of one size or hold no such numbers.
    """
    facts = read_crown_facts(prim)
    if facts.radius_map is None or facts.color_map is None:
        what, name = ("radius", "radiusMap") if facts.radius_map is None else ("colour", "colorMap")
        map_attribute = prim.GetAttribute(f"foliage:crown:{name}")
        raise describe_unfound(f"{what} map of the crown", map_attribute, "write the asset again")
    with unpacked(facts.radius_map) as file:
        radius_m = np.asarray(read_cubemap(file).pixels, np.float32)
    with unpacked(facts.color_map) as file:
        color = np.asarray(read_cubemap(file).pixels, np.float32)
    if radius_m.ndim != 3 or color.shape != (*radius_m.shape, 3):
        raise AssetError(
            f"the maps of the crown hold {radius_m.shape} and {color.shape}, one radius and one colour a texel are "
            f"needed ({place(prim)})",
            "write the asset again",
        )
    if not (np.isfinite(radius_m).all() and np.isfinite(color).all() and radius_m.min() > 0):
        raise AssetError(f"a radius of the crown is not above 0, or a number is not finite ({place(prim)})")
    return CrownModel(
        radius_m=radius_m,
        color=color,
        center_m=np.array(facts.center_m),
        relief_weight=facts.relief_weight,
        asset_from_photo=asset_from_photo,
    )


def _unmoved(prim: Usd.Prim, plant: Usd.Prim) -> Usd.Prim:
    """The prim; AssetError where a transform stands between it and its plant, which no model can hold."""
    if not np.array_equal(matrix_in_plant(prim, plant), np.eye(4)):
        raise AssetError(f"a transform moves a part within its plant ({place(prim)})", "move the whole plant instead")
    return prim
