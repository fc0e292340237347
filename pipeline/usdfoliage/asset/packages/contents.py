"""What an asset holds, read from its layers."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdUtils

from usdfoliage.asset.locate import (
    find_interface,
    find_plants,
    first_reason,
    log_diagnostics,
    lost_layers,
    open_layer,
    refuse_forest,
)
from usdfoliage.asset.look_layer import CUSTOM_DATA_KEY, REPRESENTATION
from usdfoliage.asset.looks.look import Look, read_look
from usdfoliage.asset.materials.leaf import STORM_SURFACE, TEXTURE_COLOR
from usdfoliage.asset.materials.picture import why_no_picture
from usdfoliage.asset.own_files import may_hand_on, require_own
from usdfoliage.asset.packed_files import display_name, is_package, is_packed, size_bytes
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.asset.parts.leaf_primvars import describe_unfound, place
from usdfoliage.asset.plant import BRANCHES, CROWN, LEAVES, SKELETON
from usdfoliage.asset.provenance import Provenance, read_provenance_file, texts
from usdfoliage.asset.schema import CROWN_API, LEAF_API, PLANT_API, SKELETON_API
from usdfoliage.asset.stored_numbers import stored_numbers
from usdfoliage.asset.variants import order_variants
from usdfoliage.errors import AssetError
from usdfoliage.files.reading import why_irregular

_FOLIAGE = "Foliage"  # begins the names of our schemas


@dataclass(frozen=True, kw_only=True)
class AssetFile:
    """One file of an asset."""

    path: str  # from the folder of the interface layer, or from the package that it is packed in
    size_bytes: int


@dataclass(frozen=True, kw_only=True)
class CrownFacts:
    """What is authored on a crown's prim."""

    center_m: tuple[float, float, float]
    radius_range_m: tuple[float, float]
    relief_weight: float
    radius_map: Path | None  # None where the file is missing
    color_map: Path | None


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantFacts:
    """What is authored on the root prim, and what the asset is composed of."""

    name: str
    asset_from_capture: NDArray[np.float64]  # (4, 4), column vectors
    version: str
    variants: Mapping[str, Sequence[str]]  # names by variant set
    selections: Mapping[str, str]
    provenance: Provenance
    extent: NDArray[np.float64] | None  # (2, 3), in the stage's unit; None where no extentsHint is authored
    up_axis: str
    meters_per_unit: float
    schemas: Mapping[str, Sequence[str]]  # ours, by prim path


def require_plant(stage: Usd.Stage, path: Path, *, one: bool = True) -> Usd.Prim:
    """The one plant of a stage; path is what the user calls it, and one whether a forest is refused.

    Raises:
        AssetError: The stage is not ours, has several, or is a forest.
    """
    plants = find_plants(stage)
    if len(plants) == 1:
        if one:
            refuse_forest(plants[0], path)
        return plants[0]
    if plants:
        names = ", ".join(f"<{plant.GetPath()}>" for plant in plants[:3])
        more = f" and {len(plants) - 3} more" if len(plants) > 3 else ""
        raise AssetError(f"{path} holds {len(plants)} plants ({names}{more})", "name the asset of one of them")
    raise AssetError(
        f"{path} is no asset of usdfoliage: none of its prims has {PLANT_API}",
        "name an asset's folder, its .usda, or a look",
    )


def representations(plant: Usd.Prim) -> list[str]:
    """The variants that show the leaves, those of usdfoliage first; empty where there is nothing to choose."""
    sets = plant.GetVariantSets()
    return _variant_names(plant, REPRESENTATION) if REPRESENTATION in sets.GetNames() else []


def find_crown(plant: Usd.Prim) -> Usd.Prim | None:
    """The prim of the crown in the selected variants, None where the plant has none."""
    relationship = plant.GetRelationship("foliage:crown")
    targets = relationship.GetForwardedTargets() if relationship else []
    prim = plant.GetStage().GetPrimAtPath(targets[0] if targets else plant.GetPath().AppendPath(CROWN))
    return prim if prim and prim.HasAPI(CROWN_API) else None


def find_skeleton(plant: Usd.Prim) -> Usd.Prim | None:
    """The prim of the branches' skeleton in the selected variants, None where the plant has none."""
    prim = plant.GetStage().GetPrimAtPath(plant.GetPath().AppendPath(SKELETON))
    return prim if prim and prim.HasAPI(SKELETON_API) else None


