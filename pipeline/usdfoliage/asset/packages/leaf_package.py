"""A whole asset: every layer, map and shader of its folder."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from usdfoliage.asset.materials.bark import BarkMaterial
from usdfoliage.asset.materials.crown import CROWN_SHADER, CrownMaterial
from usdfoliage.asset.materials.jitter_map import read_jitter_map
from usdfoliage.asset.materials.layer import copy_shaders, write_materials_layer
from usdfoliage.asset.materials.leaf import LEAF_COLOR, LEAF_SHADERS, LeafMaterial
from usdfoliage.asset.packages.interface import write_interface_layer, write_payload_layer
from usdfoliage.asset.parts.crown import crown_prim, write_crown_layer, write_crown_maps
from usdfoliage.asset.parts.leaf_fallbacks import write_cage_layer, write_mesh_layer, write_patches_layer
from usdfoliage.asset.parts.leaves import (
    check_leaves,
    edited_leaves,
    leaves_prim,
    write_leaves_guide_layer,
    write_leaves_layer,
)
from usdfoliage.asset.plant import CROWN, LEAVES, Plant, box_around
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.variants import REPRESENTATIONS, VariantSet
from usdfoliage.crown.model import CrownModel
from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.cage import LeafCageSettings, build_leaf_cage
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.mesh import LeafMeshSettings, PrototypeSettings, build_leaf_mesh, silhouette_segments

SHADERS = "../shaders"  # from the payload's folder
MAPS = "../maps"
LEAVES_GUIDE = "leaves_guide.usda"
CROWN_LAYER = "crown.usdc"
MATERIAL_LAYER = "materials.usda"


@dataclass(frozen=True, kw_only=True)
class AssetSettings:
    """How an asset of a crown is written."""

    crown_mesh_size: int = 129  # vertices along a cube edge: 98,304 quads; odd, so that the poles are vertices
    version: str = "1"  # assetInfo

    def __post_init__(self) -> None:
        if self.crown_mesh_size < 2:
            raise ValueError(f"crown_mesh_size must be at least 2, not {self.crown_mesh_size}")


@dataclass(frozen=True, kw_only=True)
class LeafAssetSettings:
    """How an asset of leaves is written."""

    representations: Sequence[str] = tuple(REPRESENTATIONS)  # the first one is selected
    prototype: PrototypeSettings = field(default_factory=PrototypeSettings)  # with a finer silhouette for fine jitter
    cage: LeafCageSettings = field(default_factory=LeafCageSettings)
    mesh: LeafMeshSettings = field(default_factory=LeafMeshSettings)
    version: str = "1"  # assetInfo

    def __post_init__(self) -> None:
        unknown = [name for name in self.representations if name not in REPRESENTATIONS]
        if unknown or not self.representations or len(set(self.representations)) < len(self.representations):
            raise ValueError(
                f"representations must be one or more of {', '.join(REPRESENTATIONS)}, each once, "
                f"not {', '.join(self.representations) or 'none'}"
            )


@dataclass(frozen=True, kw_only=True)
class LeafLook:
    """What all leaves of an asset look alike in.

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


def write_crown_asset(
    folder: Path,
    name: str,
    crown: CrownModel,
    provenance: Provenance,
    settings: AssetSettings = AssetSettings(),
) -> Path:
    """Write an asset that has a crown and nothing else.

    Call it inside usdfoliage.asset.publish.publish_folder, whose folder takes the asset's place when all is written::

        with publish_folder(out, force=force) as folder:
            write_crown_asset(folder, asset_name(name or out.name), crown, provenance)
            write_report(folder / "report", ...)
        asset = out / f"{asset_name(name or out.name)}.usda"

    Args:
        folder: An existing folder; the asset's files are written into it.
        name: Name of the root prim and of the interface layer, an identifier (usdfoliage.asset.plant.asset_name).
        crown: What to write.
        provenance: The run that made it.
        settings: How fine a mesh, and the asset's version.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier, or the crown is not what CrownModel promises.
        AssetError: A file cannot be written.
    """
    payload = begin_asset(folder, name)
    layers = write_crown_layers(folder, name, crown, settings.crown_mesh_size)
    plant = Plant(
        provenance=provenance,
        asset_from_capture=crown.asset_from_photo,
        extent_m=layers.extent_m,
        parts=(CROWN,),
        version=settings.version,
    )
    write_materials_layer(payload / "materials.usda", name, crown=layers.material)
    return finish_asset(folder, name, plant, [VariantSet(name="lod", variants={"crown": [f"./{CROWN_LAYER}"]})])


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownLayers:
    """What the other layers of an asset must know of its crown."""

    extent_m: NDArray[np.float64]  # (2, 3)
    material: CrownMaterial  # for the materials layer


