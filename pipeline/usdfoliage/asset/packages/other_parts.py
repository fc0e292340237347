"""What a plant holds besides its leaves, carried over into an asset of the same plant with other leaves.

Layers are copied as they are, whatever wrote them: a surface that somebody worked on stays as it is.
"""

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdMedia

from usdfoliage.asset.layer import save_layer
from usdfoliage.asset.locate import find_interface, find_plants, open_copy, open_layer
from usdfoliage.asset.look_layer import REPRESENTATION
from usdfoliage.asset.materials.layer import LEAF_MATERIAL, MATERIALS
from usdfoliage.asset.packages.interface import PAYLOAD
from usdfoliage.asset.packages.leaf_package import (
    CROWN_LAYER,
    LEAVES_GUIDE,
    MATERIAL_LAYER,
    LeafAssetSettings,
    LeafLook,
    begin_asset,
    finish_asset,
    leaf_jitter,
    write_leaf_layers,
)
from usdfoliage.asset.packed_files import is_package
from usdfoliage.asset.parts.bare_branches import BARE_LAYER
from usdfoliage.asset.parts.leaf_motion import GROWTH_LEAVES, RIG_LEAVES, DrawnLeaves, adapt_leaf_motion, read_points
from usdfoliage.asset.parts.leaf_primvars import place
from usdfoliage.asset.plant import (
    BARE_BRANCHES,
    BRANCHES,
    COLLECTIONS,
    CROWN,
    LEAVES,
    SKELETON,
    Plant,
    box_around,
)
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.stored_numbers import stored_numbers
from usdfoliage.asset.variants import REPRESENTATIONS, VariantSet
from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits

_OF_LEAVES = {*REPRESENTATIONS.values(), LEAVES_GUIDE, MATERIAL_LAYER}  # written anew
_MOTION = frozenset({GROWTH_LEAVES, RIG_LEAVES})  # of leaves: carried over where it fits
_TIMES = ("startTimeCode", "endTimeCode", "timeCodesPerSecond", "framesPerSecond")


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherParts:
    """An asset's parts but for its leaves."""

    interface: Path
    name: str  # of its root prim
    shared: Sequence[str]  # layers in every variant, from the payload's folder
    sets: Sequence[VariantSet]  # but the one of the leaves; the selected variant first
    parts: Sequence[str]
    extents_m: Sequence[NDArray[np.float64]]  # (2, 3) each, of what is no guide
    guide_extents_m: Sequence[NDArray[np.float64]]
    crown_m: NDArray[np.float64] | None = None  # (2, 3) around its crown, None where it has none
    bare_m: NDArray[np.float64] | None = None  # (2, 3) around what stands out of its crown, None where nothing does
    is_whole: bool = False  # it is of a whole plant (usdfoliage.asset.packages.plant_package)
    lod: str = ""  # the one that is selected, of a whole plant
    thumbnail: Path | None = None

    @property
    def has_branches(self) -> bool:
        return bool(self.parts)


def read_other_parts(asset: Path) -> OtherParts | None:
    """What the plant of an asset, named by its folder or its interface layer, has besides leaves.

    Raises:
        AssetError: It cannot be read, or is no asset of ours.
    """
    interface = find_interface(asset)
    stage = Usd.Stage.Open(open_layer(interface))
    plants = find_plants(stage)
    if len(plants) != 1:
        raise AssetError(f"{asset} holds {len(plants)} plants; name the asset of one")
    return find_other_parts(plants[0], interface)


def find_other_parts(plant: Usd.Prim, interface: Path) -> OtherParts | None:
    """What a plant has besides leaves, in its asset's layers; None where it is none of a whole plant and has no
    branches.

    Raises:
        AssetError: The plant has branches or a crown, but interface has no payload layer as ours have.
    """
    stage, name = plant.GetStage(), plant.GetName()
    branches, skeleton = (stage.GetPrimAtPath(plant.GetPath().AppendPath(part)) for part in (BRANCHES, SKELETON))
    is_whole = any(plant.HasAPI(Usd.CollectionAPI, part) for part in COLLECTIONS)
    if not branches and not skeleton and not is_whole:
        return None
    layer = interface.parent / PAYLOAD
    held = open_layer(layer).GetPrimAtPath(f"/{name}") if layer.is_file() else None
    if held is None:
        if is_package(interface):
            raise AssetError(f"{interface} is a package; unpack it, as any zip file, and name the folder")
        raise AssetError(
            f"<{plant.GetPath()}> has branches besides its leaves, and {interface} is not their asset; name its folder"
        )
    if is_whole:
        return _parts_of_whole(plant, interface, held)
    root = open_layer(interface).GetPrimAtPath(f"/{name}")
    selected = dict(root.variantSelections) if root else {}
    names = list(held.variantSetNameList.prependedItems)
    sets = [_read_set(held, each, selected.get(each, "")) for each in names]
    surfaces = _surface_extents(interface.parent / "payload", name, sets) or _extents(branches)
    return OtherParts(
        interface=interface,
        name=name,
        shared=_layers(held),
        sets=sets,
        parts=(SKELETON,) if skeleton else (),
        extents_m=[*surfaces, *(_hint(plant) if {"rig", "growth"} & set(names) else [])],
        guide_extents_m=_extents(skeleton),
    )


