"""What an asset holds, in numbers: counts, sizes, ranges, edits, layers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from usdfoliage.asset.locate import find_leaves, is_assembly, select_representation
from usdfoliage.asset.look_layer import LOD, select_lod
from usdfoliage.asset.looks.extents import extents_hold
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.looks.plain import PlainLook
from usdfoliage.asset.materials.cubemap_exr import read_cubemap
from usdfoliage.asset.materials.jitter_map import read_jitter_map
from usdfoliage.asset.packages.contents import (
    AssetFile,
    CrownFacts,
    find_crown,
    find_skeleton,
    interface_of,
    list_files,
    outside_files,
    read_crown_facts,
    read_plant_facts,
    representations,
    require_plant,
)
from usdfoliage.asset.packages.forest_contents import ForestInfo, read_forest
from usdfoliage.asset.packages.interface import TILES
from usdfoliage.asset.packed_files import file_name, unpacked
from usdfoliage.asset.parts.branches import read_skeleton
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.errors import FoliageError
from usdfoliage.files.printable import printable
from usdfoliage.jobs.branches.measures import BranchInfo, branch_rows, measure_branches
from usdfoliage.jobs.edits.edit import Value, changed_edits, show_value
from usdfoliage.leaf.model import PARAMETERS, Leaves, count_origins, describe_origins
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits, apply_edits
from usdfoliage.leaf.shape.measures import leaf_area

Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Least, middle and largest of some numbers."""

    minimum: float
    median: float
    maximum: float


@dataclass(frozen=True, kw_only=True)
class ParameterRange:
    """What one parameter, three numbers, is among the leaves as they are stored, without edits."""

    name: str
    minimum: Triple
    mean: Triple
    maximum: Triple


@dataclass(frozen=True, kw_only=True)
class LeafInfo:
    """The leaves of an asset; length, area and so on as the edits make them, jitter left out."""

    count: int
    length_m: Spread | None  # None without a leaf
    area_m2: float
    parameters: tuple[ParameterRange, ...]
    edits: Mapping[str, Value]  # those that are not neutral
    jitter_map: str
    confidence: Spread | None
    residual_m: Spread | None
    views: int  # photographs in which some leaf was seen
    per_leaf: tuple[str, ...]  # what is known of each leaf besides its parameters
    extents_hold: bool | None  # the edited leaves; None where that was not looked at
    origins: Mapping[str, int]  # leaves of each origin, as leaf.model.count_origins; empty where that is unknown


@dataclass(frozen=True, kw_only=True)
class CrownInfo:
    """The crown of an asset."""

    center_m: Triple
    radius_m: tuple[float, float]
    relief_weight: float
    radius_map_px: int | None  # texels along an edge of a face; None where the file is missing
    color_map_px: int | None


@dataclass(frozen=True, kw_only=True)
class AssetInfo:
    """All that `usdfoliage info` prints."""

    name: str
    asset: str
    look: str  # empty without one
    generator: str
    species: str
    capture: str
    seed: int
    variants: Mapping[str, Sequence[str]]
    selections: Mapping[str, str]
    extent: tuple[Triple, Triple] | None  # in the stage's unit
    up_axis: str
    meters_per_unit: float
    schemas: Mapping[str, Sequence[str]]
    layers: tuple[AssetFile, ...]
    files: tuple[AssetFile, ...]
    missing: tuple[str, ...]
    leaves: LeafInfo | None
    crown: CrownInfo | None
    branches: BranchInfo | None = None
    outside: tuple[str, ...] = ()  # files that it needs and that are not in its folder
    forest: ForestInfo | None = None


def describe_asset(asset: Path) -> AssetInfo:
    """Read an asset's folder, its interface layer or a look, and measure what it holds, whichever lod is selected.

    Raises:
        AssetError: It cannot be read, is not ours, or holds several plants; an array of the leaves is damaged.
    """
    interface, look = interface_of(asset)
    stage = open_asset(asset)
    plant = require_plant(stage, asset, one=False)
    facts = read_plant_facts(plant, interface)
    layers, files, missing = list_files(interface)
    if "both" in facts.variants.get(LOD, ()):
        select_lod(plant, "both")  # so that every part is there
        facts = replace(read_plant_facts(plant, interface), selections=facts.selections, extent=facts.extent)
    crown = find_crown(plant)
    skeleton = find_skeleton(plant)
    present = representations(plant)
    if present:
        select_representation(stage, "bezier")
    prims = [] if is_assembly(plant) else find_leaves(stage)
    return AssetInfo(
        name=facts.name,
        asset=str(interface),
        look=str(look.path) if look else "",
        generator=facts.provenance.generator,
        species=facts.provenance.species,
        capture=facts.provenance.capture,
        seed=facts.provenance.seed,
        variants=facts.variants,
        selections=facts.selections,
        extent=None if facts.extent is None else (_triple(facts.extent[0]), _triple(facts.extent[1])),
        up_axis=facts.up_axis,
        meters_per_unit=facts.meters_per_unit,
        schemas=facts.schemas,
        layers=tuple(layers),
        files=tuple(files),
        missing=tuple(missing),
        outside=tuple(outside_files(interface, (*layers, *files))),
        leaves=_measure(plant, prims[0]) if prims else None,
        crown=_measure_crown(read_crown_facts(crown)) if crown is not None else None,
        branches=measure_branches(read_skeleton(skeleton)) if skeleton is not None else None,
        forest=read_forest(plant) if is_assembly(plant) else None,
    )


