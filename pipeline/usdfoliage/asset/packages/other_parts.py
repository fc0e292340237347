"""What a plant holds besides its leaves, read from its asset to be copied into another one with other leaves."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdMedia

from usdfoliage.asset.locate import find_interface, find_plants, open_layer
from usdfoliage.asset.look_layer import REPRESENTATION
from usdfoliage.asset.own_files import may_hand_on
from usdfoliage.asset.packages.assembly import Origin, begin_asset, write_asset
from usdfoliage.asset.packages.cards import read_cards
from usdfoliage.asset.packages.interface import PAYLOAD
from usdfoliage.asset.packed_files import is_package
from usdfoliage.asset.parts.bare_branches import BARE_LAYER
from usdfoliage.asset.parts.copied_parts import OtherParts, copy_near_part
from usdfoliage.asset.parts.crown_leaves import CROWN_LEAVES
from usdfoliage.asset.parts.crown_part import CROWN_LAYER
from usdfoliage.asset.parts.leaf_part import (
    LEAVES_GUIDE,
    MATERIAL_LAYER,
    BranchLeaves,
    LeafAppearance,
    LeafAssetSettings,
    drawn_leaves,
    write_leaf_part,
)
from usdfoliage.asset.parts.leaf_primvars import place as place_of
from usdfoliage.asset.parts.part import Box
from usdfoliage.asset.plant import (
    BARE_BRANCHES,
    BRANCHES,
    COLLECTIONS,
    CROWN,
    CROWN_HOLDER,
    CROWN_NAME,
    SKELETON,
    TO_CROWN,
    TO_LEAVES,
    TO_SKELETON,
    box_around,
)
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.stored_numbers import stored_numbers
from usdfoliage.asset.variants import REPRESENTATIONS, VariantSet
from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits

_FAR = {CROWN_LAYER, BARE_LAYER}
_OF_LEAVES = {*REPRESENTATIONS.values(), LEAVES_GUIDE, MATERIAL_LAYER}  # written anew


def read_other_parts(asset: Path) -> OtherParts | None:
    """What the plant of an asset, named by its folder or its interface layer, has besides leaves.

    Raises:
        AssetError: It cannot be read, or is no asset of ours.
    """
    interface = find_interface(asset)
    stage = Usd.Stage.Open(open_layer(interface))
    plants = find_plants(stage)
    if len(plants) != 1:
        raise AssetError(f"{asset} holds {len(plants)} plants", "name the asset of one")
    return find_other_parts(plants[0], interface)


def find_other_parts(plant: Usd.Prim, interface: Path) -> OtherParts | None:
    """What a plant has besides leaves, in its asset's layers; None where it is none of a whole plant and has no
    branches.

    Raises:
        AssetError: The plant has branches or a crown, but interface has no payload layer as ours have.
    """
    stage, name = plant.GetStage(), _own_name(plant, interface)
    branches, skeleton = (stage.GetPrimAtPath(plant.GetPath().AppendPath(part)) for part in (BRANCHES, SKELETON))
    is_whole = any(plant.HasAPI(Usd.CollectionAPI, part) for part in COLLECTIONS)
    if not branches and not skeleton and not is_whole:
        return None
    layer = interface.parent / PAYLOAD
    spec = open_layer(layer).GetPrimAtPath(f"/{name}") if layer.is_file() else None
    if spec is None:
        if is_package(interface):
            raise AssetError(f"{interface} is a package", "unpack it, as any zip file, and name the folder")
        raise AssetError(
            f"<{plant.GetPath()}> has branches besides its leaves, and {interface} is not their asset",
            "name its folder",
        )
    if is_whole:
        return _parts_of_whole(plant, interface, spec)
    root = open_layer(interface).GetPrimAtPath(f"/{name}")
    selected = dict(root.variantSelections) if root else {}
    names = list(spec.variantSetNameList.prependedItems)
    sets = [_read_set(spec, each, selected.get(each, "")) for each in names]
    surfaces = _surface_extents(interface.parent / "payload", name, sets) or _extents(branches)
    return OtherParts(
        interface=interface,
        name=name,
        shared=_layers(spec),
        sets=sets,
        relationships={TO_SKELETON: SKELETON} if skeleton else {},
        extents_m=[*surfaces, *(_hint(plant) if {"rig", "growth"} & set(names) else [])],
        guide_extents_m=_extents(skeleton),
    )


def _own_name(plant: Usd.Prim, interface: Path) -> str:
    """The name of the plant in its asset's layers: a look for one placement has it under that one's."""
    return str(open_layer(interface).defaultPrim or plant.GetName())


def _parts_of_whole(plant: Usd.Prim, interface: Path, spec: Sdf.PrimSpec) -> OtherParts:
    """The parts of a whole plant, whichever of its lods is selected; its sets as they are in an asset of branches."""
    name = _own_name(plant, interface)
    root = open_layer(interface).GetPrimAtPath(f"/{name}")
    selected = dict(root.variantSelections) if root else {}
    lods = {each: variant.primSpec for each, variant in _variants(spec, "lod").items()}
    near = lods.get("leaves")
    names = list(near.variantSetNameList.prependedItems) if near is not None else []
    sets = [_read_set(near, each, selected.get(each, "")) for each in names if each != REPRESENTATION]
    shared = _layers(near) if near is not None else []
    payload = interface.parent / "payload"
    extents = _surface_extents(payload, name, sets)
    guides = {layer: _layer_extent(payload / layer, f"/{name}/{SKELETON}") for layer in shared}
    others = {layer: _bounds(payload / layer, name) for layer, box in guides.items() if box is None}
    extents += [box for box, _ in others.values() if box is not None]
    if {"rig", "growth"} & {each.name for each in sets}:  # what moves goes farther than its extents at rest
        with_leaves = _variants(root, "lod").get("leaves")
        hint = with_leaves.primSpec.attributes.get("extentsHint") if with_leaves is not None else None
        if hint is not None and hint.default is not None:
            extents.append(_box(hint.default[:2], f"{interface} <{root.path}>"))
    crown = f"./{CROWN_LAYER}"
    has_crown, has_bare = (
        any(layer in _layers(spec) for spec in lods.values()) for layer in (crown, f"./{BARE_LAYER}")
    )
    thumbnail = UsdMedia.AssetPreviewsAPI(plant).GetDefaultThumbnails()
    picture = interface.parent / thumbnail.defaultImage.path if thumbnail is not None else None
    cards = read_cards(plant, interface.parent)
    return OtherParts(
        interface=interface,
        name=name,
        shared=shared,
        sets=sets,
        near=[layer for layer, (box, _) in others.items() if box is not None],
        extents_m=extents,
        guide_extents_m=[box for box in (*guides.values(), *(box for _, box in others.values())) if box is not None],
        crown_m=_crown_extent(payload / CROWN_LAYER, name) if has_crown else None,
        bare_m=_layer_extent(payload / BARE_LAYER, f"/{name}/{BARE_BRANCHES}") if has_bare else None,
        far_m=_other_far_boxes(lods, payload, name),
        relationships=_other_relationships(plant)
        | ({TO_SKELETON: SKELETON} if any(each.name == "branches" for each in sets) else {}),
        collections=_other_collections(plant),
        is_whole=True,
        lod=selected.get("lod", ""),
        thumbnail=picture if picture is not None and may_hand_on(picture, interface.parent) else None,
        cards=cards if all(may_hand_on(card, interface.parent) for card in cards.values()) else {},
    )


def _bounds(path: Path, name: str) -> tuple[Box | None, Box | None]:
    """Boxes around what a layer holds that is no guide, and around its guides; None for nothing."""
    stage = Usd.Stage.Open(open_layer(path))
    root = stage.GetPrimAtPath(f"/{name}")
    seen = UsdGeom.Tokens.default_, UsdGeom.Tokens.render, UsdGeom.Tokens.proxy
    boxes = []
    for purposes in (seen, (UsdGeom.Tokens.guide,)):
        bound = UsdGeom.BBoxCache(Usd.TimeCode.Default(), list(purposes)).ComputeWorldBound(root) if root else None
        around = bound.ComputeAlignedRange() if bound is not None else None
        boxes.append(None if around is None or around.IsEmpty() else np.array([around.GetMin(), around.GetMax()]))
    return boxes[0], boxes[1]


def _other_far_boxes(lods: Mapping[str, Sdf.PrimSpec], payload: Path, name: str) -> dict[str, Box]:
    """What stands for the plant from afar, but its crown and bare branches."""
    layers = _layers(lods["crown"]) if "crown" in lods else []
    boxes = {each: _bounds(payload / each, name)[0] for each in layers if each.removeprefix("./") not in _FAR}
    return {layer: box for layer, box in boxes.items() if box is not None}


def _other_relationships(plant: Usd.Prim) -> dict[str, str]:
    """What the plant names of parts but leaves, skeleton and crown."""
    named = {each.GetName(): each.GetTargets() for each in plant.GetRelationships() if not each.IsCustom()}
    root = plant.GetPath()
    return {
        name: str(targets[0].MakeRelativePath(root))
        for name, targets in named.items()
        if name.startswith("foliage:") and name not in (TO_LEAVES, TO_SKELETON, TO_CROWN)
        if len(targets) == 1 and targets[0].HasPrefix(root) and targets[0] != root
    }


def _other_collections(plant: Usd.Prim) -> dict[str, list[str]]:
    """The members of the plant's collections but those of leaves, branches and crown."""
    root = plant.GetPath()
    return {
        each.GetName(): [
            str(path.MakeRelativePath(root)) for path in each.GetIncludesRel().GetTargets() if path.HasPrefix(root)
        ]
        for each in Usd.CollectionAPI.GetAllCollections(plant)
        if each.GetName() not in COLLECTIONS
    }


