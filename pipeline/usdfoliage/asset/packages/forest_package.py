"""A whole forest: its ground, its plants by level of detail, and what holds them together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Kind, Sdf, Usd, UsdUtils

from usdfoliage.asset.layer import NO_TIMES
from usdfoliage.asset.locate import log_diagnostics
from usdfoliage.asset.materials.bark import BarkMaterial, author_bark_material
from usdfoliage.asset.materials.grass import GRASS_SHADER, GrassMaterial, author_grass_material
from usdfoliage.asset.materials.ground import GROUND_SHADER, GroundMaterial, author_ground_material
from usdfoliage.asset.materials.layer import (
    BARK_MATERIAL,
    GRASS_MATERIAL,
    GROUND_MATERIAL,
    copy_shaders,
    write_materials_layer,
)
from usdfoliage.asset.packages.assembly import begin_asset
from usdfoliage.asset.packages.interface import TILES, TileEntry, write_interface_layer, write_payload_layer
from usdfoliage.asset.packages.lods import AUTO_LAYER, AutoPlants, write_auto_plants_layer
from usdfoliage.asset.parts.grass import GrassPrim, write_grass_layer
from usdfoliage.asset.parts.leaf_part import MATERIAL_LAYER
from usdfoliage.asset.parts.part import MaterialAuthor
from usdfoliage.asset.parts.planted import PlantedLevel, write_planted_layer
from usdfoliage.asset.parts.sky import SKY, SkyPrim, write_sky_layer
from usdfoliage.asset.parts.terrain import TerrainPrim, write_terrain_layer
from usdfoliage.asset.plant import Plant, box_around
from usdfoliage.asset.provenance import Provenance, needs_file, write_provenance_file
from usdfoliage.asset.variants import VariantSet

SKY_LAYER = f"{SKY}.usda"  # in the payload's folder
LEVEL = "level"  # variant set: in which form all plants are drawn
AUTO = "auto"  # variant of it: near or far, as a renderer that knows UsdLod chooses for each tile


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantedShot:
    """Plants as a camera sees them through a shot."""

    name: str  # of the variant
    levels: Sequence[PlantedLevel]  # among which they change
    frames: tuple[float, float]  # the first and the last time code
    time_codes_per_second: float
    frames_per_second: float
    grass: GrassPrim | None = None  # blades near the camera; None of none


@dataclass(frozen=True, kw_only=True, eq=False)
class ForestTile:
    """A part of the ground and what stands on it; all tiles of a forest have the same levels and shots."""

    name: str = ""  # an identifier; empty where it is all of the forest
    terrain: TerrainPrim
    levels: Sequence[PlantedLevel]  # one variant each; the first is the default
    auto: AutoPlants | None = None  # one more variant, AUTO; None where plants have one form
    shots: Sequence[PlantedShot] = ()  # one more variant each, all of one frame rate

    @property
    def extent_m(self) -> NDArray[np.float64]:
        """(2, 3) around the ground and all plants."""
        grass = [shot.grass.extent_m for shot in self.shots if shot.grass is not None]
        levels = [level.extent_m for level in self.levels if len(level.ids)]
        return box_around([self.terrain.extent_m, *levels, *grass])


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenTile:
    """A tile whose layers are written."""

    name: str
    extent_m: NDArray[np.float64]  # (2, 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class ForestParts:
    """What holds the tiles of a forest together. Paths in it are as seen from the payload's folder."""

    tiles: Sequence[WrittenTile]  # one without a name, or as many as there are
    levels: Sequence[str]  # variants of each tile: levels, of which the first is the default, and shots
    times: Mapping[str, float]  # from the first to the last frame of all shots
    ground: GroundMaterial
    grass: GrassMaterial | None = None  # None where no shot has grass
    sky: SkyPrim | None = None  # None for no lights
    asset_from_terrain: NDArray[np.float64]  # (4, 4), column vectors: easting, northing and height as the file has them


def tile_folder(payload: Path, tile: str) -> Path:
    """Where the layers of a tile are, in the payload's folder."""
    return payload / TILES / tile if tile else payload


