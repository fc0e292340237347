"""Looks: layers that edit the leaves of an asset wherever a scene refers to it.

A look holds opinions of the class that the asset's root inherits, so that it needs no path of the scene: sublayered
into a scene it reaches every placement of the asset, instances too, and muted it is as if it were not there. It brings
no plant of its own and does not touch the asset. Its opinions stand in the class's variant bezier of the set
representation, since the other representations have other prims at the same paths.
"""

import os
from dataclasses import dataclass
from pathlib import Path

from pxr import Kind, Sdf, Usd, UsdGeom, UsdUtils

from usdfoliage.asset.locate import (
    check_layers,
    find_interface,
    find_leaves,
    find_plants,
    log_diagnostics,
    open_layer,
    require_leaves,
    select_leafy_lod,
    select_representation,
    try_layer,
    usd_path,
)
from usdfoliage.asset.look_layer import (
    BEZIER,
    CUSTOM_DATA_KEY,
    LOOK_OF,
    LOOK_PRIM,
    REPRESENTATION,
    author_edits,
    build_look,
    find_class,
    path_between,
    placement_class,
)
from usdfoliage.asset.looks.extents import author_wider_extents
from usdfoliage.asset.looks.jitter import author_look_jitter_map
from usdfoliage.asset.materials.jitter_map import read_jitter_map
from usdfoliage.asset.packed_files import is_package
from usdfoliage.asset.parts.leaf_primvars import edit_values, read_jitter_map_path
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.asset.publish_file import publish_text
from usdfoliage.asset.schema import PLANT_API, require_schemas
from usdfoliage.errors import AssetError
from usdfoliage.leaf.shape.edits import LeafEdits
from usdfoliage.remarks import Argument


@dataclass(frozen=True, kw_only=True)
class Look:
    """What a look's layer records of the look."""

    path: Path
    asset: Path  # the interface layer of the asset that it edits
    prim_path: str  # the one placement that it is for, empty for all


def open_asset(asset: Path, load: Usd.Stage.InitialLoadSet = Usd.Stage.LoadAll) -> Usd.Stage:
    """Open an asset's folder, its interface layer, a look, or any scene that has plants.

    A look is shown over its asset, on a stage of its own that is saved nowhere; the plant has the path that it has in
    the asset, or that of the placement that the look is for.

    Raises:
        AssetError: There is nothing of that name; it is no USD, truncated or damaged, or something that a plant needs
            is; it is a look whose asset is missing; it has neither a plant nor leaves.
    """
    require_schemas()
    path = find_interface(asset)
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # USD would print them
    root = open_root_layer(path)
    check_layers(root, path)
    stage = Usd.Stage.Open(root, load)
    log_diagnostics(diagnostics)
    plants = find_plants(stage)
    for error in stage.GetCompositionErrors():
        if not plants or any(error.rootSite.path.HasPrefix(plant.GetPath()) for plant in plants):
            raise AssetError(f"{path} cannot be put together: {error}", "write the asset again")
    if not plants and not find_leaves(stage):
        raise AssetError(
            f"{path} holds no plant: none of its prims has {PLANT_API}", "name an asset's folder, its .usda or a look"
        )
    return stage


def try_composing(asset: Path) -> None:
    """Compose what another process is about to draw, so that a file on which USD does not end is found here.

    Raises:
        AssetError: There is nothing of that name, or it is no USD, truncated or damaged.
    """
    require_schemas()
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # that process prints them
    path = find_interface(asset)
    root = open_root_layer(path)
    check_layers(root, path)
    Usd.Stage.Open(root)
    log_diagnostics(diagnostics)


def open_root_layer(path: Path) -> Sdf.Layer:
    """The layer at path; for a look one in memory that shows it over its asset.

    Raises:
        AssetError: It cannot be read as USD, or it is a look whose asset is missing.
    """
    layer = open_layer(path)
    look = read_look(layer)
    if look is None:
        return layer
    interface = open_layer(look.asset)
    # The asset is referred to, not sublayered: opinions of the asset's root would be stronger than the class's.
    root = Sdf.Layer.CreateAnonymous(f"{path.stem}.usda")
    root.subLayerPaths.append(layer.identifier)
    stage = Usd.Stage.Open(root, Usd.Stage.LoadNone)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    plant = stage.DefinePrim(look.prim_path or f"/{interface.defaultPrim}")
    for prefix in plant.GetPath().GetPrefixes()[:-1]:  # prims in place of the scene's around one placement
        parent = UsdGeom.Xform.Define(stage, prefix).GetPrim()
        Usd.ModelAPI(parent).SetKind(Kind.Tokens.assembly if prefix.IsRootPrimPath() else Kind.Tokens.group)
    plant.GetReferences().AddReference(str(look.asset))
    stage.SetDefaultPrim(stage.GetPrimAtPath(plant.GetPath().GetPrefixes()[0]))
    return root


def read_look(layer: Sdf.Layer) -> Look | None:
    """What a look's layer records of the look, None for any other layer.

    Raises:
        AssetError: Its asset is missing.
    """
    record = layer.customLayerData.get(CUSTOM_DATA_KEY)
    if not isinstance(record, dict) or LOOK_OF not in record:
        return None
    path, stated = Path(layer.realPath), str(record[LOOK_OF])
    for folder in (path.parent, path.resolve().parent):
        asset = Path(os.path.normpath(folder / stated))
        if asset.is_file():
            return Look(path=path, asset=asset, prim_path=str(record.get(LOOK_PRIM, "")))
    raise AssetError(f"{path} is a look of {stated}, which is not there", "put the asset there or write the look again")