def find_branches(plant: Usd.Prim) -> Usd.Prim | None:
    """The prim of the branches' surface in the selected variants, None where the plant has none."""
    prim = plant.GetStage().GetPrimAtPath(plant.GetPath().AppendPath(BRANCHES))
    return prim if prim and prim.IsA(UsdGeom.Mesh) else None


def read_plant_facts(plant: Usd.Prim, interface: Path) -> PlantFacts:
    """What is authored on the root prim, and the record in the interface layer."""
    stage = plant.GetStage()
    sets = plant.GetVariantSets()
    names = list(sets.GetNames())
    hint = stored_numbers(UsdGeom.ModelAPI(plant).GetExtentsHint(), (None, 3))
    corners = np.zeros((0, 2, 3)) if hint is None else hint[: len(hint) // 2 * 2].reshape(-1, 2, 3)
    boxes = corners[(corners[:, 0] <= corners[:, 1]).all(axis=1)]  # an empty purpose has its corners swapped
    matrix = stored_numbers(plant.GetAttribute("foliage:captureToAsset").Get(), (4, 4))
    return PlantFacts(
        name=plant.GetName(),
        asset_from_capture=np.eye(4) if matrix is None else matrix.T,
        version=str(Usd.ModelAPI(plant).GetAssetVersion() or ""),
        provenance=_read_provenance(plant, interface),
        variants={name: tuple(_variant_names(plant, name)) for name in names},
        selections={name: sets.GetVariantSet(name).GetVariantSelection() for name in names},
        extent=np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)]) if len(boxes) else None,
        up_axis=str(UsdGeom.GetStageUpAxis(stage)),
        meters_per_unit=float(UsdGeom.GetStageMetersPerUnit(stage)),
        schemas=_schemas(plant),
    )


def interface_of(asset: Path) -> tuple[Path, Look | None]:
    """The interface layer of an asset's folder, of itself, or of a look; and the look.

    Raises:
        AssetError: There is nothing of that name, it cannot be read, or it is a look whose asset is missing.
    """
    layer = open_layer(find_interface(asset))
    look = read_look(layer)
    return (look.asset if look else Path(layer.realPath)), look


def matrix_in_plant(prim: Usd.Prim, plant: Usd.Prim) -> NDArray[np.float64]:
    """From prim's frame to the plant's, (4, 4) for column vectors; what stands above the plant is left out."""
    cache = UsdGeom.XformCache(Usd.TimeCode.EarliestTime())
    matrix, _ = cache.ComputeRelativeTransform(prim, plant)
    return np.array(matrix).T


def read_leaf_appearance(leaves: Usd.Prim, jitter_map: Path | None, folders: Sequence[Path]) -> LeafAppearance:
    """The appearance that all leaves of an instancer share: the colour of its prototype, the texture of its material.

    Args:
        leaves: The instancer.
        jitter_map: The map of its jitter, if it has one.
        folders: Where its pictures may lie (usdfoliage.asset.own_files.own_folders).

    Raises:
        AssetError: The texture is missing, or it or the jitter map lies in a package or outside the folders.
    """
    if jitter_map is not None and is_packed(jitter_map):
        raise AssetError(f"the jitter map {jitter_map} lies in a package", "unpack that, as any zip file, first")
    if jitter_map is not None:
        require_own(jitter_map, folders, f"the jitter map {jitter_map}")
    targets = UsdGeom.PointInstancer(leaves).GetPrototypesRel().GetForwardedTargets()
    prototype = leaves.GetStage().GetPrimAtPath(targets[0]) if targets else None
    if not prototype:
        return LeafAppearance(jitter_map=jitter_map)
    color = LeafAppearance().color
    display = UsdGeom.Gprim(prototype).GetDisplayColorAttr() if prototype.IsA(UsdGeom.Gprim) else None
    colors = display.Get() if display else None
    if colors is not None and len(colors) == 1:
        red, green, blue = map(float, colors[0])
        color = (red, green, blue)
    return LeafAppearance(
        color=color,
        texture=_read_texture(prototype, folders),
        texture_color=_read_texture_color(prototype),
        jitter_map=jitter_map,
    )


def read_crown_facts(prim: Usd.Prim) -> CrownFacts:
    """What is authored on the crown's prim.

    Raises:
        AssetError: A fact is missing, or is no such number.
    """
    x, y, z = _crown_numbers(prim, "center", (3,))
    low, high = _crown_numbers(prim, "radiusRange", (2,))
    return CrownFacts(
        center_m=(float(x), float(y), float(z)),
        radius_range_m=(float(low), float(high)),
        relief_weight=float(_crown_numbers(prim, "reliefWeight", ())),
        radius_map=_file(_crown_value(prim, "radiusMap")),
        color_map=_file(_crown_value(prim, "colorMap")),
    )