def _parts_of_whole(plant: Usd.Prim, interface: Path, held: Sdf.PrimSpec) -> OtherParts:
    """The parts of a whole plant, whichever of its lods is selected; its sets as they are in an asset of branches."""
    name = plant.GetName()
    root = open_layer(interface).GetPrimAtPath(f"/{name}")
    selected = dict(root.variantSelections) if root else {}
    lods = {each: variant.primSpec for each, variant in _variants(held, "lod").items()}
    near = lods.get("leaves")
    names = list(near.variantSetNameList.prependedItems) if near is not None else []
    sets = [_read_set(near, each, selected.get(each, "")) for each in names if each != REPRESENTATION]
    shared = _layers(near) if near is not None else []
    payload = interface.parent / "payload"
    extents = _surface_extents(payload, name, sets)
    guides = [_layer_extent(payload / layer, f"/{name}/{SKELETON}") for layer in shared]
    if {"rig", "growth"} & {each.name for each in sets}:  # what moves goes farther than its extents at rest
        shown = _variants(root, "lod").get("leaves")
        hint = shown.primSpec.attributes.get("extentsHint") if shown is not None else None
        if hint is not None and hint.default is not None:
            extents.append(_box(hint.default[:2], f"{interface} <{root.path}>"))
    crown = f"./{CROWN_LAYER}"
    has_crown, has_bare = (
        any(layer in _layers(spec) for spec in lods.values()) for layer in (crown, f"./{BARE_LAYER}")
    )
    thumbnail = UsdMedia.AssetPreviewsAPI(plant).GetDefaultThumbnails()
    picture = interface.parent / thumbnail.defaultImage.path if thumbnail is not None else None
    return OtherParts(
        interface=interface,
        name=name,
        shared=shared,
        sets=sets,
        parts=(SKELETON,) if any(each.name == "branches" for each in sets) else (),
        extents_m=extents,
        guide_extents_m=[box for box in guides if box is not None],
        crown_m=_layer_extent(payload / CROWN_LAYER, f"/{name}/{CROWN}") if has_crown else None,
        bare_m=_layer_extent(payload / BARE_LAYER, f"/{name}/{BARE_BRANCHES}") if has_bare else None,
        is_whole=True,
        lod=selected.get("lod", ""),
        thumbnail=picture if picture is not None and picture.is_file() else None,
    )


def _surface_extents(payload: Path, name: str, sets: Sequence[VariantSet]) -> list[NDArray[np.float64]]:
    """Of every surface of the branches: hints hold whichever is selected, and coarser ones reach out of the finer."""
    layers = [layer for each in sets if each.name == "branches" for some in each.variants.values() for layer in some]
    boxes = [_layer_extent(payload / layer, f"/{name}/{BRANCHES}") for layer in layers]
    return [box for box in boxes if box is not None]


def _layer_extent(path: Path, prim: str) -> NDArray[np.float64] | None:
    layer = open_layer(path)
    extent = layer.GetAttributeAtPath(f"{prim}.extent")
    return None if extent is None or extent.default is None else _box(extent.default, f"{path} <{prim}>")