def _measure(plant: Usd.Prim, instancer: Usd.Prim) -> LeafInfo:
    read = read_leaves(instancer)
    try:
        wave = None if read.jitter_map is None else read_jitter_map(read.jitter_map)
    except FoliageError:  # it is missing, and `info` lists it so
        return measure_leaves(read.leaves, read.edits, read.jitter_map)
    hold = extents_hold(plant, instancer, read, wave)
    return replace(measure_leaves(read.leaves, read.edits, read.jitter_map), extents_hold=hold)


def _measure_crown(facts: CrownFacts) -> CrownInfo:
    return CrownInfo(
        center_m=facts.center_m,
        radius_m=facts.radius_range_m,
        relief_weight=facts.relief_weight,
        radius_map_px=_face_size(facts.radius_map),
        color_map_px=_face_size(facts.color_map),
    )


def _face_size(cubemap: Path | None) -> int | None:
    if cubemap is None:
        return None
    with unpacked(cubemap) as file:
        return int(read_cubemap(file).pixels.shape[1])


def measure_leaves(leaves: Leaves, edits: LeafEdits = NEUTRAL, jitter_map: Path | None = None) -> LeafInfo:
    """The numbers of leaves."""
    count = len(leaves)
    areas = leaf_area(apply_edits(leaves.parameters, edits)) if count else np.zeros(0)
    ranges = tuple(
        ParameterRange(
            name=name,
            minimum=_triple(column.min(axis=0)),
            mean=_triple(column.mean(axis=0)),
            maximum=_triple(column.max(axis=0)),
        )
        for row, name in enumerate(PARAMETERS)
        if len(column := leaves.parameters[:, row])
    )
    known = [name for name in ("confidence", "residual_m", "view", "origin") if getattr(leaves, name) is not None]
    seen = leaves.view[leaves.view >= 0] if leaves.view is not None else np.zeros(0, np.int32)
    return LeafInfo(
        count=count,
        length_m=_spread(leaves.length_m),
        area_m2=float(np.sum(areas * leaves.length_m**2)),
        parameters=ranges,
        edits=changed_edits(edits),
        jitter_map=file_name(jitter_map) if jitter_map else "",
        confidence=_spread(leaves.confidence),
        residual_m=_spread(leaves.residual_m),
        views=len(np.unique(seen)),
        per_leaf=tuple(name.removesuffix("_m") for name in known),
        extents_hold=None,
        origins=count_origins(leaves),
    )


def _spread(values: NDArray[np.float64] | None) -> Spread | None:
    if values is None or not len(values):
        return None
    return Spread(minimum=float(values.min()), median=float(np.median(values)), maximum=float(values.max()))


def _triple(values: NDArray[np.float64]) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z


def format_info(info: AssetInfo) -> str:
    """Aligned lines for people."""
    rows = [("asset", f"{info.name} ({info.asset})")]
    if info.look:
        rows.append(("look", info.look))
    rows.append(("generator", info.generator or "unknown"))
    rows += [(name, text) for name, text in (("species", info.species), ("capture", info.capture)) if text]
    rows.append(("up axis, unit", f"{info.up_axis}, {info.meters_per_unit:g} m"))
    if info.extent is not None:
        low, high = info.extent
        size = " x ".join(f"{b - a:.4g}" for a, b in zip(low, high, strict=True))
        rows.append(("extent", f"{_numbers(low)} to {_numbers(high)} ({size})"))
    for name, variants in info.variants.items():
        chosen = info.selections[name]
        known = ", ".join(f"{each} (selected)" if each == chosen else each for each in variants)
        unknown = f"; none is selected, {chosen} is none of them" if chosen and chosen not in variants else ""
        rows.append((name, known + unknown))
    tiles = list(dict.fromkeys(tile for path in info.schemas if (tile := _tile_of(path.split("/")[2:]))))
    if tiles:
        rows.append(("tiles", f"{len(tiles):,}, whose schemas and layers are like those of {tiles[0]}"))
    rows += [
        ("schema", f"{', '.join(schemas)} on {path}")
        for path, schemas in info.schemas.items()
        if _tile_of(path.split("/")[2:]) in ("", *tiles[:1])
    ]
    if info.leaves is not None:
        rows += _leaf_rows(info.leaves)
    if info.branches is not None:
        rows += branch_rows(info.branches)
    if info.crown is not None:
        rows += _crown_rows(info.crown)
    if info.forest is not None:
        rows += _forest_rows(info.forest)
    rows += [
        ("layer", f"{file.path}, {_size(file.size_bytes)}")
        for file in info.layers
        if _tile_of(file.path.split("/")[1:]) in ("", *tiles[:1])
    ]
    rows += [("file", f"{file.path}, {_size(file.size_bytes)}") for file in info.files]
    rows += [("missing", path) for path in info.missing]
    rows += [("outside", f"{path}, which is not in the asset's folder") for path in info.outside]
    rows.append(("on disk", _size(sum(file.size_bytes for file in (*info.layers, *info.files)))))
    width = max(len(name) for name, _ in rows)
    lines = [printable(f"{name:<{width}}  {text}") for name, text in rows]
    if info.leaves is not None and info.leaves.parameters:
        lines += ["", *_parameter_table(info.leaves.parameters)]
    return "\n".join(lines)