def _surface_extents(payload: Path, name: str, sets: Sequence[VariantSet]) -> list[NDArray[np.float64]]:
    """Of every surface of the branches: hints hold whichever is selected, and coarser ones reach out of the finer."""
    layers = [layer for each in sets if each.name == "branches" for some in each.variants.values() for layer in some]
    boxes = [_layer_extent(payload / layer, f"/{name}/{BRANCHES}") for layer in layers]
    return [box for box in boxes if box is not None]


def _layer_extent(path: Path, prim: str) -> NDArray[np.float64] | None:
    """The extent of a prim in a layer; None where it has none."""
    layer = open_layer(path)  # as long as its spec is used
    extent = layer.GetAttributeAtPath(f"{prim}.extent")
    place = Sdf.Path(prim).StripAllVariantSelections()
    return None if extent is None or extent.default is None else _box(extent.default, f"{path} <{place}>")


def _crown_extent(path: Path, name: str) -> NDArray[np.float64] | None:
    """Around a crown in all its forms, or as it is where it has none; None of none."""
    layer = open_layer(path)
    holder = layer.GetPrimAtPath(f"/{name}/{CROWN_HOLDER}")
    forms = [form.path for each in holder.variantSets for form in each.variants] if holder else []
    drawn = [form.AppendChild(prim) for form in forms for prim in (CROWN_NAME, CROWN_LEAVES)]
    boxes = [_layer_extent(path, str(place)) for place in (Sdf.Path(f"/{name}/{CROWN}"), *drawn)]
    known = [box for box in boxes if box is not None]
    return box_around(known) if known else None


