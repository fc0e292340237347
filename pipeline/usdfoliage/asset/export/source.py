"""What may be exported: one asset of this version, whole, and not a scene."""

import os
import re
from dataclasses import dataclass
from pathlib import Path

from pxr import Usd

from usdfoliage.asset.asset_record import is_asset_folder
from usdfoliage.asset.locate import check_layers, find_interface, open_layer
from usdfoliage.asset.look_layer import CUSTOM_DATA_KEY
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.packages.contents import interface_of, list_files, require_plant
from usdfoliage.asset.packed_files import is_package
from usdfoliage.asset.plant import TO_LEAVES
from usdfoliage.asset.schema import PLANT_API
from usdfoliage.errors import AssetError

_GENERATOR = re.compile(r"usdfoliage (\d+(?:\.\d+)*)")


@dataclass(frozen=True, kw_only=True)
class ExportSource:
    """An asset that can be exported."""

    interface: Path
    look: Path | None  # that is put into the export
    lods: tuple[str, ...]  # variants of the set lod; empty where the asset has no such set
    has_leaves: bool


def check_exportable(asset: Path, version: str) -> ExportSource:
    """Look at an asset before anything is made of it.

    Args:
        asset: Its folder, its interface layer, or a look of it.
        version: Of the package that runs, as 0.1.0.

    Raises:
        AssetError: It cannot be read, is a scene, a package or made by another version, or a file that it needs is
            missing.
    """
    named = find_interface(asset)
    interface, look = interface_of(asset)
    if is_package(interface):
        raise AssetError(f"{interface} is a package", "unpack it, as any zip file, and name the folder")
    _check_default_prim(asset, interface)
    _check_version(interface, version)
    for file in dict.fromkeys((interface, named)):
        check_layers(open_layer(file), file)  # USD would wait for a pipe among them
        missing = list_files(file)[2]
        if missing:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            raise AssetError(
                f"{file} needs {missing[0]}{more}, which is not there",
                "put the file there, or write the asset again, and export then",
            )
    stage = open_asset(asset, Usd.Stage.LoadNone)
    plant = require_plant(stage, asset)
    names = plant.GetVariantSets().GetNames()
    lods = tuple(plant.GetVariantSet("lod").GetVariantNames()) if "lod" in names else ()
    return ExportSource(
        interface=interface,
        look=None if look is None else look.path,
        lods=lods,
        has_leaves=bool(plant.GetRelationship(TO_LEAVES).GetTargets()),
    )


def check_output_place(output: Path, interface: Path) -> None:
    """Refuse an output that is in the asset's folder, is that folder, or holds it.

    Raises:
        AssetError: It is there.
    """
    target, folder = Path(os.path.realpath(output)), Path(os.path.realpath(interface)).parent
    if not is_asset_folder(folder):
        folder = Path(os.path.realpath(interface))
    if target.is_relative_to(folder):
        raise AssetError(f"{output} lies in the asset {folder}, which stays as it is", "name a place beside it")
    if folder.is_relative_to(target):
        raise AssetError(f"{output} holds the asset {folder}, and would replace it", "name another place")


def _check_default_prim(asset: Path, interface: Path) -> None:
    layer = open_layer(interface)
    spec = layer.GetPrimAtPath(f"/{layer.defaultPrim}") if layer.defaultPrim else None
    applied = spec.GetInfo("apiSchemas") if spec is not None and spec.HasInfo("apiSchemas") else None
    if applied is None or PLANT_API not in applied.GetAddedOrExplicitItems():
        raise AssetError(
            f"{asset} is no asset of usdfoliage: the default prim of {interface.name} has no {PLANT_API}",
            "export the assets of a scene one by one",
        )


def _check_version(interface: Path, version: str) -> None:
    """Assets that others wrote, through the Python API, name no version of ours and pass."""
    record = open_layer(interface).customLayerData.get(CUSTOM_DATA_KEY)
    generator = str(record.get("generator", "")) if isinstance(record, dict) else ""
    found = _GENERATOR.fullmatch(generator)
    if found is None:
        return
    theirs, ours = (tuple(map(int, text.split("."))) for text in (found.group(1), _leading_numbers(version)))
    if theirs < ours:
        raise AssetError(
            f"{interface} was written by usdfoliage {found.group(1)}, and this is {version}",
            "write it again with `usdfoliage bake` into another folder, and export that",
        )
    if theirs > ours:
        raise AssetError(
            f"{interface} was written by usdfoliage {found.group(1)}, and this is {version}",
            "export it with that version",
        )


def _leading_numbers(version: str) -> str:
    found = re.match(r"\d+(?:\.\d+)*", version)
    return found.group(0) if found else "0"