def write_crown_layers(folder: Path, name: str, crown: CrownModel, mesh_size: int) -> CrownLayers:
    """Write what a crown is in an asset, whatever else it holds, but its material: its layer, maps and shader.

    Errors are those of write_crown_asset; the payload's folder exists.
    """
    # A mesh finer than its map would show the map's texels as facets.
    prim = crown_prim(name, crown, min(mesh_size, crown.radius_m.shape[1]))
    write_crown_maps(folder, name, crown)
    copy_shaders(folder / "shaders", (CROWN_SHADER,))
    write_crown_layer(folder / "payload" / CROWN_LAYER, name, prim)
    material = CrownMaterial(
        color_map=prim.color_map,
        radius_map=prim.radius_map,
        shader=f"{SHADERS}/{CROWN_SHADER}",
        face_size=crown.color.shape[1],
        center_m=(float(prim.center_m[0]), float(prim.center_m[1]), float(prim.center_m[2])),
        radius_range_m=prim.radius_range_m,
    )
    extent_m = np.stack([prim.mesh.points_m.min(axis=0), prim.mesh.points_m.max(axis=0)])
    return CrownLayers(extent_m=extent_m.astype(np.float64), material=material)


def write_leaf_asset(
    folder: Path,
    name: str,
    leaves: Leaves,
    provenance: Provenance,
    settings: LeafAssetSettings = LeafAssetSettings(),
    edits: LeafEdits = NEUTRAL,
    look: LeafLook = LeafLook(),
    asset_from_capture: NDArray[np.float64] | None = None,
) -> Path:
    """Write an asset that has leaves and nothing else, inside publish_folder as write_crown_asset.

    Args:
        folder: An existing folder; the asset's files are written into it.
        name: Name of the root prim and of the interface layer, an identifier (usdfoliage.asset.plant.asset_name).
        leaves: What to write; none is a valid asset.
        provenance: The run that made it.
        settings: Which representations, and how fine.
        edits: Those of all leaves: opinions in bezier, applied in the others.
        look: Colour and pictures, which are copied.
        asset_from_capture: (4, 4) for column vectors; the identity by default.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier, or the leaves have numbers that are no leaves.
        CaptureError: The jitter map cannot be used.
        AssetError: A picture cannot be copied, or a file cannot be written.
    """
    begin_asset(folder, name)
    layers = write_leaf_layers(folder, name, leaves, settings, edits, look)
    plant = Plant(
        provenance=provenance,
        asset_from_capture=np.eye(4) if asset_from_capture is None else asset_from_capture,
        extent_m=layers.extent_m,
        guide_extent_m=layers.guide_extent_m,
        parts=layers.parts,
        version=settings.version,
    )
    return finish_asset(folder, name, plant, [VariantSet(name="lod", variants={"leaves": []}), layers.variants])


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafLayers:
    """What the other layers of an asset must know of its leaves."""

    extent_m: NDArray[np.float64]  # (2, 3), in any representation
    guide_extent_m: NDArray[np.float64] | None  # (2, 3), where the leaves are a guide as well
    parts: Sequence[str]  # of the plant
    variants: VariantSet  # inside the lods that have leaves