def write_leaves_beside(
    folder: Path,
    name: str,
    leaves: Leaves,
    others: OtherParts,
    provenance: Provenance,
    settings: LeafAssetSettings = LeafAssetSettings(),
    edits: LeafEdits = NEUTRAL,
    appearance: LeafAppearance = LeafAppearance(),
    asset_from_capture: NDArray[np.float64] | None = None,
) -> Path:
    """Write an asset of these leaves and another's other parts, as leaf_package.write_leaf_asset.

    Raises:
        AssetError: Besides what that raises it for, a layer or a picture of the other parts cannot be read.
    """
    place = begin_asset(folder, name)
    foliage = BranchLeaves(leaves=leaves, settings=settings, edits=edits, appearance=appearance)
    # Of no leaves too: their prims have an extent all the same, at the origin.
    parts = [write_leaf_part(place, foliage), copy_near_part(others, place, drawn_leaves(foliage))]
    origin = Origin(provenance=provenance, asset_from_capture=asset_from_capture, version=settings.version)
    return write_asset(place, parts, origin)


def _read_set(spec: Sdf.PrimSpec, name: str, selected: str) -> VariantSet:
    variants = _variants(spec, name)
    names = sorted(variants.keys(), key=lambda each: (each != selected, each))
    return VariantSet(name=name, variants={each: _layers(variants[each].primSpec) for each in names})


def _variants(prim: Sdf.PrimSpec, name: str) -> dict[str, Sdf.VariantSpec]:
    if name not in prim.variantSets:
        layer = prim.layer
        raise AssetError(f"{layer.realPath} <{prim.path}> has no variant set {name}", "write the asset again")
    return dict(prim.variantSets[name].variants.items())


def _layers(prim: Sdf.PrimSpec) -> list[str]:
    """The layers that a prim refers to, but those of leaves."""
    named = [reference.assetPath for reference in prim.referenceList.prependedItems]
    return [layer for layer in named if layer and layer.removeprefix("./") not in _OF_LEAVES]


def _extents(prim: Usd.Prim) -> list[NDArray[np.float64]]:
    extent = UsdGeom.Boundable(prim).GetExtentAttr().Get() if prim else None
    return [] if extent is None else [_box(extent, place_of(prim))]


def _box(extent: object, where: str) -> NDArray[np.float64]:
    """An extent as a box (2, 3); AssetError for what is none, which would make hints of the new asset wrong."""
    corners = stored_numbers(extent, (2, 3))
    if corners is None or not np.isfinite(corners).all():
        raise AssetError(f"the extent of {where} is no two corners of a box", "compute it again")
    return corners


def _hint(plant: Usd.Prim) -> list[NDArray[np.float64]]:
    """The box of what is no guide, as the plant has it: what moves goes farther than its extents at rest."""
    hint = UsdGeom.ModelAPI(plant).GetExtentsHint()
    return [_box(hint[:2], place_of(plant))] if hint else []
