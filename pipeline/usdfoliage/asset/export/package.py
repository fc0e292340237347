"""A usdz package: one layer and its pictures in a file that appears whole, or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf

from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.locate import check_usd_name
from usdfoliage.asset.look_layer import CUSTOM_DATA_KEY
from usdfoliage.errors import AssetError
from usdfoliage.files.atomic import write_whole_files
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.files.unwritten import describe_failed
from usdfoliage.remarks import Argument

_ORIGIN = "origin"
_TIME = 946_728_000  # 1 January 2000, noon: in no time zone another year


def record_origin(layer: Sdf.Layer, origin: AssetOrigin) -> None:
    """Record in a layer where it comes from: a package has no list of files beside it."""
    custom = dict(layer.customLayerData)
    record = dict(custom.get(CUSTOM_DATA_KEY, {}))
    record[_ORIGIN] = {"command": origin.command, "source": origin.source}
    layer.customLayerData = {**custom, CUSTOM_DATA_KEY: record}


def pack_usdz(layer: Path, package: Path) -> None:
    """Pack a layer, first, and all that is in the folders beside it, by their names from there.

    Raises:
        WriteError: The package cannot be written.
    """
    folder = layer.parent
    files = [layer, *sorted(path for path in folder.rglob("*") if path.is_file() and path not in (layer, package))]
    writer = Sdf.ZipFileWriter.CreateNew(str(package))
    try:
        for path in files:
            os.utime(path, (_TIME, _TIME))  # which the package has of each file: the same files, the same bytes
            if not writer.AddFile(str(path), path.relative_to(folder).as_posix()):
                raise describe_failed(package, f"{path.name} cannot be packed")
        if not writer.Save():
            raise describe_failed(package, "USD states no reason")
    except Tf.ErrorException as error:
        raise describe_failed(package, error) from error


@contextmanager
def publish_package(output: Path, origin: AssetOrigin, *, force: bool = False) -> Iterator[Path]:
    """Give the body an empty folder; when it ends well, the file in it of the output's name is the output.

    Raises:
        AssetError: output is a folder, or is there and may not be replaced.
        WriteError: It cannot be written; what was there is unchanged.
    """
    _check_replaceable(output, origin, force)
    with temporary_folder("package", AssetError) as folder:
        yield folder
        data = (folder / output.name).read_bytes()
    _check_replaceable(output, origin, force)  # somebody may have put something there meanwhile
    write_whole_files([(output, data)])


def plan_package(output: Path, origin: AssetOrigin, *, force: bool = False) -> str:
    """What publish_package would do, in a line for a dry run; writes nothing.

    Raises:
        AssetError: publish_package would refuse output.
    """
    _check_replaceable(output, origin, force)
    return f"would {'replace' if output.exists() else 'write'}: {output}"


def _check_replaceable(output: Path, origin: AssetOrigin, force: bool) -> None:
    check_usd_name(output)
    if output.is_dir():
        raise AssetError(f"{output} is a folder", "name the .usdz to write")
    if not os.path.lexists(output) or force:
        return
    remedy = ("name another file, or use ", Argument(name="force"), " to replace it")
    try:
        layer = Sdf.Layer.FindOrOpen(str(output))
    except Tf.ErrorException:
        layer = None
    record = layer.customLayerData.get(CUSTOM_DATA_KEY) if layer is not None else None
    made = record.get(_ORIGIN) if isinstance(record, dict) else None
    if not isinstance(made, dict):
        raise AssetError(f"{output} is there already and no export of usdfoliage", remedy)
    old = AssetOrigin(name=layer.defaultPrim, command=str(made.get("command")), source=str(made.get("source")))
    if (old.name, old.command, old.source) != (origin.name, origin.command, origin.source):
        raise AssetError(f"{output} was made by {old.describe()}, and not by {origin.describe()}", remedy)