def write_leaf_layers(
    folder: Path,
    name: str,
    leaves: Leaves,
    settings: LeafAssetSettings = LeafAssetSettings(),
    edits: LeafEdits = NEUTRAL,
    look: LeafLook = LeafLook(),
    bark: BarkMaterial | None = None,
    crown: CrownMaterial | None = None,
    lods: Sequence[str] = ("leaves",),
) -> LeafLayers:
    """Write what leaves are in an asset, whatever else it holds: their layers, pictures, shaders, and the materials.

    Arguments and errors are those of write_leaf_asset; the payload's folder exists.

    Args:
        bark: Of branches, for the materials layer.
        crown: Of a crown, for the same.
        lods: Those that have leaves.
    """
    check_leaves(leaves)
    payload = folder / "payload"
    jitter = leaf_jitter(edits, look)
    texture = copy_map(folder, f"{name}_leaf", look.texture)
    jitter_map = copy_map(folder, f"{name}_leaf_jitter", look.jitter_map)
    bounds = _write_leaves(payload, name, leaves, edits, jitter, look.color, jitter_map, settings)
    has_guide = "bezier" in settings.representations and len(settings.representations) > 1
    copy_shaders(folder / "shaders", LEAF_SHADERS)
    material = LeafMaterial(
        shaders=SHADERS,
        texture=texture or None,
        texture_color=look.texture_color,
        jitter_map=jitter_map or None,
    )
    write_materials_layer(payload / "materials.usda", name, leaf=material, bark=bark, crown=crown)
    chosen = {representation: [f"./{REPRESENTATIONS[representation]}"] for representation in settings.representations}
    if has_guide:
        write_leaves_guide_layer(payload / LEAVES_GUIDE, name, [*chosen["bezier"], "./materials.usda"])
        for representation in chosen.keys() - {"bezier"}:
            chosen[representation].append(f"./{LEAVES_GUIDE}")
    return LeafLayers(
        extent_m=box_around(bounds),
        guide_extent_m=bounds[settings.representations.index("bezier")] if has_guide else None,
        parts=(LEAVES,) if "bezier" in settings.representations else (),  # of the others none has FoliageLeafAPI there
        variants=VariantSet(name="representation", variants=chosen, inside=lods),
    )


def leaf_jitter(edits: LeafEdits, look: LeafLook) -> Jitter:
    """The jitter of edits, by the map of a look; CaptureError for a map that cannot be used."""
    return Jitter(
        amplitude=edits.jitter_amplitude,
        frequency=edits.jitter_frequency,
        map=read_jitter_map(look.jitter_map) if look.jitter_map is not None else None,
    )


def _write_leaves(
    payload: Path,
    name: str,
    leaves: Leaves,
    edits: LeafEdits,
    jitter: Jitter,
    color: tuple[float, float, float],
    jitter_map: str,
    settings: LeafAssetSettings,
) -> list[NDArray[np.float64]]:
    """The layers of the representations; returns the bounds (2, 3) of each."""
    drawn = edited_leaves(leaves, edits)
    bounds = []
    for representation in settings.representations:
        path = payload / REPRESENTATIONS[representation]
        if representation == "bezier":
            segments = silhouette_segments(settings.prototype.silhouette, jitter)
            prototype = replace(settings.prototype, silhouette=segments)
            prim = leaves_prim(leaves, edits, jitter, color, jitter_map, prototype)
            bounds.append(write_leaves_layer(path, name, prim))
        elif representation == "nurbs":
            bounds.append(write_patches_layer(path, name, drawn, jitter, color, jitter_map))
        elif representation == "subdiv":
            cage = build_leaf_cage(drawn, settings.cage, jitter)
            bounds.append(write_cage_layer(path, name, cage, drawn, color))
        else:
            mesh = build_leaf_mesh(drawn, settings.mesh, jitter)
            bounds.append(write_mesh_layer(path, name, mesh, drawn, color))
    return bounds


def copy_map(folder: Path, name: str, source: Path | None) -> str:
    """Copy a picture into the asset's maps; returns its path from the payload's folder, empty without a picture."""
    if source is None:
        return ""
    target = folder / "maps" / f"{name}{source.suffix.lower()}"
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        shutil.copyfile(source, target)
    except OSError as error:
        raise AssetError(f"{source} cannot be copied into the asset: {error.strerror}") from error
    return f"{MAPS}/{target.name}"


def begin_asset(folder: Path, name: str) -> Path:
    """The payload's folder, made; ValueError for a name that is no identifier."""
    if not Sdf.Path.IsValidIdentifier(name):
        raise ValueError(f"{name!r} is no identifier; asset_name makes one")
    payload = folder / "payload"
    payload.mkdir(parents=True, exist_ok=True)
    return payload


def finish_asset(
    folder: Path,
    name: str,
    plant: Plant,
    variants: Sequence[VariantSet],
    shared: Sequence[str] = ("./materials.usda",),
    frames: int = 0,
) -> Path:
    """The two layers that hold the others together; shared are those of the payload's folder in every variant.

    frames is how many there are in variants that move.
    """
    write_payload_layer(folder / "payload" / "payload.usda", name, shared, variants)
    interface = folder / f"{name}.usda"
    write_interface_layer(interface, name, plant, variants, frames)
    return interface