def write_forest_tile(folder: Path, name: str, tile: ForestTile) -> WrittenTile:
    """Write the layers of a tile, of which payload.usda brings the others; no other tile is needed.

    Args:
        folder: Of the asset.
        name: Of the asset's root prim.
        tile: Of the forest; paths in it are as seen from tile_folder.

    Raises:
        ValueError: name is no identifier.
        WriteError: A file cannot be written.
    """
    root = tile.name or name
    # Materials and plants may be elsewhere until the asset is in its place, and USD would print that.
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    layers = tile_folder(begin_asset(folder, name).payload, tile.name)
    layers.mkdir(parents=True, exist_ok=True)
    write_terrain_layer(layers / "terrain.usdc", root, tile.terrain)
    for level in tile.levels:
        write_planted_layer(layers / f"plants_{level.name}.usdc", root, [level])
    if tile.auto is not None:
        write_auto_plants_layer(layers / AUTO_LAYER, root, tile.auto)
    for shot in tile.shots:
        write_planted_layer(layers / f"plants_{shot.name}.usdc", root, shot.levels, times_of([shot]))
        if shot.grass is not None:
            write_grass_layer(layers / f"grass_{shot.name}.usdc", root, shot.grass)
    materials = f"../../{MATERIAL_LAYER}" if tile.name else f"./{MATERIAL_LAYER}"
    shared = [materials, "./terrain.usdc"]
    times = times_of(tile.shots)
    write_payload_layer(layers / "payload.usda", root, shared, [_layers_of(tile)], times)
    log_diagnostics(diagnostics)
    return WrittenTile(name=tile.name, extent_m=tile.extent_m)


def write_forest_asset(folder: Path, name: str, forest: ForestParts, provenance: Provenance) -> Path:
    """Write what holds a forest's tiles together, inside publish_folder as write_crown_asset.

    Without tiles all is behind one payload; with tiles each is behind a payload of its own, and the root's variants
    choose those of all tiles.

    Args:
        folder: An existing folder; pictures that the ground names are in it already, and the layers of the tiles.
        name: Of the root prim and the interface layer, an identifier.
        forest: What there is.
        provenance: The run that made it.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier.
        WriteError: A file cannot be written.
    """
    place = begin_asset(folder, name)
    if forest.ground.shader:
        copy_shaders(folder / "shaders", (GROUND_SHADER,))
    materials: list[MaterialAuthor] = [partial(_author_ground, ground=forest.ground), _author_bark]
    if forest.grass is not None:
        if forest.grass.shader:
            copy_shaders(folder / "shaders", (GRASS_SHADER,))
        materials.append(partial(_author_grass, grass=forest.grass))
    write_materials_layer(place.payload / MATERIAL_LAYER, name, materials)
    besides = []
    if forest.sky is not None:
        write_sky_layer(place.payload / SKY_LAYER, name, forest.sky)
        besides.append(f"./payload/{SKY_LAYER}")
    plant = Plant(
        provenance=provenance,
        asset_from_capture=forest.asset_from_terrain,
        extent_m=box_around([tile.extent_m for tile in forest.tiles]),
        relationships={},
        version="1",
        kind=Kind.Tokens.assembly,
    )
    if needs_file(provenance):
        write_provenance_file(folder, provenance)
    interface = folder / f"{name}.usda"
    tiled = {
        tile.name: TileEntry(layer=f"./payload/{TILES}/{tile.name}/payload.usda", extent_m=tile.extent_m)
        for tile in forest.tiles
        if tile.name
    }
    write_interface_layer(
        interface, name, plant, [_variants_of(forest.levels)], times=forest.times, tiles=tiled, besides=besides
    )
    return interface


def names_of_levels(tile: ForestTile) -> tuple[str, ...]:
    """The variants of a tile: its levels, AUTO, then its shots."""
    return tuple(_layers_of(tile).variants)


def times_of(shots: Sequence[PlantedShot]) -> Mapping[str, float]:
    """Metadata of a layer: from the first to the last frame of all shots."""
    if not shots:
        return NO_TIMES
    return {
        "startTimeCode": min(shot.frames[0] for shot in shots),
        "endTimeCode": max(shot.frames[1] for shot in shots),
        "timeCodesPerSecond": shots[0].time_codes_per_second,
        "framesPerSecond": shots[0].frames_per_second,
    }


def _layers_of(tile: ForestTile) -> VariantSet:
    layers = {level.name: [f"./plants_{level.name}.usdc"] for level in tile.levels}
    if tile.auto is not None:
        layers[AUTO] = [f"./{AUTO_LAYER}", *(f"./plants_{level}.usdc" for level in (tile.auto.near, tile.auto.far))]
    for shot in tile.shots:
        grass = [] if shot.grass is None else [f"./grass_{shot.name}.usdc"]
        layers[shot.name] = [f"./plants_{shot.name}.usdc", *grass]
    return VariantSet(name=LEVEL, variants=layers)


def _variants_of(levels: Sequence[str]) -> VariantSet:
    return VariantSet(name=LEVEL, variants={each: [f"./plants_{each}.usdc"] for each in levels})


def _author_ground(stage: Usd.Stage, root: Sdf.Path, ground: GroundMaterial) -> None:
    author_ground_material(stage, root.AppendPath(GROUND_MATERIAL), ground)


def _author_grass(stage: Usd.Stage, root: Sdf.Path, grass: GrassMaterial) -> None:
    author_grass_material(stage, root.AppendPath(GRASS_MATERIAL), grass)


def _author_bark(stage: Usd.Stage, root: Sdf.Path) -> None:
    author_bark_material(stage, root.AppendPath(BARK_MATERIAL), BarkMaterial())
