"""The leaves that rows of plants.toml give to the crowns of their assets."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdfoliage.asset.packages.planted_assets import PlantedAsset
from usdfoliage.asset.parts.crown_leaf_picture import brightness_of, write_leaf_picture
from usdfoliage.asset.parts.crown_leaves import OtherLeaves, PlacedClusters
from usdfoliage.asset.parts.part import MAPS
from usdfoliage.crown.leaf_picture import LeafPicture
from usdfoliage.crown.leafy_crown import LeafyCrownSettings, build_leaf_clusters
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.forest.plants_file import PlantsFile
from usdfoliage.jobs.leaf_picture import read_leaf_picture


@dataclass(frozen=True, kw_only=True, eq=False)
class RowLeaf:
    """The picture of a leaf of a row, and the clusters that have it."""

    picture: LeafPicture
    clusters: PlacedClusters


def read_row_leaves(plants: PlantsFile, assets: Sequence[PlantedAsset], output: Path) -> tuple[RowLeaf | None, ...]:
    """The leaf of each row, None for rows that name none; each file is read once.

    Raises:
        CaptureError: A picture cannot be used, or the crown of an asset has no leaves; the text names the row.
    """
    read: dict[Path, LeafPicture] = {}
    leaves: list[RowLeaf | None] = []
    for number, (row, asset) in enumerate(zip(plants.rows, assets, strict=True)):
        if row.leaf is None:
            leaves.append(None)
            continue
        place = f"row {number + 1} ({row.species}) of {plants.path}"
        if asset.clusters is None:
            raise CaptureError(
                f"{place} has leaf, and {row.asset} has no crown of leaves",
                "leave the leaf out, or name an asset with a crown that usdfoliage made",
            )
        if row.leaf.resolve().is_relative_to(output.resolve()):
            raise CaptureError(f"{place}: {row.leaf} lies in the output {output}", "write the forest to another folder")
        if row.leaf not in read:
            try:
                read[row.leaf] = read_leaf_picture(row.leaf, output)
            except FoliageError as error:
                raise CaptureError(f"{place}: {error.text}", error.remedy) from error
        leaves.append(RowLeaf(picture=read[row.leaf], clusters=asset.clusters))
    return tuple(leaves)


def write_row_leaves(
    folder: Path, name: str, leaves: Sequence[RowLeaf | None], maps: str = MAPS
) -> tuple[OtherLeaves | None, ...]:
    """Write the pictures of leaves into the maps of a forest; returns what its layers have of each.

    Args:
        folder: Of the asset.
        name: Of the asset.
        leaves: Of each row.
        maps: The folder of maps, as seen from the folder of the layers.

    Raises:
        AssetError: A picture cannot be encoded.
        WriteError: A file cannot be written.
    """
    others: list[OtherLeaves | None] = []
    for number, leaf in enumerate(leaves):
        if leaf is None:
            others.append(None)
            continue
        file = f"{name}_leaf_{number + 1}.png"
        (folder / "maps").mkdir(exist_ok=True)
        write_leaf_picture(folder / "maps" / file, leaf.picture)
        settings = LeafyCrownSettings(
            forms=leaf.clusters.forms, leaf_width=leaf.picture.width, leaf_cover=leaf.picture.cover
        )
        clusters = build_leaf_clusters(settings)
        farther = max(0.0, max(each.reach for each in clusters) - leaf.clusters.reach) * leaf.clusters.radius
        others.append(
            OtherLeaves(
                leaf_map=f"{maps}/{file}",
                brightness=brightness_of(leaf.picture),
                clusters=clusters,
                extent=leaf.clusters.extent + farther * np.array([[-1.0], [1.0]]),
            )
        )
    return tuple(others)
