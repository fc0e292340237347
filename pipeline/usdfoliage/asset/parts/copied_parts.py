"""What a plant's asset holds besides its leaves, copied into a new asset of the same plant.

Layers are copied as they are, whatever wrote them: a surface that somebody worked on stays as it is.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from usdfoliage.asset.layer import save_layer
from usdfoliage.asset.locate import open_copy, open_layer
from usdfoliage.asset.materials.layer import LEAF_MATERIAL, MATERIALS
from usdfoliage.asset.own_files import copy_own, is_own, may_hand_on
from usdfoliage.asset.parts.bare_branches import BARE_LAYER
from usdfoliage.asset.parts.crown_part import CROWN_LAYER
from usdfoliage.asset.parts.leaf_motion import (
    GROWTH_LEAVES,
    RIG_LEAVES,
    DrawnLeaves,
    adapt_leaf_motion,
    adapt_moving_leaves,
)
from usdfoliage.asset.parts.leaf_part import MATERIAL_LAYER
from usdfoliage.asset.parts.part import AssetPlace, Box, Part
from usdfoliage.asset.parts.sway_clips import CLIP_ROOT, LEAF_CLIPS, RIG_CLIPS, clip_files, keep_own_clips
from usdfoliage.asset.plant import BARE_BRANCHES, BRANCHES, CROWN, LEAVES, TO_CROWN, TO_SKELETON
from usdfoliage.asset.stored_numbers import stored_numbers
from usdfoliage.asset.variants import REPRESENTATIONS, VariantSet
from usdfoliage.errors import AssetError

LOD = "lod"
_MOVING = ("rig", "growth")  # variant sets whose layers go over those of the others
_MOTION = frozenset({GROWTH_LEAVES, RIG_LEAVES, LEAF_CLIPS})  # of leaves: copied where it fits
_CLIPS = frozenset({RIG_CLIPS, LEAF_CLIPS})  # layers that name value clips
_TIMES = ("startTimeCode", "endTimeCode", "timeCodesPerSecond", "framesPerSecond")


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherParts:
    """An asset's parts but for its leaves."""

    interface: Path
    name: str  # of its root prim
    shared: Sequence[str]  # layers in every variant, from the payload's folder
    near: Sequence[str] = ()  # of them, those that hold more than guides
    sets: Sequence[VariantSet]  # but the one of the leaves; the selected variant first
    extents_m: Sequence[NDArray[np.float64]]  # (2, 3) each, of what is no guide
    guide_extents_m: Sequence[NDArray[np.float64]]
    crown_m: NDArray[np.float64] | None = None  # (2, 3) around its crown, None where it has none
    bare_m: NDArray[np.float64] | None = None  # (2, 3) around what stands out of its crown, None where nothing does
    far_m: Mapping[str, Box] = field(default_factory=dict)  # boxes of other layers that stand for the plant from afar
    relationships: Mapping[str, str] = field(default_factory=dict)  # as Part has them, but those to leaves and crown
    collections: Mapping[str, Sequence[str]] = field(default_factory=dict)  # of parts of other kinds, likewise
    is_whole: bool = False  # it is of a whole plant (usdfoliage.asset.packages.plant_package)
    lod: str = ""  # the one that is selected, of a whole plant
    thumbnail: Path | None = None
    cards: Mapping[str, Path] = field(default_factory=dict)  # by side, as usdfoliage.asset.packages.cards

    @property
    def has_branches(self) -> bool:
        return TO_SKELETON in self.relationships


def copy_near_part(others: OtherParts, place: AssetPlace, drawn: DrawnLeaves | None) -> Part:
    """Copy the branches and what else of other parts is no crown, with the materials of all.

    Args:
        others: What to copy.
        place: Of the new asset; the payload's folder exists, with the layers of its leaves.
        drawn: The new leaves, which move as the old ones did if they stand where these stood; None for none.

    Raises:
        AssetError: A layer or a picture cannot be read, or a file cannot be written.
    """
    if drawn is None or not _fits_motion(others, place, drawn):
        others = _without_motion(others)
    layers = {
        *others.shared,
        *(layer for variant_set in others.sets for each in variant_set.variants.values() for layer in each),
    }
    moving_m = _copy_layers(others, layers, place, drawn)
    number = next((number for number, variant_set in enumerate(others.sets) if variant_set.name == LOD), None)
    if number is None:
        moving = [variant_set for variant_set in others.sets if variant_set.name in _MOVING]
        still = [variant_set for variant_set in others.sets if variant_set.name not in _MOVING]
    else:
        moving, still = list(others.sets[:number]), list(others.sets[number + 1 :])
    return Part(
        relationships=others.relationships,
        collections={**({"branches": [BRANCHES]} if others.has_branches else {}), **others.collections},
        materials=[_MaterialCopy(others, place)],
        guides=[layer for layer in others.shared if layer not in others.near],
        near=[layer for layer in others.shared if layer in others.near],
        near_m=[*others.extents_m, *moving_m],
        guides_m=others.guide_extents_m,
        moving=moving,
        still=still,
        lods=None if number is None else others.sets[number],
        times=_times(open_layer(others.interface)),
        lod=others.lod,
    )


