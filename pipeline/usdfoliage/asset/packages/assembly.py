"""The parts of an asset put together: one materials layer, the variant sets, the payload and the interface."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from usdfoliage.asset.materials.layer import write_materials_layer
from usdfoliage.asset.packages.interface import write_interface_layer, write_payload_layer
from usdfoliage.asset.parts.leaf_part import MATERIAL_LAYER
from usdfoliage.asset.parts.part import AssetPlace, Part
from usdfoliage.asset.plant import Plant, box_around
from usdfoliage.asset.provenance import Provenance, needs_file, write_provenance_file
from usdfoliage.asset.variants import VariantSet


@dataclass(frozen=True, kw_only=True, eq=False)
class Origin:
    """Where an asset comes from, whatever its parts are."""

    provenance: Provenance
    asset_from_capture: NDArray[np.float64] | None = None  # (4, 4), column vectors; None: the identity
    version: str = "1"  # of the asset, in its assetInfo

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) for column vectors, from the capture's coordinates to the asset's."""
        return np.eye(4) if self.asset_from_capture is None else self.asset_from_capture


def begin_asset(folder: Path, name: str) -> AssetPlace:
    """The place of an asset, with the folder of its payload; ValueError for a name that is no identifier."""
    if not Sdf.Path.IsValidIdentifier(name):
        raise ValueError(f"{name!r} is no identifier; asset_name makes one")
    place = AssetPlace(folder=folder, name=name)
    place.payload.mkdir(parents=True, exist_ok=True)
    return place


def write_asset(place: AssetPlace, parts: Sequence[Part], origin: Origin) -> Path:
    """Write what holds parts together that are all shown in the one lod of their asset.

    A whole plant, which has several, is written by usdfoliage.asset.packages.plant_package.

    Args:
        place: Where the parts were written.
        parts: At least one, which shows something.
        origin: Of the asset.

    Returns:
        The interface layer.

    Raises:
        WriteError: A file cannot be written.
    """
    far = [layer for part in parts for layer in part.far]
    lods = next((part.lods for part in parts if part.lods is not None), None)
    sets = [
        *(each for part in parts for each in part.moving),
        lods or VariantSet(name="lod", variants={"crown": far} if far else {"leaves": []}),
        *(each for part in parts for each in part.inside),
        *(each for part in parts for each in part.still),
    ]
    guides_m = [box for part in parts for box in part.guides_m]
    plant = Plant(
        provenance=origin.provenance,
        asset_from_capture=origin.matrix,
        extent_m=box_around([box for part in parts for box in (*part.near_m, *part.far_m)]),
        guide_extent_m=box_around(guides_m) if guides_m else None,
        relationships=merge_relationships(parts),
        version=origin.version,
    )
    shared = [layer for part in parts for layer in (*part.near, *part.guides)]
    return close_asset(place, parts, plant, sets, [f"./{MATERIAL_LAYER}", *shared])


def close_asset(
    place: AssetPlace, parts: Sequence[Part], plant: Plant, sets: Sequence[VariantSet], shared: Sequence[str]
) -> Path:
    """Write the layers that every asset has: materials, payload and interface, and what of the parts waits for them.

    Args:
        place: Where the parts were written.
        parts: All of them.
        plant: What is authored on the root prim.
        sets: All variant sets.
        shared: Layers of the payload's folder in every variant.

    Returns:
        The interface layer.

    Raises:
        WriteError: A file cannot be written.
    """
    from_afar_first = sorted(parts, key=lambda part: not part.far)
    materials = [author for part in from_afar_first for author in part.materials]
    write_materials_layer(place.payload / MATERIAL_LAYER, place.name, materials)
    near_m = [box for part in parts for box in part.near_m]
    for part in parts:
        if part.finish is not None:
            part.finish(box_around(near_m) if near_m else plant.extent_m)
    write_payload_layer(place.payload / "payload.usda", place.name, shared, sets, _times_of(parts))
    if needs_file(plant.provenance):
        write_provenance_file(place.folder, plant.provenance)
    return write_interface(place, parts, plant, sets)


def write_interface(place: AssetPlace, parts: Sequence[Part], plant: Plant, sets: Sequence[VariantSet]) -> Path:
    """Write the interface layer alone, or again where plant now holds more; returns the layer's path.

    Raises:
        WriteError: It cannot be written.
    """
    interface = place.folder / f"{place.name}.usda"
    frames = max((part.frames for part in parts), default=0)
    write_interface_layer(interface, place.name, plant, sets, frames, _times_of(parts))
    return interface


def _times_of(parts: Sequence[Part]) -> dict[str, float]:
    times: dict[str, float] = {}
    for part in parts:
        times |= dict(part.times)
    return times


def merge_relationships(parts: Sequence[Part]) -> Mapping[str, str]:
    """What the root prim of an asset of these parts names."""
    return {name: prim for part in parts for name, prim in part.relationships.items()}


def merge_collections(parts: Sequence[Part], names: Sequence[str]) -> Mapping[str, Sequence[str]]:
    """What the collections of a whole plant hold, those of these names first."""
    merged: dict[str, list[str]] = {}
    for part in parts:
        for name, prims in part.collections.items():
            merged.setdefault(name, []).extend(prims)
    order = {name: number for number, name in enumerate(names)}
    return {name: merged[name] for name in sorted(merged, key=lambda name: (order.get(name, len(order)), name))}