def write_leaves_beside(
    folder: Path,
    name: str,
    leaves: Leaves,
    others: OtherParts,
    provenance: Provenance,
    settings: LeafAssetSettings = LeafAssetSettings(),
    edits: LeafEdits = NEUTRAL,
    look: LeafLook = LeafLook(),
    asset_from_capture: NDArray[np.float64] | None = None,
) -> Path:
    """Write an asset of these leaves and another's other parts, as leaf_package.write_leaf_asset.

    Raises:
        AssetError: Besides what that raises it for, a layer or a picture of the other parts cannot be read.
    """
    payload = begin_asset(folder, name)
    layers = write_leaf_layers(folder, name, leaves, settings, edits, look)
    if not fits_motion(others, payload, name, settings.representations):
        others = without_motion(others)
    drawn = DrawnLeaves(
        payload=payload,
        leaves=leaves,
        representations=settings.representations,
        edits=edits,
        jitter=leaf_jitter(edits, look),
    )
    moving = copy_layers(others, payload, name, drawn)
    guides = [*others.guide_extents_m, *([] if layers.guide_extent_m is None else [layers.guide_extent_m])]
    plant = Plant(
        provenance=provenance,
        asset_from_capture=np.eye(4) if asset_from_capture is None else asset_from_capture,
        # Of no leaves too: their prims have an extent all the same, at the origin.
        extent_m=box_around([*others.extents_m, layers.extent_m, *moving]),
        guide_extent_m=box_around(guides) if guides else None,
        parts=[*layers.parts, *others.parts],
        version=settings.version,
    )
    # The representations lie in the lod before them; what moves has to stay before both.
    before = next((number for number, held in enumerate(others.sets) if held.name == "lod"), 0) + 1
    shared = [f"./{MATERIAL_LAYER}", *others.shared]
    interface = finish_asset(
        folder, name, plant, [*others.sets[:before], layers.variants, *others.sets[before:]], shared
    )
    for path in (interface, folder / PAYLOAD):
        keep_times(open_layer(others.interface), path)
    return interface


def lost_leaf_motion(others: OtherParts, folder: Path) -> bool:
    """Whether leaves that followed their branches do not in the asset that write_leaves_beside wrote to folder."""
    source = others.interface.parent / "payload"
    return any((source / layer).is_file() and not (folder / "payload" / layer).exists() for layer in _MOTION)


def fits_motion(others: OtherParts, payload: Path, name: str, representations: Sequence[str]) -> bool:
    """Whether leaves that were written stand where the old ones did, and are divided alike: as those moved, they do."""
    source = others.interface.parent / "payload"
    old, new = Sdf.Path(f"/{others.name}/{LEAVES}"), Sdf.Path(f"/{name}/{LEAVES}")
    for representation in representations:
        layer = REPRESENTATIONS[representation]
        if not (source / layer).is_file():
            return False
        if representation in ("mesh", "subdiv") and len(read_points(source / layer, old)) != len(
            read_points(payload / layer, new)
        ):
            return False
    if "bezier" not in representations:
        return False
    before, after = (open_copy(path / REPRESENTATIONS["bezier"]) for path in (source, payload))
    for field in ("positions", "scales", "orientationsf"):
        was, now = (
            layer.GetAttributeAtPath(path.AppendProperty(field)) for layer, path in ((before, old), (after, new))
        )
        if was is None or now is None or not np.array_equal(np.array(was.default), np.array(now.default)):
            return False
    return True


def without_motion(others: OtherParts) -> OtherParts:
    """The same parts without the layers that move leaves."""
    sets = [
        replace(
            held,
            variants={
                name: [layer for layer in layers if layer.removeprefix("./") not in _MOTION]
                for name, layers in held.variants.items()
            },
        )
        for held in others.sets
    ]
    return replace(others, sets=sets)


def copy_layers(others: OtherParts, payload: Path, name: str, drawn: DrawnLeaves | None) -> list[NDArray[np.float64]]:
    """Copy the layers of other parts, and the pictures that they name, for the root prim /name.

    Args:
        others: What to copy; without_motion where there are no leaves.
        payload: The folder of the new asset's payload, which has its materials layer.
        name: Of the new root prim.
        drawn: The new leaves.

    Returns:
        Boxes (2, 3) around the leaves where they move.
    """
    boxes = []
    source = others.interface.parent / "payload"
    layers = {*others.shared, *(layer for held in others.sets for each in held.variants.values() for layer in each)}
    layers |= {f"./{CROWN_LAYER}"} if others.crown_m is not None else set()
    layers |= {f"./{BARE_LAYER}"} if others.bare_m is not None else set()
    for layer in sorted(layers):
        copied = _open_renamed(source / layer, others.name, name)
        _copy_pictures(copied, Sdf.Path.absoluteRootPath, source, payload)
        if drawn is not None and layer.removeprefix("./") in _MOTION:
            boxes += adapt_leaf_motion(copied, name, drawn)
        save_layer(copied, payload / layer)
    old = _open_renamed(source / MATERIAL_LAYER, others.name, name)
    new = open_copy(payload / MATERIAL_LAYER)
    scope = old.GetPrimAtPath(f"/{name}/{MATERIALS}")
    for material in scope.nameChildren if scope else ():
        if material.path != Sdf.Path(f"/{name}/{LEAF_MATERIAL}") and not new.GetPrimAtPath(material.path):
            Sdf.CopySpec(old, material.path, new, material.path)
            _copy_pictures(old, material.path, source, payload)
    save_layer(new, payload / MATERIAL_LAYER)
    return boxes