def _crown_value(prim: Usd.Prim, name: str) -> Any:
    value = prim.GetAttribute(f"foliage:crown:{name}").Get()
    if value is None:
        raise AssetError(f"foliage:crown:{name} is missing ({place(prim)})", "write the asset again")
    return value


def _crown_numbers(prim: Usd.Prim, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    value = _crown_value(prim, name)
    numbers = stored_numbers(value, shape)
    if numbers is None:
        needed = f"{shape[0]} numbers are" if shape else "a number is"
        raise AssetError(
            f"foliage:crown:{name} holds {value}, {needed} needed ({place(prim)})", "write the asset again"
        )
    return numbers


def prototype_segments(leaves: Usd.Prim) -> int | None:
    """Into how many segments the prototype of an instancer divides each silhouette, None where it is not ours."""
    for target in UsdGeom.PointInstancer(leaves).GetPrototypesRel().GetForwardedTargets():
        prototype = leaves.GetStage().GetPrimAtPath(target)
        st = UsdGeom.PrimvarsAPI(prototype).GetPrimvar("st").Get() if prototype else None
        if st:
            return 1 + int(np.count_nonzero(np.array(st)[:, 0] == 1))  # base and apex lie on the axis
    return None


def count_changed_patches(plant: Usd.Prim) -> int:
    """How many patches have opinions in other layers than their own; 0 unless nurbs is selected."""
    if plant.GetVariantSets().GetVariantSelection(REPRESENTATION) != "nurbs":
        return 0
    return sum(
        any(spec.properties or spec.HasInfo("active") for spec in prim.GetPrimStack()[:-1])
        for prim in Usd.PrimRange(plant, Usd.PrimAllPrimsPredicate)
        if prim.IsA(UsdGeom.NurbsPatch)
    )


def list_files(interface: Path) -> tuple[list[AssetFile], list[AssetFile], list[str]]:
    """Layers, other files and missing files that an asset needs in any variant, the interface layer first.

    Raises:
        AssetError: A layer cannot be read.
    """
    folder = interface.absolute().parent
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # USD would print what is missing, which is returned
    try:
        layers, others, missing = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(interface.absolute())))
    except Tf.ErrorException as error:
        lost = next(lost_layers(open_layer(interface)), None)
        why = f"it needs {lost[0]}, which cannot be read ({lost[1]})" if lost else first_reason(error)
        raise AssetError(f"{interface} cannot be read: {why}", "write the asset again") from error
    log_diagnostics(diagnostics)
    paths = [Path(layer.realPath) for layer in layers] or [interface.absolute()]
    if is_package(interface):  # by itself its first layer is called by the name of the package
        paths[0] = Path(f"{interface.absolute()}[{Sdf.ZipFile.Open(str(interface)).GetFileNames()[0]}]")
    first, *rest = [_file_of(path, folder) for path in paths]
    return (
        [first, *sorted(rest, key=lambda file: file.path)],
        sorted((_file_of(Path(str(path)), folder) for path in others), key=lambda file: file.path),
        sorted(str(path) for path in missing),
    )


def outside_files(interface: Path, files: Iterable[AssetFile]) -> list[str]:
    """Which of an asset's files lie outside its folder, by their names or by links; nobody may copy or publish them.

    Args:
        interface: The interface layer, or the package, outside of which nothing lies that it can name.
        files: What list_files finds.
    """
    if is_package(interface):
        return [file.path for file in files if Path(file.path).is_absolute()]
    folder = Path(os.path.realpath(interface)).parent
    below = interface.absolute().parent
    return [file.path for file in files if not Path(os.path.realpath(below / file.path)).is_relative_to(folder)]


def files_left_out(interface: Path) -> list[str]:
    """Files that an asset's layers name, in any variant, and that no copy of its layers brings along.

    Raises:
        AssetError: A layer cannot be read.
    """
    _, others, _ = list_files(interface)
    folder = interface.absolute().parent
    return [
        file.path
        for file in others
        if not is_packed(folder / file.path) and not may_hand_on(folder / file.path, folder)
    ]


