"""The two text layers that hold an asset together: its interface and its payload."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from pxr import Kind, Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import NO_TIMES, author_frames, author_times, export_layer, new_layer
from usdfoliage.asset.packages.cards import author_cards
from usdfoliage.asset.plant import Plant, author_lod_extents, author_plant
from usdfoliage.asset.provenance import author_provenance
from usdfoliage.asset.variants import VariantSet, author_variant_references, author_variant_sets

PAYLOAD = "./payload/payload.usda"  # from the interface layer
TILES = "tiles"  # below the root prim, and in the payload's folder


@dataclass(frozen=True, kw_only=True, eq=False)
class TileEntry:
    """A part of an asset that is behind a payload of its own."""

    layer: str  # as seen from the interface layer
    extent_m: NDArray[np.float64]  # (2, 3)


NO_TILES: Mapping[str, TileEntry] = MappingProxyType({})


def write_interface_layer(
    path: Path,
    name: str,
    plant: Plant,
    variants: Sequence[VariantSet],
    frames: int = 0,
    times: Mapping[str, float] = NO_TIMES,
    tiles: Mapping[str, TileEntry] = NO_TILES,
    besides: Sequence[str] = (),
) -> None:
    """Write what an application reads before it loads the asset: the root prim, and below it tiles, if there are any.

    frames is how many there are in variants that move; times, a range of time as metadata of a layer, goes before that.
    Tiles have the variants of the root, and follow its choice. Layers besides, as seen from this one, are no payload.
    """
    stage = new_layer(path, name)
    if frames:
        author_frames(stage, frames)
    author_times(stage, times)
    root = Sdf.Path(f"/{name}")
    prim = author_plant(stage, root, plant)
    if plant.cards:
        author_cards(prim, plant.cards)
    author_variant_sets(stage, root, variants)
    if plant.lods:
        author_lod_extents(stage.GetRootLayer(), root, plant.lods)
    if tiles:
        _author_tiles(stage, root, tiles, variants)
    else:
        author_payload(stage, root, PAYLOAD)
    author_references(stage, root, besides)
    author_provenance(stage.GetRootLayer(), plant.provenance)
    export_layer(stage, path)


def write_payload_layer(
    path: Path,
    name: str,
    shared: Sequence[str],
    variants: Sequence[VariantSet],
    times: Mapping[str, float] = NO_TIMES,
) -> None:
    """Write what the payload brings: layers that every variant shares, and those of each variant."""
    stage = new_layer(path, name)
    author_times(stage, times)
    root = Sdf.Path(f"/{name}")
    author_references(stage, root, shared)
    author_variant_references(stage, root, variants)
    export_layer(stage, path)


def _author_tiles(
    stage: Usd.Stage, root: Sdf.Path, tiles: Mapping[str, TileEntry], variants: Sequence[VariantSet]
) -> None:
    holder = UsdGeom.Xform.Define(stage, root.AppendChild(TILES))
    Usd.ModelAPI(holder).SetKind(Kind.Tokens.group)
    for name, tile in tiles.items():
        prim = UsdGeom.Xform.Define(stage, holder.GetPath().AppendChild(name)).GetPrim()
        Usd.ModelAPI(prim).SetKind(Kind.Tokens.group)
        corners = Vt.Vec3fArray.FromNumpy(tile.extent_m.astype(np.float32))
        UsdGeom.ModelAPI.Apply(prim).SetExtentsHint(corners)
        author_payload(stage, prim.GetPath(), tile.layer)
    spec = stage.GetEditTarget().GetLayer().GetPrimAtPath(root)
    for entry in variants:
        for member in entry.variants:
            chosen = Sdf.PrimSpec(spec.variantSets[entry.name].variants[member].primSpec, TILES, Sdf.SpecifierOver)
            for name in tiles:
                Sdf.PrimSpec(chosen, name, Sdf.SpecifierOver).variantSelections[entry.name] = member


def author_payload(stage: Usd.Stage, path: Sdf.Path, layer: str) -> None:
    """Put what layer's default prim holds behind a payload on the prim at path."""
    stage.GetPrimAtPath(path).GetPayloads().AddPayload(layer)


def author_references(stage: Usd.Stage, path: Sdf.Path, layers: Sequence[str]) -> None:
    """Bring the default prims of layers to path, the first one strongest."""
    for layer in layers:
        stage.GetPrimAtPath(path).GetReferences().AddReference(layer)
