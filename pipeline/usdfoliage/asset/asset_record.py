"""What an asset's folder records of itself: which files are its own, and where it comes from.

The interface layer has the record of the run (usdfoliage.asset.provenance), which gets the origin, and the name of
FILES_LIST.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from pxr import Sdf, Tf

from usdfoliage.asset.layer import save_layer
from usdfoliage.asset.locate import usd_files_at_top
from usdfoliage.asset.look_layer import CUSTOM_DATA_KEY, LOOK_OF
from usdfoliage.asset.packed_files import is_package
from usdfoliage.errors import AssetError
from usdfoliage.files.json import read_json
from usdfoliage.remarks import Argument

FILES_LIST = "report/files.json"  # of an asset: the files that were written, itself among them
_ORIGIN = "origin"  # of an asset's record
_FILES = "files"  # of an asset's record: FILES_LIST; in assets of earlier versions the list itself


@dataclass(frozen=True, kw_only=True)
class AssetOrigin:
    """Where an asset comes from: only one of the same name and origin is replaced without force.

    Attributes:
        name: Of the asset: that of its interface layer without its suffix.
        command: That made it; empty where an earlier version did, which did not record it.
        source: The name of what it was made of, without its folder; empty where there was nothing.
    """

    name: str
    command: str
    source: str = ""

    def describe(self) -> str:
        made = f"`{self.command}`" if self.command else "an earlier version"
        return f"{made} of {self.source}" if self.source else made

    def is_same(self, other: "AssetOrigin") -> bool:
        """Whether two assets are made of the same by the same; not where that is not known."""
        if (self.command, self.source) == (other.command, other.source):
            return True
        if self.command and other.command:
            return False
        # Earlier versions recorded the source alone, of clouds without its suffix.
        first, second = ({origin.source, PurePath(origin.source).stem} - {""} for origin in (self, other))
        return bool(first & second)


def is_asset_folder(folder: Path) -> bool:
    """Whether exactly one USD file stands at the top of folder and usdfoliage wrote it."""
    return _read_record(folder) is not None


def foreign_files(folder: Path) -> list[str]:
    """Files in an asset's folder that usdfoliage did not write, by their path from there, sorted.

    Raises:
        AssetError: The list of the asset's own files, FILES_LIST, is lost or damaged.
    """
    record = _read_record(folder)
    ours = _own_files(folder, record) if record else set()
    return [name for name in list_files(folder) if name not in ours] if ours else []


def listed_files(folder: Path) -> set[str] | None:
    """The files that an asset's record lists; None where there is no such list, or it cannot be read."""
    try:
        record = _read_record(folder)
        return (_own_files(folder, record) or None) if record else None
    except AssetError:
        return None


def remaining_files(folder: Path) -> set[str] | None:
    """As listed_files, also where the removal of the folder was broken off after its interface layer."""
    listed = listed_files(folder)
    if listed is not None or usd_files_at_top(folder):
        return listed
    try:
        return _own_files(folder, {_FILES: FILES_LIST}) or None
    except AssetError:
        return None


def read_origin(folder: Path) -> AssetOrigin | None:
    """Where the asset in a folder comes from, as far as it records that; None where there is no asset."""
    try:
        record, interface = _read_record(folder), _interface(folder)
    except OSError:  # there is no folder
        return None
    if record is None or interface is None:
        return None
    origin = record.get(_ORIGIN)
    if isinstance(origin, dict) and {"command", "source"} <= origin.keys():
        return AssetOrigin(name=interface.stem, command=str(origin["command"]), source=str(origin["source"]))
    source = str(record.get("capture", "")).replace("\\", "/").rsplit("/", 1)[-1]
    return AssetOrigin(name=interface.stem, command="", source=source)


def record_files(folder: Path, origin: AssetOrigin | None) -> None:
    """List which files are ours, so that a later run does not take others with them; the interface layer names the
    list, and the origin if there is one.

    Raises:
        WriteError: The layer cannot be written.
        OSError: The list cannot be written.
    """
    record, interface = _read_record(folder), _interface(folder)
    if record is None or interface is None:
        return
    path = folder / FILES_LIST
    path.parent.mkdir(exist_ok=True)
    files = sorted({*list_files(folder), FILES_LIST})
    path.write_text(json.dumps({"files": files}, indent=1) + "\n", encoding="utf-8")
    made_by = {} if origin is None else {_ORIGIN: {"command": origin.command, "source": origin.source}}
    layer = Sdf.Layer.OpenAsAnonymous(str(interface))
    layer.customLayerData = {**layer.customLayerData, CUSTOM_DATA_KEY: {**record, _FILES: FILES_LIST, **made_by}}
    save_layer(layer, interface)


def list_files(folder: Path) -> list[str]:
    """All files and symbolic links in a folder, by their path from there, sorted."""
    return sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()
    )


def _own_files(folder: Path, record: Mapping[str, Any]) -> set[str]:
    """What usdfoliage wrote, as the record of an asset knows it; empty where it does not."""
    entry = record.get(_FILES, ())
    if not isinstance(entry, str):
        return set(map(str, entry)) if isinstance(entry, Iterable) else set()
    try:
        listed = read_json(folder / FILES_LIST)["files"]
        if not all(isinstance(name, str) for name in listed):
            raise ValueError("it holds other things than names of files")
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise AssetError(
            f"{folder / FILES_LIST}, the list of the asset's own files, cannot be read ({reason})",
            ("use ", Argument(name="force"), ", which keeps what is there in a folder beside the new asset"),
        ) from error
    return set(listed)


def _interface(folder: Path) -> Path | None:
    """The one USD file at the top of folder; None where it is a package, which users make, and put where they like."""
    layers = usd_files_at_top(folder)
    return layers[0] if len(layers) == 1 and not is_package(layers[0]) else None


def _read_record(folder: Path) -> dict[str, Any] | None:
    """What usdfoliage wrote into the interface layer of itself; None where it is no asset of ours, as a look."""
    interface = _interface(folder)
    if interface is None:
        return None
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(interface), metadataOnly=True)
    except Tf.ErrorException:
        return None
    record = layer.customLayerData.get(CUSTOM_DATA_KEY) if layer is not None else None
    return record if isinstance(record, dict) and LOOK_OF not in record else None
