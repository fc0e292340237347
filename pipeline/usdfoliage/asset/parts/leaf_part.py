"""Leaves as a part of an asset: a layer for each representation, their pictures, shaders and material."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from usdfoliage.asset.materials.jitter_map import read_jitter_map
from usdfoliage.asset.materials.layer import LEAF_MATERIAL, copy_shaders
from usdfoliage.asset.materials.leaf import LEAF_COLOR, LEAF_SHADERS, LeafMaterial, author_leaf_material
from usdfoliage.asset.parts.leaf_fallbacks import write_cage_layer, write_mesh_layer, write_patches_layer
from usdfoliage.asset.parts.leaf_motion import DrawnLeaves
from usdfoliage.asset.parts.leaves import (
    check_leaves,
    edited_leaves,
    leaves_prim,
    write_leaves_guide_layer,
    write_leaves_layer,
)
from usdfoliage.asset.parts.part import SHADERS, AssetPlace, Box, Part, copy_map, map_file
from usdfoliage.asset.plant import LEAVES, TO_LEAVES, box_around
from usdfoliage.asset.variants import REPRESENTATIONS, VariantSet, check_representations
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.cage import LeafCageSettings, build_leaf_cage
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.mesh import (
    LeafMeshSettings,
    PrototypeSettings,
    build_leaf_mesh,
    silhouette_segments,
)
from usdfoliage.leaf.shape.prototype import choose_prototype

LEAVES_GUIDE = "leaves_guide.usda"
MATERIAL_LAYER = "materials.usda"


@dataclass(frozen=True, kw_only=True)
class LeafAssetSettings:
    """How an asset of leaves is written."""

    representations: Sequence[str] = tuple(REPRESENTATIONS)  # the first one is selected
    prototype: PrototypeSettings | None = None  # with a finer silhouette for fine jitter; None: by what the leaves are
    cage: LeafCageSettings = field(default_factory=LeafCageSettings)
    mesh: LeafMeshSettings = field(default_factory=LeafMeshSettings)
    version: str = "1"  # assetInfo

    def __post_init__(self) -> None:
        check_representations(self.representations)


@dataclass(frozen=True, kw_only=True)
class LeafAppearance:
    """What all leaves of an asset have in common.

    Attributes:
        color: Linear Rec.709, of leaves that have no colour of their own.
        texture: A picture of a leaf in its st, with opacity; it takes the place of the colour.
        texture_color: The median colour of the texture, linear; the leaves' own colours tint it. None: no tint.
        jitter_map: An image whose first row is one cycle of the jitter. None: the built-in wave.
    """

    color: tuple[float, float, float] = LEAF_COLOR
    texture: Path | None = None
    texture_color: tuple[float, float, float] | None = None
    jitter_map: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchLeaves:
    """Leaves of a plant, and how they are written."""

    leaves: Leaves
    settings: LeafAssetSettings = field(default_factory=LeafAssetSettings)
    edits: LeafEdits = NEUTRAL
    appearance: LeafAppearance = field(default_factory=LeafAppearance)


def leaf_texture_file(name: str, source: str) -> str:
    """Where the asset of that name has its copy of the leaves' texture, from its folder; source is a file name."""
    return map_file(_texture_name(name), source)


def write_leaf_part(place: AssetPlace, foliage: BranchLeaves) -> Part:
    """Write leaves into the asset at place.

    Args:
        place: Where; the payload's folder exists.
        foliage: What to write; no leaf is a valid part, whose prims are at the origin.

    Raises:
        ValueError: The leaves have numbers that are no leaves.
        CaptureError: The jitter map cannot be used.
        AssetError: A picture cannot be copied, or a file cannot be written.
    """
    check_leaves(foliage.leaves)
    representations, appearance = foliage.settings.representations, foliage.appearance
    jitter = leaf_jitter(foliage.edits, appearance)  # reads the jitter's map before that is copied
    texture = copy_map(place, _texture_name(place.name), appearance.texture)
    jitter_map = copy_map(place, f"{place.name}_leaf_jitter", appearance.jitter_map)
    boxes = _write_representations(place, foliage, jitter, jitter_map)
    has_guide = "bezier" in representations and len(representations) > 1
    copy_shaders(place.folder / "shaders", LEAF_SHADERS)
    material = LeafMaterial(
        shaders=SHADERS,
        texture=texture or None,
        texture_color=appearance.texture_color,
        color=appearance.color,
        typical_color=_typical_color(foliage.leaves),
        jitter_map=jitter_map or None,
    )
    layers = {representation: [f"./{REPRESENTATIONS[representation]}"] for representation in representations}
    if has_guide:
        source = f"./{REPRESENTATIONS['bezier']}"
        write_leaves_guide_layer(place.payload / LEAVES_GUIDE, place.name, source)
        for representation in layers.keys() - {"bezier"}:
            layers[representation].append(f"./{LEAVES_GUIDE}")
    return Part(
        # Of the other representations none has FoliageLeafAPI there.
        relationships={TO_LEAVES: LEAVES} if "bezier" in representations else {},
        collections={"leaves": [LEAVES]},
        materials=[partial(_author_material, leaf=material)],
        near_m=[box_around(boxes)],
        guides_m=[boxes[representations.index("bezier")]] if has_guide else [],
        inside=[VariantSet(name="representation", variants=layers, inside=("leaves",))],
        detail_m=float(np.median(foliage.leaves.length_m)) if len(foliage.leaves) else None,
    )