def format_plain_look(look: PlainLook) -> str:
    """Lines for people, of a layer that was not written by usdfoliage."""
    rows = [("look", f"{look.path}, made without usdfoliage")]
    for path, edits in look.prims.items():
        texts = [f"{name} {'is no number' if value is None else show_value(value)}" for name, value in edits.items()]
        rows.append(("edits", f"{path}: {'; '.join(texts)}"))
    advice = "`usdfoliage edit` takes this file as a look and writes one with those that the edits need"
    rows.append(("extents", f"{'of the layer itself' if look.has_extents else 'none'}: {advice}"))
    return "\n".join(printable(f"{name:<7}  {text}") for name, text in rows)


def _leaf_rows(leaves: LeafInfo) -> list[tuple[str, str]]:
    rows = [("leaves", f"{leaves.count:,}")]
    if by_origin := describe_origins(leaves.origins):
        rows.append(("by origin", by_origin))
    if leaves.length_m is not None:
        rows.append(("length", f"{_spread_text(leaves.length_m)} m"))
        rows.append(("area", f"{leaves.area_m2:.4g} m²"))
    edits = "; ".join(f"{name} {show_value(value)}" for name, value in leaves.edits.items())
    rows.append(("edits", edits or "none"))
    if leaves.extents_hold is False:
        rows.append(("extents", "too small for these edits: `usdfoliage edit` takes this look and writes wider ones"))
    if leaves.jitter_map:
        rows.append(("jitter map", leaves.jitter_map))
    if leaves.confidence is not None:
        rows.append(("confidence", _spread_text(leaves.confidence)))
    if leaves.residual_m is not None:
        rows.append(("residual", f"{_spread_text(leaves.residual_m)} m"))
    if leaves.views:
        rows.append(("seen in", f"{leaves.views} photograph{'' if leaves.views == 1 else 's'}"))
    return rows


def _crown_rows(crown: CrownInfo) -> list[tuple[str, str]]:
    low, high = crown.radius_m
    maps = (("radius map", crown.radius_map_px), ("colour map", crown.color_map_px))
    return [
        ("crown", f"radius {low:.4g} to {high:.4g} m about {_numbers(crown.center_m)}, relief {crown.relief_weight:g}"),
        *((name, f"6 faces of {px} x {px}" if px else "missing") for name, px in maps),
    ]


def _forest_rows(forest: ForestInfo) -> list[tuple[str, str]]:
    near_m, far_m = forest.lod_distance_m
    return [
        ("terrain", f"{forest.terrain_faces:,} faces"),
        ("plants", ", ".join(f"{count:,} in the level {level}" for level, count in forest.levels.items()) or "none"),
        *((species, f"{count:,}") for species, count in forest.plants.items()),
        ("lod distance", f"{near_m:g} to {far_m:g} m, seed {forest.seed}"),
    ]


def _parameter_table(ranges: Sequence[ParameterRange]) -> list[str]:
    """The parameters as they are stored, in leaf lengths."""
    header = f"{'':<12}{'smallest':^27}{'mean':^27}{'largest':^27}".rstrip()
    lines = [header]
    for each in ranges:
        cells = "".join(
            "".join(f"{number:>9.4f}" for number in triple) for triple in (each.minimum, each.mean, each.maximum)
        )
        lines.append(f"{each.name:<12}{cells}")
    return lines


def _spread_text(spread: Spread) -> str:
    return f"{spread.minimum:.4g} to {spread.maximum:.4g}, median {spread.median:.4g}"


def _numbers(numbers: Sequence[float]) -> str:
    return f"({', '.join(f'{number:.4g}' for number in numbers)})"


def _tile_of(parts: Sequence[str]) -> str:
    """The tile of a forest that a path is in, by its parts from the folder or prim of tiles on; empty for none."""
    return parts[1] if len(parts) > 1 and parts[0] == TILES else ""


def _size(size_bytes: int) -> str:
    for unit, factor in (("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= factor:
            return f"{size_bytes / factor:.1f} {unit}"
    return f"{size_bytes} bytes"
