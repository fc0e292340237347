"""The leaves of another asset, from which other leaves are drawn or a picture of one is made."""

from dataclasses import dataclass
from pathlib import Path

from usdfoliage.asset.locate import require_leaves, select_representation
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.own_files import own_folders
from usdfoliage.asset.packages.contents import interface_of, matrix_in_plant, read_leaf_appearance, require_plant
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.errors import AssetError
from usdfoliage.leaf.change import bake_leaves, move_leaves, remaining_edits
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import LeafEdits


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedLeaves:
    """Leaves of another asset, to be drawn from."""

    leaves: Leaves
    edits: LeafEdits  # what no parameter can carry
    appearance: LeafAppearance


def read_fitted_leaves(asset: Path, output: Path) -> FittedLeaves:
    """The leaves of an asset, with its edits in them, in its own metres.

    Args:
        asset: Its folder, or its USD file.
        output: The folder that will be replaced.

    Raises:
        AssetError: It cannot be read, is not one plant, has no leaves, or lies in the output.
    """
    interface, look = interface_of(asset)
    if interface.resolve().is_relative_to(output.resolve()):
        raise AssetError(
            f"{output} holds the leaves that are read, {asset}, and would lose them", "name another folder"
        )
    stage = open_asset(asset)
    plant = require_plant(stage, asset)
    if "representation" in plant.GetVariantSets().GetNames():
        select_representation(stage, "bezier")
    prim = require_leaves(stage, asset)[0]
    read = read_leaves(prim)
    if not len(read.leaves):
        raise AssetError(f"{asset} has leaves, but none is shown", "name an asset of leaves")
    leaves = move_leaves(bake_leaves(read.leaves, read.edits), matrix_in_plant(prim, plant))
    folders = own_folders(interface, None if look is None else look.path, prim)
    appearance = read_leaf_appearance(prim, read.jitter_map, folders)
    return FittedLeaves(leaves=leaves, edits=remaining_edits(read.edits), appearance=appearance)
