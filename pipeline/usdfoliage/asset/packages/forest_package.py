"""A whole forest: its ground, its plants by level of detail, and what holds them together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Kind, Sdf, Usd

from usdfoliage.asset.layer import NO_TIMES
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
class PlantedShot:
    """Plants as a camera sees them through a shot."""

    name: str  # of the variant
    levels: Sequence[PlantedLevel]  # among which they change
    frames: tuple[float, float]  # the first and the last time code
    frames_per_second: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ForestParts:
    """What a forest's asset is written from."""

    terrain: TerrainPrim
    levels: Sequence[PlantedLevel]  # one variant each; the first is the default
    shots: Sequence[PlantedShot] = ()  # one more variant each, all of one frame rate
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
        write_planted_layer(place.payload / f"plants_{level.name}.usdc", name, [level])
    for shot in forest.shots:
        write_planted_layer(place.payload / f"plants_{shot.name}.usdc", name, shot.levels, _times_of([shot]))
    times = _times_of(forest.shots)
    materials: list[MaterialAuthor] = [partial(_author_ground, ground=forest.ground), _author_bark]
    write_materials_layer(place.payload / MATERIAL_LAYER, name, materials)
    names = [level.name for level in forest.levels] + [shot.name for shot in forest.shots]
    levels = VariantSet(name=LEVEL, variants={each: [f"./plants_{each}.usdc"] for each in names})
    shared = [f"./{MATERIAL_LAYER}", "./terrain.usdc"]
    write_payload_layer(place.payload / "payload.usda", name, shared, [levels], times)
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
    write_interface_layer(interface, name, plant, [levels], times=times)
    return interface


def _times_of(shots: Sequence[PlantedShot]) -> Mapping[str, float]:
    """Metadata of a layer: from the first to the last frame of all shots."""
    if not shots:
        return NO_TIMES
    rate = shots[0].frames_per_second
    return {
        "startTimeCode": min(shot.frames[0] for shot in shots),
        "endTimeCode": max(shot.frames[1] for shot in shots),
        "timeCodesPerSecond": rate,
        "framesPerSecond": rate,
    }


def _author_ground(stage: Usd.Stage, root: Sdf.Path, ground: GroundMaterial) -> None:
    author_ground_material(stage, root.AppendPath(GROUND_MATERIAL), ground)


def _author_bark(stage: Usd.Stage, root: Sdf.Path) -> None:
    author_bark_material(stage, root.AppendPath(BARK_MATERIAL), BarkMaterial())