def copy_far_part(others: OtherParts, place: AssetPlace) -> Part:
    """Copy the crown of other parts, and what stands out of it; nothing where they have none.

    Raises:
        AssetError: A layer or a picture cannot be read, or a file cannot be written.
    """
    boxes = {BARE_LAYER: others.bare_m, CROWN_LAYER: others.crown_m}
    layers = {f"./{layer}": box for layer, box in boxes.items() if box is not None} | dict(others.far_m)
    _copy_layers(others, layers.keys(), place, None)
    return Part(
        relationships={TO_CROWN: CROWN} if others.crown_m is not None else {},
        collections={
            **({"branches": [BARE_BRANCHES]} if others.bare_m is not None and others.has_branches else {}),
            **({"crown": [CROWN]} if others.crown_m is not None else {}),
        },
        far=list(layers),
        far_m=list(layers.values()),
    )


def lost_leaf_motion(others: OtherParts, folder: Path) -> bool:
    """Whether leaves that followed their branches do not in the asset in folder, which copy_near_part was copied to."""
    source = others.interface.parent / "payload"
    return any((source / layer).is_file() and not (folder / "payload" / layer).exists() for layer in _MOTION)


def _fits_motion(others: OtherParts, place: AssetPlace, drawn: DrawnLeaves) -> bool:
    """Whether the motion of the old leaves fits the new ones: they stand in the same places, in the same divisions."""
    source, payload, name = others.interface.parent / "payload", place.payload, place.name
    old, new = Sdf.Path(f"/{others.name}/{LEAVES}"), Sdf.Path(f"/{name}/{LEAVES}")
    for representation in drawn.representations:
        layer = REPRESENTATIONS[representation]
        if not (source / layer).is_file():
            return False
        is_surface = representation in ("mesh", "subdiv")
        if is_surface and len(_read_points(source / layer, old)) != len(drawn.surface_points(representation)):
            return False
    if "bezier" not in drawn.representations:
        return False
    before, after = (open_copy(path / REPRESENTATIONS["bezier"]) for path in (source, payload))
    for attribute in ("positions", "scales", "orientationsf"):
        was, now = (
            layer.GetAttributeAtPath(path.AppendProperty(attribute)) for layer, path in ((before, old), (after, new))
        )
        if was is None or now is None or not np.array_equal(np.array(was.default), np.array(now.default)):
            return False
    return True


def _read_points(layer: Path, path: Sdf.Path) -> NDArray[np.float64]:
    """Points (P, 3) of the prim at path in a layer of ours; none where it has none."""
    copy = open_copy(layer)  # kept in a variable: USD drops a layer that nothing refers to
    points = copy.GetAttributeAtPath(path.AppendProperty("points"))
    points_m = None if points is None else stored_numbers(points.default, (None, 3))
    return np.zeros((0, 3)) if points_m is None else points_m


def _without_motion(others: OtherParts) -> OtherParts:
    """The same parts without the layers that move leaves."""
    sets = [
        replace(
            variant_set,
            variants={
                name: [layer for layer in layers if layer.removeprefix("./") not in _MOTION]
                for name, layers in variant_set.variants.items()
            },
        )
        for variant_set in others.sets
    ]
    return replace(others, sets=sets)