def irregular_files(layer: Path) -> list[tuple[Path, str]]:
    """Files that a layer needs, itself or through others, that are pipes, devices or circles of links, and why.

    Whoever opens one of these waits for ever, USD's and NVIDIA's validators and Storm too.

    Raises:
        AssetError: A layer cannot be read.
    """
    _, others, missing = list_files(layer)
    folder = layer.absolute().parent
    paths = [*(folder / file.path for file in others), *(folder / name for name in missing)]
    found = [(path, why_irregular(path)) for path in paths if os.path.lexists(path)]
    return [(path, reason) for path, reason in found if reason]


def _variant_names(plant: Usd.Prim, variant_set: str) -> list[str]:
    """In the order of usdfoliage where it has one; USD sorts them by name."""
    return order_variants(plant.GetVariantSets().GetVariantSet(variant_set).GetVariantNames())


def _schemas(plant: Usd.Prim) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    walk = iter(Usd.PrimRange(plant))
    for prim in walk:
        ours = tuple(name for name in prim.GetAppliedSchemas() if name.startswith(_FOLIAGE))
        if ours:
            found[str(prim.GetPath())] = ours
        if LEAF_API in ours or (prim.GetPath() == plant.GetPath().AppendPath(LEAVES)):
            walk.PruneChildren()  # one patch a leaf in the representation nurbs
    return found


def _read_provenance(plant: Usd.Prim, interface: Path) -> Provenance:
    """The run that made the asset; what a plant made by other means does not record is empty."""
    record = open_layer(interface).customLayerData.get(CUSTOM_DATA_KEY)
    entries = record if isinstance(record, dict) else {}
    seed = entries.get("seed")
    inputs, stages = read_provenance_file(interface.parent) if "provenance" in entries else ({}, {})
    return Provenance(
        species=_text(plant, "foliage:species"),
        capture=_text(plant, "foliage:capture").replace("\\", "/").rsplit("/", 1)[-1],
        generator=_text(plant, "foliage:generator"),
        seed=seed if isinstance(seed, int) else 0,
        settings=texts(entries.get("settings")),
        input_sha256=str(entries.get("inputSha256", "")),
        inputs=inputs,
        stages=stages,
        versions=texts(entries.get("versions")),
    )


def _read_texture(gprim: Usd.Prim, folders: Sequence[Path]) -> Path | None:
    """The picture that gives the bound UsdPreviewSurface its colour."""
    material, _ = UsdShade.MaterialBindingAPI(gprim).ComputeBoundMaterial()
    surface = material.ComputeSurfaceSource()[0] if material else None
    color = surface.GetInput("diffuseColor") if surface else None
    sources, _ = color.GetConnectedSources() if color else ((), ())
    file = UsdShade.Shader(sources[0].source.GetPrim()).GetInput("file") if sources else None
    stored = file.Get() if file else None
    if file is None or not isinstance(stored, Sdf.AssetPath) or not stored.path:
        return None
    path = _file(stored)
    if path is None:
        raise describe_unfound("texture", file.GetAttr())
    if is_packed(path):
        raise AssetError(
            f"the texture {path} ({place(gprim)}) lies in a package", "unpack that, as any zip file, first"
        )
    require_own(path, folders, f"the texture {path} ({place(gprim)})")
    reason = why_no_picture(path)
    if reason:
        raise AssetError(f"the texture {path} ({place(gprim)}) is no picture ({reason})", "put a picture there")
    return path


def _read_texture_color(gprim: Usd.Prim) -> tuple[float, float, float] | None:
    """The median colour of that picture, where it is tinted."""
    material, _ = UsdShade.MaterialBindingAPI(gprim).ComputeBoundMaterial()
    surface = UsdShade.Shader(material.GetPrim().GetChild(STORM_SURFACE)) if material else None
    color_input = surface.GetInput(TEXTURE_COLOR) if surface else None
    value = color_input.Get() if color_input else None
    if value is None or not min(value) > 0:
        return None
    red, green, blue = map(float, value)
    return red, green, blue


def _text(prim: Usd.Prim, name: str) -> str:
    value = prim.GetAttribute(name).Get()
    return value if isinstance(value, str) else ""


def _file(value: object) -> Path | None:
    if not isinstance(value, Sdf.AssetPath):
        return None
    path = value.resolvedPath or Ar.GetResolver().Resolve(value.path)
    return Path(str(path)) if str(path) and (Path(str(path)).is_file() or is_packed(Path(str(path)))) else None


def _file_of(path: Path, folder: Path) -> AssetFile:
    try:
        size = size_bytes(path)
    except OSError:  # a link to nothing, which is listed as a file that cannot be read
        size = 0
    return AssetFile(path=display_name(path, folder), size_bytes=size)