def _read_set(held: Sdf.PrimSpec, name: str, selected: str) -> VariantSet:
    variants = _variants(held, name)
    names = sorted(variants.keys(), key=lambda each: (each != selected, each))
    return VariantSet(name=name, variants={each: _layers(variants[each].primSpec) for each in names})


def _variants(prim: Sdf.PrimSpec, name: str) -> dict[str, Sdf.VariantSpec]:
    if name not in prim.variantSets:
        layer = prim.layer
        raise AssetError(f"{layer.realPath} <{prim.path}> has no variant set {name}; write the asset again")
    return dict(prim.variantSets[name].variants.items())


def _layers(prim: Sdf.PrimSpec) -> list[str]:
    """The layers that a prim refers to, but those of leaves."""
    named = [reference.assetPath for reference in prim.referenceList.prependedItems]
    return [layer for layer in named if layer and layer.removeprefix("./") not in _OF_LEAVES]


def _extents(prim: Usd.Prim) -> list[NDArray[np.float64]]:
    held = UsdGeom.Boundable(prim).GetExtentAttr().Get() if prim else None
    return [] if held is None else [_box(held, place(prim))]


def _box(extent: object, where: str) -> NDArray[np.float64]:
    """An extent as a box (2, 3); AssetError for what is none, which would make hints of the new asset wrong."""
    corners = stored_numbers(extent, (2, 3))
    if corners is None or not np.isfinite(corners).all():
        raise AssetError(f"the extent of {where} is no two corners of a box; compute it again")
    return corners


def _hint(plant: Usd.Prim) -> list[NDArray[np.float64]]:
    """The box of what is no guide, as the plant has it: what moves goes farther than its extents at rest."""
    held = UsdGeom.ModelAPI(plant).GetExtentsHint()
    return [_box(held[:2], place(plant))] if held else []


def _open_renamed(path: Path, old: str, new: str) -> Sdf.Layer:
    """A copy of a layer, in memory, whose root prim has another name; what points into it follows."""
    layer = open_copy(path)
    if old != new and layer.GetPrimAtPath(f"/{old}"):
        if old not in layer.rootPrims:
            raise AssetError(f"{path} is damaged: it holds </{old}> and does not list it; write the asset again")
        Sdf.CopySpec(layer, f"/{old}", layer, f"/{new}")
        del layer.rootPrims[old]
        layer.defaultPrim = new
    return layer


def _copy_pictures(layer: Sdf.Layer, root: Sdf.Path, source: Path, target: Path) -> None:
    """Copy the files of the asset that attributes below root name; source and target are the payloads' folders."""
    named: set[str] = set()

    def look(path: Sdf.Path) -> None:
        held = layer.GetObjectAtPath(path) if path.IsPropertyPath() else None
        if isinstance(held, Sdf.AttributeSpec) and isinstance(held.default, Sdf.AssetPath):
            named.add(held.default.path)

    layer.Traverse(root, look)
    for name in sorted(named):
        inside = os.path.normpath(source / name).startswith(f"{os.path.normpath(source.parent)}{os.sep}")
        if inside and (source / name).is_file() and not (target / name).exists():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            try:
                shutil.copyfile(source / name, target / name)
            except OSError as error:
                raise AssetError(f"{source / name} cannot be copied into the asset: {error.strerror}") from error


def keep_times(old: Sdf.Layer, path: Path) -> None:
    """Give a layer the range of time that another has."""
    known = [field for field in _TIMES if old.pseudoRoot.HasInfo(field)]
    if known:
        layer = open_copy(path)
        for field in known:
            layer.pseudoRoot.SetInfo(field, old.pseudoRoot.GetInfo(field))
        save_layer(layer, path)