def _copy_layers(others: OtherParts, layers: Iterable[str], place: AssetPlace, drawn: DrawnLeaves | None) -> list[Box]:
    """Copy layers, and the pictures that they name; returns boxes around leaves where they move."""
    boxes = []
    source = others.interface.parent / "payload"
    for layer in sorted(layers):
        _check_layer(others.interface, source, layer)
        copied = _open_renamed(source / layer, others.name, place.name)
        _copy_pictures(copied, Sdf.Path.absoluteRootPath, source, place.payload)
        file = layer.removeprefix("./")
        if file in _CLIPS:
            keep_own_clips(copied, place.name, file, () if drawn is None else drawn.representations)
            boxes += _copy_clips(others.interface, file, place, drawn)
        elif drawn is not None and file in _MOTION:
            boxes += adapt_leaf_motion(copied, place.name, drawn)
        save_layer(copied, place.payload / layer)
    return boxes


def _copy_clips(interface: Path, layer: str, place: AssetPlace, drawn: DrawnLeaves | None) -> list[Box]:
    """Copy the value clips that a layer of ours names; returns boxes around leaves that move in them."""
    source = interface.parent / "payload"
    boxes = []
    for file in clip_files(layer):
        _check_layer(interface, source, file)
        copied = open_copy(source / file)
        if drawn is not None and layer == LEAF_CLIPS and file.endswith(".usdc"):
            boxes += adapt_moving_leaves(copied, Sdf.Path(f"/{CLIP_ROOT}/{LEAVES}"), drawn)
        (place.payload / file).parent.mkdir(exist_ok=True)
        save_layer(copied, place.payload / file)
    return boxes


@dataclass(frozen=True)
class _MaterialCopy:
    """Copies the materials of other parts, but that of leaves, beside those that there are."""

    others: OtherParts
    place: AssetPlace

    def __call__(self, stage: Usd.Stage, root: Sdf.Path) -> None:
        source = self.others.interface.parent / "payload"
        old, new = _open_renamed(source / MATERIAL_LAYER, self.others.name, root.name), stage.GetRootLayer()
        scope = old.GetPrimAtPath(root.AppendPath(MATERIALS))
        for material in scope.nameChildren if scope else ():
            if material.path != root.AppendPath(LEAF_MATERIAL) and not new.GetPrimAtPath(material.path):
                Sdf.CopySpec(old, material.path, new, material.path)
                _copy_pictures(old, material.path, source, self.place.payload)


def _times(layer: Sdf.Layer) -> dict[str, float]:
    """The range of time of a layer, as far as it has one."""
    return {name: layer.pseudoRoot.GetInfo(name) for name in _TIMES if layer.pseudoRoot.HasInfo(name)}


def _open_renamed(path: Path, old: str, new: str) -> Sdf.Layer:
    """A copy of a layer, in memory, whose root prim has another name; what points into it follows."""
    layer = open_copy(path)
    if old != new and layer.GetPrimAtPath(f"/{old}"):
        if old not in layer.rootPrims:
            raise AssetError(f"{path} is damaged: it holds </{old}> and does not list it", "write the asset again")
        Sdf.CopySpec(layer, f"/{old}", layer, f"/{new}")
        del layer.rootPrims[old]
        layer.defaultPrim = new
    return layer


def _check_layer(interface: Path, payload: Path, layer: str) -> None:
    """AssetError for a layer that is not in the payload's folder: its copy would be written elsewhere too."""
    if not (_is_inside(payload / layer, payload) and is_own(payload / layer, [interface.parent])):
        raise AssetError(
            f"{interface} refers to {layer}, which lies outside its folder and is never copied",
            "write the asset again",
        )


def _is_inside(path: Path, folder: Path) -> bool:
    """Whether a path is in a folder by its names alone."""
    return os.path.normpath(path).startswith(f"{os.path.normpath(folder)}{os.sep}")


def _copy_pictures(layer: Sdf.Layer, root: Sdf.Path, source: Path, target: Path) -> None:
    """Copy the pictures and shaders of the asset that attributes below root name, and nothing else.

    Source and target are the payloads' folders. usdfoliage.asset.packages.contents.files_left_out lists the others.
    """
    named: set[str] = set()

    def note_file(path: Sdf.Path) -> None:
        spec = layer.GetObjectAtPath(path) if path.IsPropertyPath() else None
        if isinstance(spec, Sdf.AttributeSpec) and isinstance(spec.default, Sdf.AssetPath):
            named.add(spec.default.path)

    layer.Traverse(root, note_file)
    for name in sorted(named):
        if not _is_inside(source / name, source.parent) or (target / name).exists():
            continue
        if may_hand_on(source / name, source.parent):
            copy_own(source / name, target / name)