def write_look_layer(
    path: Path,
    asset: Path,
    edits: LeafEdits,
    jitter_map: Path | None = None,
    prim_path: str | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write a look that gives the leaves of an asset these edits; it appears whole or not at all.

    Besides the edits it authors the wider extents that they need. A jitter map is referred to where it is, not copied.

    Args:
        path: The .usda to write; an earlier look there is replaced.
        asset: The asset's folder or interface layer, or a look: then the new one is a look of that look's asset, and
            does not need the other.
        edits: The edits as the leaves shall have them in the end; what the asset itself has already is not authored.
        jitter_map: An image for the jitter (usdfoliage.asset.materials.jitter_map); that of asset stays without.
        prim_path: Edit only the placement at this prim of a scene, the prim that refers to the asset; without, the one
            that asset is a look for, else all.
        force: Replace a file that is no look of ours too.

    Returns:
        path.

    Raises:
        AssetError: The asset or the jitter map cannot be read, or there are no leaves; path is no .usda, lies in the
            asset's folder, is a folder or somebody else's file, or cannot be written.
    """
    named = open_layer(find_interface(asset))
    look = read_look(named)
    interface = look.asset if look else Path(named.realPath)
    stage = _open_bezier(interface)
    plant = the_plant(stage, interface)
    target = check_look_output(path, interface, force=force)
    if look is not None:
        prim_path = prim_path or look.prim_path or None
        if jitter_map is None:
            opened = _open_bezier(asset)
            jitter_map = read_jitter_map_path(require_leaves(opened, asset)[0])
    class_path = look_class(plant, interface, prim_path)

    def author_leaves(overs: Usd.Stage) -> None:
        for leaves in require_leaves(stage, interface):
            read = read_leaves(leaves)
            at = leaves.GetPath().ReplacePrefix(plant.GetPath(), class_path)
            author_edits(overs, at, edit_values(edits), edit_values(read.edits))
            drawn_map = jitter_map or read.jitter_map
            wave = read_jitter_map(drawn_map) if drawn_map else None
            if jitter_map and jitter_map != read.jitter_map:
                author_look_jitter_map(overs, class_path, plant, leaves, look_relative(jitter_map, path))
            author_wider_extents(overs, class_path, plant, leaves, read, edits, wave)

    layer = build_look(plant, class_path, look_relative(interface, path), author_leaves, prim_path)
    publish_text(target, layer.ExportToString())
    return path


def _open_bezier(asset: Path) -> Usd.Stage:
    """The asset as its leaves can be edited."""
    stage = open_asset(asset)
    select_leafy_lod(stage)
    if any(REPRESENTATION in plant.GetVariantSets().GetNames() for plant in find_plants(stage)):
        select_representation(stage, BEZIER)
    return stage


def the_plant(stage: Usd.Stage, interface: Path) -> Usd.Prim:
    """The plant of an asset's own stage; AssetError where its default prim is none."""
    plant = stage.GetDefaultPrim()
    if not plant or PLANT_API not in plant.GetAppliedSchemas():
        raise AssetError(
            f"{interface} is no asset: its default prim has no {PLANT_API}", "name the asset, not the scene"
        )
    return plant


def look_class(plant: Usd.Prim, interface: Path, prim_path: str | None) -> Sdf.Path:
    """The class whose opinions reach every placement, or one of its own for one placement."""
    class_path = find_class(plant)
    if class_path is None:
        raise AssetError(
            f"{interface}: <{plant.GetPath()}> inherits no class, so no look can reach it", "write it again"
        )
    return class_path if prim_path is None else placement_class(class_path, _read_prim_path(prim_path))


def _read_prim_path(stated: str) -> Sdf.Path:
    """The path of a prim that a scene can have; AssetError for any other."""
    valid, _ = Sdf.Path.IsValidPathString(stated)
    path = Sdf.Path(stated) if valid else Sdf.Path.emptyPath
    if not path.IsAbsolutePath() or not path.IsPrimPath() or path.ContainsPrimVariantSelection():
        raise AssetError(
            f"{stated!r} is no path of a prim; the absolute path of the prim that refers to the asset is needed, "
            "without variants or a property, like /World/plant_1"
        )
    return path


def look_relative(target: Path, look: Path) -> str:
    """The way from the look's folder to target, beginning with ./ or ../."""
    return path_between(usd_path(target), usd_path(look.parent))


def check_look_output(path: Path, interface: Path, *, force: bool = False) -> Path:
    """The file behind symbolic links that a look of the asset with this interface layer is written to.

    Raises:
        AssetError: path is no .usda, lies in the asset's folder, is a folder or, without force, somebody else's file.
    """
    target = Path(os.path.realpath(path))
    if path.suffix != ".usda":
        raise AssetError(f"{path} cannot be a look: its name must end with .usda")
    folder = Path(os.path.realpath(interface)).parent
    if target.is_relative_to(folder) and not is_package(interface):
        raise AssetError(
            f"{path} lies in the asset's folder {folder}, which a look leaves as it is", "write it elsewhere"
        )
    if target.is_dir():
        raise AssetError(f"{path} is a folder", "name the .usda to write")
    if target.exists() and not force:
        layer, _ = try_layer(target)
        record = layer.customLayerData.get(CUSTOM_DATA_KEY) if layer is not None else None
        if not isinstance(record, dict) or LOOK_OF not in record:
            raise AssetError(
                f"{path} is there already and no look of usdfoliage",
                ("name another, or use ", Argument(name="force"), " to lose it"),
            )
    return target
