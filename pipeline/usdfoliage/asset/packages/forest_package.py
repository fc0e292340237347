"""A whole forest: its ground, its plants by level of detail, and what holds them together."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Kind, Sdf, Usd

from usdfoliage.asset.materials.bark import BarkMaterial, author_bark_material
from usdfoliage.asset.materials.ground import GroundMaterial, author_ground_material
from usdfoliage.asset.materials.layer import BARK_MATERIAL, GROUND_MATERIAL, write_materials_layer
from usdfoliage.asset.packages.assembly import begin_asset
from usdfoliage.asset.packages.interface import write_interface_layer, write_payload_layer
from usdfoliage.asset.parts.leaf_part import MATERIAL_LAYER
from usdfoliage.asset.parts.part import MaterialAuthor
from usdfoliage.asset.parts.planted import PlantedLevel, write_planted_layer
from usdfoliage.asset.parts.terrain import TerrainPrim, write_terrain_layer
from usdfoliage.asset.plant import Plant, box_around
from usdfoliage.asset.provenance import Provenance, needs_file, write_provenance_file
from usdfoliage.asset.variants import VariantSet

LEVEL = "level"  # variant set: in which form all plants are drawn


@dataclass(frozen=True, kw_only=True, eq=False)
class ForestParts:
    """What a forest's asset is written from."""

    terrain: TerrainPrim
    levels: Sequence[PlantedLevel]  # one variant each; the first is the default
    ground: GroundMaterial  # paths as seen from the payload's folder
    asset_from_terrain: NDArray[np.float64]  # (4, 4), column vectors: easting, northing and height as the file has them


def write_forest_asset(folder: Path, name: str, forest: ForestParts, provenance: Provenance) -> Path:
    """Write a forest, inside publish_folder as write_crown_asset.

    Args:
        folder: An existing folder; pictures that the ground names are in it already.
        name: Of the root prim and the interface layer, an identifier.
        forest: What stands where.
        provenance: The run that made it.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier.
        WriteError: A file cannot be written.
    """
    place = begin_asset(folder, name)
    write_terrain_layer(place.payload / "terrain.usdc", name, forest.terrain)
    for level in forest.levels:
        write_planted_layer(place.payload / f"plants_{level.name}.usdc", name, level)
    materials: list[MaterialAuthor] = [partial(_author_ground, ground=forest.ground), _author_bark]
    write_materials_layer(place.payload / MATERIAL_LAYER, name, materials)
    levels = VariantSet(name=LEVEL, variants={level.name: [f"./plants_{level.name}.usdc"] for level in forest.levels})
    write_payload_layer(place.payload / "payload.usda", name, [f"./{MATERIAL_LAYER}", "./terrain.usdc"], [levels])
    boxes_m = [forest.terrain.extent_m, *(level.extent_m for level in forest.levels if len(level.ids))]
    plant = Plant(
        provenance=provenance,
        asset_from_capture=forest.asset_from_terrain,
        extent_m=box_around(boxes_m),
        relationships={},
        version="1",
        kind=Kind.Tokens.assembly,
    )
    if needs_file(provenance):
        write_provenance_file(folder, provenance)
    interface = folder / f"{name}.usda"
    write_interface_layer(interface, name, plant, [levels])
    return interface


def _author_ground(stage: Usd.Stage, root: Sdf.Path, ground: GroundMaterial) -> None:
    author_ground_material(stage, root.AppendPath(GROUND_MATERIAL), ground)


def _author_bark(stage: Usd.Stage, root: Sdf.Path) -> None:
    author_bark_material(stage, root.AppendPath(BARK_MATERIAL), BarkMaterial())
