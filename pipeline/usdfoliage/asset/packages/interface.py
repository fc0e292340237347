"""The two text layers that hold an asset together: its interface and its payload."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pxr import Sdf, Usd

from usdfoliage.asset.layer import NO_TIMES, author_frames, author_times, export_layer, new_layer
from usdfoliage.asset.packages.cards import author_cards
from usdfoliage.asset.plant import Plant, author_lod_extents, author_plant
from usdfoliage.asset.provenance import author_provenance
from usdfoliage.asset.variants import VariantSet, author_variant_references, author_variant_sets

PAYLOAD = "./payload/payload.usda"  # from the interface layer


def write_interface_layer(
    path: Path,
    name: str,
    plant: Plant,
    variants: Sequence[VariantSet],
    frames: int = 0,
    times: Mapping[str, float] = NO_TIMES,
) -> None:
    """Write what an application reads before it loads the asset: the root prim and nothing below it.

    frames is how many there are in variants that move; times, a range of time as metadata of a layer, goes before that.
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
    author_payload(stage, root, PAYLOAD)
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


def author_payload(stage: Usd.Stage, path: Sdf.Path, layer: str) -> None:
    """Put what layer's default prim holds behind a payload on the prim at path."""
    stage.GetPrimAtPath(path).GetPayloads().AddPayload(layer)


def author_references(stage: Usd.Stage, path: Sdf.Path, layers: Sequence[str]) -> None:
    """Bring the default prims of layers to path, the first one strongest."""
    for layer in layers:
        stage.GetPrimAtPath(path).GetReferences().AddReference(layer)