def drawn_leaves(foliage: BranchLeaves) -> DrawnLeaves:
    """What the layers of leaves show, for those that move them; CaptureError for a bad jitter map."""
    jitter = leaf_jitter(foliage.edits, foliage.appearance)
    return DrawnLeaves(
        leaves=foliage.leaves,
        surface_points=partial(_surface_points, foliage, jitter),
        representations=foliage.settings.representations,
        edits=foliage.edits,
        jitter=jitter,
    )


def _surface_points(foliage: BranchLeaves, jitter: Jitter, representation: str) -> NDArray[np.float32]:
    """Points (P, 3) of all leaves as mesh or subdiv, leaf by leaf."""
    drawn, settings = edited_leaves(foliage.leaves, foliage.edits), foliage.settings
    if representation == "subdiv":
        return build_leaf_cage(drawn, settings.cage, jitter).points_m
    return build_leaf_mesh(drawn, settings.mesh, jitter).points_m


def leaf_jitter(edits: LeafEdits, appearance: LeafAppearance) -> Jitter:
    """The jitter of edits, by the map of an appearance; CaptureError for a map that cannot be used."""
    return Jitter(
        amplitude=edits.jitter_amplitude,
        frequency=edits.jitter_frequency,
        map=read_jitter_map(appearance.jitter_map) if appearance.jitter_map is not None else None,
    )


def _author_material(stage: Usd.Stage, root: Sdf.Path, leaf: LeafMaterial) -> None:
    author_leaf_material(stage, root.AppendPath(LEAF_MATERIAL), leaf)


def _write_representations(place: AssetPlace, foliage: BranchLeaves, jitter: Jitter, jitter_map: str) -> list[Box]:
    """The layers of the representations; returns the box of each."""
    leaves, settings, color = foliage.leaves, foliage.settings, foliage.appearance.color
    drawn = edited_leaves(leaves, foliage.edits)
    boxes = []
    for representation in settings.representations:
        path = place.payload / REPRESENTATIONS[representation]
        if representation == "bezier":
            division = settings.prototype or choose_prototype(drawn.parameters)
            segments = silhouette_segments(division.silhouette, jitter)
            # Vertices that were placed for smooth silhouettes are too few for jitter.
            finer = segments != division.silhouette
            prototype = replace(division, silhouette=segments, places=None) if finer else division
            prim = leaves_prim(leaves, foliage.edits, jitter, color, jitter_map, prototype)
            boxes.append(write_leaves_layer(path, place.name, prim))
        elif representation == "nurbs":
            boxes.append(write_patches_layer(path, place.name, drawn, jitter, color, jitter_map))
        elif representation == "subdiv":
            cage = build_leaf_cage(drawn, settings.cage, jitter)
            boxes.append(write_cage_layer(path, place.name, cage, drawn, color))
        else:
            mesh = build_leaf_mesh(drawn, settings.mesh, jitter)
            boxes.append(write_mesh_layer(path, place.name, mesh, drawn, color))
    return boxes


def _typical_color(leaves: Leaves) -> tuple[float, float, float] | None:
    """The median of the leaves' own colours, which a few dry leaves do not change; None where they have none."""
    if leaves.color is None or not len(leaves):
        return None
    red, green, blue = map(float, np.median(leaves.color, axis=0))
    return red, green, blue


def _texture_name(name: str) -> str:
    return f"{name}_leaf"
